"""Poses from the plans of two scans (the default's step 2).

In: prepared scans. Out: poses under which walls, floors and free space of both would meet.
"""
