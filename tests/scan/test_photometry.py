"""What is left of intensity once distance and incidence are taken away: the paint that it was made from."""

import dataclasses

import numpy as np
import pytest

from support.room import HALF, room_scan
from trihedral.scan.photometry import less_fall_off
from trihedral.scan.preparation import prepare

WAVE = 0.5  # metres


def paint(points):
    """Waves of half a metre, a tenth up and down."""
    return 1.0 + 0.1 * np.sin(2 * np.pi * points / WAVE).sum(axis=1) / np.sqrt(3)


def lit(law, offset=(0.0, 0.0, 0.0), step=0.25, seed=1):
    """The painted room from a place in it, with an intensity by a law of range and cosine; and where the walls are."""
    half = HALF - np.abs(offset)
    scan = room_scan(step=step, seed=seed, half=half)
    distance = np.linalg.norm(scan.xyz, axis=1)
    facing = np.argmax(np.abs(scan.xyz) / half, axis=1)
    cosine = half[facing] / distance
    intensity = paint(scan.xyz.astype(float) + offset) * law(distance, cosine)
    return prepare(dataclasses.replace(scan, intensity=intensity.astype(np.float32)))


LAWS = {
    "corrected": lambda r, c: 0.4 + 0 * r,
    "by the cosine": lambda r, c: 0.6 * c,
    "by the cosine and the square of the range": lambda r, c: 0.9 * c / r**2,
    "weak near by": lambda r, c: 0.5 * c**0.7 * np.exp(-((np.log(r / 3.0)) ** 2)),
}


def goes_with_paint(prepared):
    """Correlation of the texture with the paint, each wall's less its mean, and the share of surfels that have one."""
    known = np.isfinite(prepared.photometry.intensity) & (prepared.surfels.patch >= 0)
    expected = np.log(paint(prepared.surfels.points[known].astype(float)))
    wall = prepared.surfels.patch[known]
    expected -= (np.bincount(wall, expected) / np.maximum(np.bincount(wall), 1))[wall]
    return np.corrcoef(prepared.photometry.intensity[known], expected)[0, 1], known.mean()


@pytest.mark.parametrize("law", LAWS)
def test_paint_is_left_whatever_the_instrument_makes_of_distance_and_incidence(law):
    agreement, share = goes_with_paint(lit(LAWS[law]))
    assert share > 0.8
    assert agreement > 0.97


def test_surface_seen_head_on_may_glare_and_is_left_out():
    prepared = lit(lambda r, c: np.where(c > np.cos(np.radians(3.0)), 0.95, 0.5 * c))
    cosine = np.abs(np.einsum("ij,ij->i", prepared.surfels.points, prepared.surfels.normals))
    cosine /= np.linalg.norm(prepared.surfels.points, axis=1)
    head_on = prepared.surfels.planar & (cosine > np.cos(np.radians(4.0)))
    assert head_on.sum() > 50
    assert np.isnan(prepared.photometry.intensity[head_on]).all()
    slanted = prepared.surfels.planar & (cosine < np.cos(np.radians(6.0)))
    assert np.isfinite(prepared.photometry.intensity[slanted]).mean() > 0.9


def test_nothing_is_left_without_intensity():
    bare = prepare(room_scan())
    assert np.isnan(less_fall_off(bare.surfels)).all()
    assert np.isnan(bare.photometry.intensity).all()
