"""Which pairs are asked for, and what came of those so far."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from trihedral.model.link import Link


@dataclass(frozen=True)
class PairPreview:
    """What a preview of a pair found: enough to say whether it is worth registering."""

    #: Of the best pose, as in a link's evidence; 0 where there is none.
    score: float
    #: Of the surfaces that meet under it; None where nothing can be said.
    appearance_similarity: float | None
    seconds: float


@dataclass(frozen=True)
class PairRequest:
    """A pair to register, or only to preview; `because` is for the person who reads the result."""

    a: str
    b: str
    because: str
    preview_only: bool = False


@dataclass(frozen=True)
class PairHistory:
    """What is known of pairs so far, by the names of their ends."""

    links: Sequence[Link]
    previews: Mapping[tuple[str, str], PairPreview]


@dataclass(frozen=True)
class PassedOver:
    """Why pairs were not registered, once nothing more is asked for."""

    #: Reasons by the names of the ends.
    previewed: Mapping[tuple[str, str], str] = field(default_factory=dict)
    #: How many pairs were neither previewed nor registered, by the rule that left them out.
    never: Mapping[str, int] = field(default_factory=dict)
