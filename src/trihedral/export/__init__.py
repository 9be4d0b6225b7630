"""Registered data in the formats that other programs open.

In: a job's result and its source files. Out: copies with poses, merged clouds, coloured scans.
"""
