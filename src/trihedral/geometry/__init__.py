"""Rigid motions, planes, uncertainty: numbers in, numbers out. Knows no scans.

Transforms are 4x4 float64 named ``b_from_a``. A small motion is a 6-vector ``(omega, v)``, rotation (rad)
before translation (m), applied on the left: ``exp(xi) @ b_from_a``; covariances of a pose are 6x6 in that
order, in frame ``b``.
"""
