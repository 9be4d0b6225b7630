"""Plane matching (the paper's step 4 below its overlap threshold).

In: two sampled scans and an initial pose. Out: the pose under which three planes and their corner coincide.
"""
