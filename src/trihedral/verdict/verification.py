"""The right pose among many: compared, refined and compared again in rounds of shrinking tolerance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.final.point_to_plane import refine_coarsely
from trihedral.geometry.distinct import distinct
from trihedral.scan.prepared import Prepared
from trihedral.verdict.agreement import Agreement, compare

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Round:
    """One round of a selection: poses are compared, the best are kept and refined; lengths in metres."""

    keep: int  # distinct poses by each score
    offset: float  # within which two surfaces are one: poses may be off by so much
    margin: float  # before a surface, from which space counts as seen through
    compared: int  # elements of each station
    # Towards shares of conflict, which a pose that is off has some of. These scores fill up with poses under which much
    # surface is shared and much contradicts ...
    leniencies: tuple[float, ...]
    # ... and those that set so much agreeing against conflicting surface keep poses under which little is shared.
    prices: tuple[float, ...]
    reaches: tuple[float, ...]  # of the refinement
    refined: int  # elements of each station that the refinement uses


@dataclass(frozen=True)
class SelectionOptions:
    """How the right pose is told from the other hypotheses; lengths in metres."""

    hypotheses: int = 600  # of all sources, screened
    rounds: tuple[Round, ...] = (
        Round(
            30,
            offset=0.5,
            margin=0.5,
            compared=400,
            leniencies=(10,),
            prices=(1, 3),
            reaches=(0.6,),
            refined=400,
        ),
        Round(
            12,
            offset=0.4,
            margin=0.4,
            compared=500,
            leniencies=(5,),
            prices=(1, 3),
            reaches=(0.4,),
            refined=600,
        ),
        Round(
            6,
            offset=0.3,
            margin=0.3,
            compared=800,
            leniencies=(3, 1),
            prices=(2,),
            reaches=(0.25,),
            refined=800,
        ),
        Round(
            4,
            offset=0.15,
            margin=0.2,
            compared=1500,
            leniencies=(1,),
            prices=(),
            reaches=(0.15, 0.07),
            refined=2000,
        ),
    )
    fine_offset: float = 0.05  # tolerance of the last comparison, and of the overlap that is stated
    fine_margin: float = 0.1
    distinct_translation: float = 0.3  # two poses nearer than this, and than the angle, are one
    distinct_rotation: float = np.radians(3.0)  # radians


def select(
    a: Prepared, b: Prepared, proposed: Sequence[Float64], options: SelectionOptions
) -> list[tuple[Float64, float]]:
    """Distinct poses that both scanners bear out, with their scores, best first: screened, refined, compared again."""
    poses = list(proposed)
    for step in options.rounds:
        if not poses:
            return []
        seen = compare(a, b, poses, offset=step.offset, margin=step.margin, samples=step.compared)
        ranked = [seen.score(leniency) for leniency in step.leniencies]
        ranked += [seen.balance(price) for price in step.prices]
        kept = [_distinct(poses, score, options, step.keep) for score in ranked]
        poses = list({id(pose): pose for some in kept for pose in some}.values())
        # Few elements of a small overlap can lead astray: a pose that was nearer before stays in the race.
        poses += refine_coarsely(a, b, poses, step.reaches, step.refined)
    score = compared_closely(a, b, poses, options, samples=4000).score()
    score_of = {id(pose): float(value) for pose, value in zip(poses, score, strict=True)}
    distinct = _distinct(poses, score, options, len(poses))
    return [(pose, score_of[id(pose)]) for pose in distinct if score_of[id(pose)] > 0]


def compared_closely(
    a: Prepared, b: Prepared, poses: Sequence[Float64], options: SelectionOptions, samples: int = 20_000
) -> Agreement:
    """Compare refined poses at the tolerance that overlap is stated with."""
    return compare(a, b, poses, offset=options.fine_offset, margin=options.fine_margin, samples=samples)


def _distinct(
    poses: Sequence[Float64], scores: Float64, options: SelectionOptions, count: int
) -> list[Float64]:
    """The best poses, at most `count`, best first; of poses near each other the best one."""
    kept = distinct(
        np.array(poses),
        np.argsort(-scores, kind="stable"),
        translation=options.distinct_translation,
        rotation=options.distinct_rotation,
        count=count,
    )
    return [poses[index] for index in kept]
