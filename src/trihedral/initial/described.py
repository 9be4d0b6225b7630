"""What a prepared scan keeps for hypotheses, found once while its points are at hand."""

from dataclasses import replace
from typing import Any

from trihedral.fusion.surroundings import surroundings
from trihedral.initial.corners import find_corners
from trihedral.initial.facets import find_facets
from trihedral.initial.hypotheses import HypothesisOptions
from trihedral.initial.rectified import rectified_keypoints
from trihedral.initial.shape import shape_descriptors
from trihedral.initial.viewed import viewed_keypoints
from trihedral.scan.prepared import Prepared
from trihedral.scan.scan import Scan


def described(prepared: Prepared, scan: Scan, options: HypothesisOptions | None = None) -> Prepared:
    """The prepared scan with what the sources of hypotheses need; without colour and intensity it has no keypoints."""
    options = options or HypothesisOptions()
    found: dict[str, Any] = {}
    pictured = {"views", "rectified"} & set(options.sources)
    seen = surroundings(scan, options.surroundings) if pictured else None
    if seen is not None and "views" in options.sources:
        found |= viewed_keypoints(seen, options.views)
    if seen is not None and "rectified" in options.sources:
        found |= rectified_keypoints(prepared, seen, options.rectified)
    if not {"rectified", "corners"}.isdisjoint(options.sources):
        facets, elements = find_facets(prepared)
        found |= facets
        if "corners" in options.sources:
            found |= find_corners(replace(prepared, **found), elements, options.corners)
    if "shape" in options.sources:
        found |= shape_descriptors(prepared, options.shape)
    return replace(prepared, **found)
