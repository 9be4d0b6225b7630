"""What a prepared scan keeps for hypotheses, found once while its points are at hand."""

from dataclasses import replace
from typing import Any

from trihedral.fusion.surroundings import surroundings
from trihedral.initial.hypotheses import HypothesisOptions
from trihedral.initial.viewed import viewed_keypoints
from trihedral.scan.prepared import Prepared
from trihedral.scan.scan import Scan


def described(prepared: Prepared, scan: Scan, options: HypothesisOptions | None = None) -> Prepared:
    """The prepared scan with what the sources of hypotheses need; without colour and intensity it has no keypoints."""
    options = options or HypothesisOptions()
    found: dict[str, Any] = {}
    if "views" in options.sources:
        seen = surroundings(scan, options.surroundings)
        if seen is not None:
            found |= viewed_keypoints(seen, options.views)
    return replace(prepared, **found)
