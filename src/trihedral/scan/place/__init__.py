"""Where a scanner stood, from the points of its scan.

In: points in any frame. Out: a place with its standard deviation, and whether one place can have seen them all.
"""

from trihedral.scan.place.find import STRANGE, FoundPlace, find_place, off_pattern, pattern_at, second_place
from trihedral.scan.place.occlusion import Hidden, hidden_from

__all__ = [
    "STRANGE",
    "FoundPlace",
    "Hidden",
    "find_place",
    "hidden_from",
    "off_pattern",
    "pattern_at",
    "second_place",
]
