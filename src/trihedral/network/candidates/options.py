"""How many pairs are tried."""

from dataclasses import dataclass

from trihedral.errors import OptionError


@dataclass(frozen=True)
class CandidateOptions:
    """How many pairs are tried; similarities of plans are in standard deviations."""

    #: Scans of a job up to which every pair is tried; in larger ones pairs are chosen.
    all_pairs_up_to: int = 10
    #: Most similar scans that each scan is previewed with.
    first_previews: int = 4
    #: Previews a round of a component that nothing ties to the largest.
    more_previews: int = 12
    #: Previews in vain of a component with one scan; each further scan adds one.
    most_previews: int = 120
    #: Similarity that a preview in vain between two components takes from all pairs between them.
    vain_preview: float = 0.1
    #: Similarity below which no pair of a component of several scans is previewed.
    least_promise: float = -0.3
    #: Previews in vain between components before that holds: a job of twenty scans tries every pair.
    patience: int = 200
    #: Similarity that a preview in vain takes from pairs of either scan, for their order alone (docs/projects.md).
    vain_preview_of_scan: float = 0.2
    #: Score of a preview for the pair to be registered.
    least_score: float = 0.04
    #: Appearance similarity of a preview for the pair to be registered.
    least_similarity: float = 0.5
    #: Accepted links that a scan should have.
    links: int = 3
    #: Share of walls that meet, under the poses so far, for a pair to be registered.
    least_expected: float = 0.25
    #: The same across a single link that holds two components together: plans end where scanners see on.
    least_across: float = 0.1
    #: Pairs registered in vain across such a link.
    most_vain: int = 4
    #: Pairs by which a doubtful link between two components is tested, of those that it puts beside each other ...
    tests: int = 2
    #: ... and how many of these are compared, the nearest first.
    tested_of: int = 40
    #: Pairs registered all the same of a scan that nothing ties.
    last_tries: int = 2
    #: Added to the similarity of scans that follow each other by name.
    neighbour_bonus: float = 0.1

    def __post_init__(self) -> None:
        counts = (self.first_previews, self.more_previews, self.most_previews, self.links)
        if min(counts) < 1 or min(self.all_pairs_up_to, self.last_tries) < 0:
            raise OptionError("numbers of previews and links must be at least 1, and none may be negative")
