"""Whether a scan can have been seen from where its scanner is said to be, and from where else if not."""

import dataclasses

import numpy as np

from trihedral.errors import InputError
from trihedral.geometry.arrays import Float64
from trihedral.io.options import ReadOptions
from trihedral.scan import Scan
from trihedral.scan.place import (
    STRANGE,
    FoundPlace,
    Hidden,
    find_place,
    hidden_from,
    off_pattern,
    pattern_at,
    second_place,
)
from trihedral.scan.scan import seen_from

# A median range beyond this (metres) is no terrestrial scan: the coordinates are in other units, or the
# scanner is not where it is taken to be.
LARGEST_MEDIAN_RANGE = 1000.0
# So many points, evenly spaced in the file, tell the median range.
_SAMPLE = 100_000
# Fewer points tell nothing of where they were seen from.
_LEAST_POINTS = 3000
# Share of surface behind what is opaque: foliage, edges and thinning leave up to 0.0007; a scan with more than the
# first is looked at closely, one with more than the second was not seen from there.
_DOUBTFUL, _REFUSED = 0.0005, 0.0025
# The same share, of a place that the user states: a person vouches for it.
_REFUSED_STATED = 0.005
# Nor was one of which more than this share is behind anything: glass leaves up to 0.1.
_MOST_HIDDEN = 0.5
# Metres; the pattern of directions bears a place out that is this near to where it leads, beside its sigmas.
_SAME_PLACE = 0.005
_TRIED = "the density of its points and the pattern of their directions were tried"
_STATE = "State it with --scanner-origin X,Y,Z (metres; 0,0,0 if it really is there) or a table of files"


def placed(scan: Scan, options: ReadOptions) -> Scan:
    """Give the scan with its scanner where the points were seen from.

    A position that the user states stands. One that a file states is doubted where surfaces hide points from it; one
    that nothing states is held against the pattern of directions, and replaced by where that leads.

    Raises
    ------
    InputError
        Units or position must be stated; or no one place can have seen all points: several scans in one, or a moving
        scanner.
    """
    header = scan.header
    stated = options.origin_of(header.source, header.scan_index) is not None
    if not len(scan) or header.format == "rig":
        return scan
    _check_units(scan, options, stated)
    outside, diagonal = _outside(scan)
    far = outside > (LARGEST_MEDIAN_RANGE if header.origin_stated else diagonal)
    # E57's frame is the scanner's by the standard, unless its coordinates are those of a project.
    unknown = far and (header.format != "e57" or outside > LARGEST_MEDIAN_RANGE)
    if len(scan) < _LEAST_POINTS:
        if unknown and not stated:
            raise _unknown(scan, f"that is {outside:,.1f} m outside points that span {diagonal:,.1f} m", "")
        return scan
    search = _Search(scan)
    hidden = Hidden(1.0, 1.0) if far else search.hidden(search.claimed)
    if stated:
        if not far and _impossible(hidden, _REFUSED_STATED):
            raise _hides(scan, hidden)
        return scan
    found = search.place(doubtful=far or hidden.opaque > _DOUBTFUL, far=far)
    if found is not None:
        return search.seen_from(found)
    if unknown:
        reason = f"that is {outside:,.1f} m outside points that span {diagonal:,.1f} m"
        raise _unknown(scan, reason, _TRIED)
    hidden = search.hidden(search.claimed) if far else hidden
    if _impossible(hidden):
        raise _hides(scan, hidden)
    return scan


def _impossible(hidden: Hidden, most: float = _REFUSED) -> bool:
    return hidden.opaque > most or hidden.share > _MOST_HIDDEN


class _Search:
    """The points of a scan, and what they tell of its scanner's place; coordinates less the local origin."""

    def __init__(self, scan: Scan) -> None:
        self._scan = scan
        self._points = scan.xyz.astype(np.float64)
        self.claimed: Float64 = scan.header.scanner_origin - scan.local_origin

    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(len(self._points))

    def hidden(self, place: Float64) -> Hidden:
        return hidden_from(self._points, place, self._rng())

    def place(self, *, doubtful: bool, far: bool) -> FoundPlace | None:
        """Where the pattern of directions leads; None where it need not be asked or says nothing."""
        header = self._scan.header
        moved = header.file_pose is not None and not np.allclose(header.file_pose, np.eye(4))
        said = header.origin_stated and (moved or header.grid is not None or header.format != "e57")
        if said and not doubtful:
            return None
        found = None if far else pattern_at(self._points, self.claimed, self._rng())
        return found or find_place(self._points, self._rng())

    def seen_from(self, found: FoundPlace) -> Scan:
        """The scan with that place, or an error where part of it was seen from another."""
        scan = self._scan
        other = second_place(self._points, found, self._rng())
        hidden = self.hidden(found.place)
        # Mirrors put surfaces behind walls, where the pattern has them still.
        strange = off_pattern(self._points, found).mean() > STRANGE
        if other is not None or (strange and _impossible(hidden)):
            raise _several(scan, found, other, hidden)
        sigma = (float(found.sigma[0]), float(found.sigma[1]), float(found.sigma[2]))
        same = np.abs(found.place - self.claimed) < 3.0 * found.sigma + _SAME_PLACE
        if same.all():
            if scan.header.origin_stated:
                return scan
            return dataclasses.replace(scan, header=seen_from(scan.header, scan.header.scanner_origin, sigma))
        place = found.place + scan.local_origin
        return dataclasses.replace(scan, header=seen_from(scan.header, place, sigma))


def _check_units(scan: Scan, options: ReadOptions, stated: bool) -> None:
    """Refuse units that cannot be right where the user has not stated them."""
    header = scan.header
    known = options.units is not None or header.format == "e57"
    step = -(-len(scan) // _SAMPLE)
    points = scan.xyz[::step].astype(np.float64)
    # Points that nobody says where they were seen from may lie anywhere; their own extent tells.
    centre = header.scanner_origin - scan.local_origin if stated else np.median(points, axis=0)
    median = float(np.median(np.linalg.norm(points - centre, axis=1)))
    if median <= LARGEST_MEDIAN_RANGE or (stated and known):
        return
    missing = [
        "" if known else "--units (mm, cm, ft, us-ft, or m if they are metres)",
        "" if stated else "--scanner-origin X,Y,Z (metres; 0,0,0 if it is there)",
    ]
    place = "the scanner" if stated else "their middle"
    metres = "m" if header.units_stated else "assumed metres"
    raise InputError(
        header.source,
        f"half of the points are further than {median:,.0f} {metres} "
        f"from {place}: units or scanner origin are not what they seem",
        place=header.place,
        advice="State " + " and ".join(filter(None, missing)),
    )


def _outside(scan: Scan) -> tuple[float, float]:
    """How far the scanner is outside the points' bounding box, and the box's diagonal, metres."""
    origin = scan.header.scanner_origin - scan.local_origin
    # Column by column: NumPy reduces (N, 3) along N ten times slower.
    low = np.array([scan.xyz[:, axis].min() for axis in range(3)])
    high = np.array([scan.xyz[:, axis].max() for axis in range(3)])
    outside = float(np.linalg.norm(np.maximum(np.maximum(low - origin, origin - high), 0.0)))
    return outside, float(np.linalg.norm(high - low))


def _unknown(scan: Scan, why: str, tried: str) -> InputError:
    claimed = ", ".join(f"{value:g}" for value in scan.header.scanner_origin)
    found = f"; its points do not tell where it stood ({tried})" if tried else ""
    return InputError(
        scan.header.source,
        f"the file does not say where the scanner stood, and it cannot be at ({claimed}): {why}{found}",
        place=scan.header.place,
        advice=_STATE + ("" if scan.header.format == "e57" else ", or --units if they are not metres"),
    )


def _hides(scan: Scan, hidden: Hidden) -> InputError:
    header = scan.header
    claimed = ", ".join(f"{value:g}" for value in header.scanner_origin)
    return InputError(
        header.source,
        f"no scanner at ({claimed}) saw these points: {hidden.share:.1%} of them lie behind surfaces of the same scan. "
        f"It is several scans in one, was taken by a moving scanner, or the scanner stood elsewhere ({_TRIED})",
        place=header.place,
        advice="Export each station as a scan of its own; if it is one, state where the scanner stood with "
        "--scanner-origin X,Y,Z or a table of files",
    )


def _several(scan: Scan, found: FoundPlace, other: FoundPlace | None, hidden: Hidden) -> InputError:
    def at(place: FoundPlace) -> str:
        return "(" + ", ".join(f"{value:.3f}" for value in place.place + scan.local_origin) + ")"

    if other is not None:
        why = f"some of its points were seen from {at(found)}, others from {at(other)}"
    else:
        why = f"seen from {at(found)}, {hidden.share:.1%} of its points lie behind others"
    return InputError(
        scan.header.source,
        f"it is no single scan but several in one: {why}",
        place=scan.header.place,
        advice="Export each station as a scan of its own; if it is one, state where the scanner stood with "
        "--scanner-origin X,Y,Z or a table of files",
    )
