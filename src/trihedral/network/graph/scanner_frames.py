"""Poses between the coordinates of stations and frames centred on their scanners."""

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import translation
from trihedral.model.station import Station


def between_scanners(pose: Float64, a: Station, b: Station) -> Float64:
    """Take a pose ``b_from_a`` between station coordinates to one between frames centred on the scanners."""
    return translation(-b.header.scanner_origin) @ pose @ translation(a.header.scanner_origin)


def between_stations(pose: Float64, a: Station, b: Station) -> Float64:
    """Undo `between_scanners`."""
    return translation(b.header.scanner_origin) @ pose @ translation(-a.header.scanner_origin)
