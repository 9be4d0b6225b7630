"""A pair of scans: the pose found between them, what speaks for it, and what may be believed of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from typing import Literal, Self

import numpy as np

from trihedral.geometry.arrays import Float64, Floating
from trihedral.geometry.se3 import adjoint, carried, inverse, motion
from trihedral.model.paper_evidence import PaperEvidence

Method = Literal["icp", "plane-matching", "refinement", "given"]
UserDecision = Literal["forced", "locked", "forbidden"]


class LinkVerdict(StrEnum):
    """What may be believed of a link."""

    ACCEPTED = "accepted"
    AMBIGUOUS = "ambiguous"
    DOUBTFUL = "doubtful"
    REFUSED = "refused"


@dataclass(frozen=True)
class Residuals:
    """Point-to-plane distances over the shared surface, metres. Fit, not accuracy."""

    rmse_m: float
    median_m: float
    p95_m: float
    max_m: float
    p90_m: float | None = None

    @classmethod
    def of(cls, offsets: Floating) -> Self | None:
        """Sum up distances (M,) in metres, of either sign; None where there are none."""
        if not len(offsets):
            return None
        distances = np.abs(offsets, dtype=np.float64)
        median, p90, p95 = (float(value) for value in np.percentile(distances, [50, 90, 95]))
        return cls(float(np.sqrt(np.mean(distances**2))), median, p95, float(distances.max()), p90)


@dataclass(frozen=True)
class WeakestDirection:
    """The translation that a pose knows least: unit axis in the frame it leads to, and its sigma."""

    axis: tuple[float, float, float]
    sigma_m: float


@dataclass(frozen=True)
class PoseEstimate:
    """A pose ``b_from_a`` and how well the data know it."""

    #: (4, 4) between scanner-centred frames while a pair is worked on, between station coordinates in its result.
    transform: Float64
    #: (6, 6) of ``(omega, v)`` on the left, about the scanner of `b`; None where the pose was not refined.
    covariance: Float64 | None = None
    residuals: Residuals | None = None
    #: Mean square of the offsets over their variances; above 1 where surfaces differ by more than their noise.
    chi_square: float | None = None
    #: Surfels whose offsets were taken.
    compared: int | None = None

    @property
    def weakest_direction(self) -> WeakestDirection | None:
        """The translation that the pair knows least."""
        if self.covariance is None:
            return None
        variances, axes = np.linalg.eigh(self.covariance[3:, 3:])
        return WeakestDirection((axes[0, 2], axes[1, 2], axes[2, 2]), float(np.sqrt(variances[2])))

    @property
    def weakest_rotation(self) -> float | None:
        """One sigma (rad) of the rotation about the axis that the pair knows least."""
        if self.covariance is None:
            return None
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[2]))

    def inverted(self, a_origin: Float64, b_origin: Float64) -> Self:
        """Give the pose ``a_from_b``; scanners stand at these (3,) places of the frames."""
        centred = motion(None, -b_origin) @ self.transform @ motion(None, a_origin)
        back = inverse(centred)
        turned = None if self.covariance is None else carried(adjoint(back), self.covariance)
        return replace(self, transform=inverse(self.transform), covariance=turned)


@dataclass(frozen=True)
class LinkEvidence:
    """What speaks for a pose and against it: the surface of both stations compared under it.

    Shares are of a station's surface, or of what was compared of it; of two stations the one that is worse off.
    """

    #: Surface that holds the pose, less believable the more surface is in conflict.
    score: float
    #: Surface that holds the pose, evenly of all facings, of the station that has less; mean share of both.
    held_area_m2: float
    holding: float
    #: Share of the static structure in space that the other scanner saw through.
    solid_conflict: float
    #: Blocks of space, of both stations, in which surface agrees, and in which the other scanner saw through it: of
    #: planar patches that furniture may have, and of no patch.
    patch_blocks: tuple[float, float]
    loose_blocks: tuple[float, float]
    #: Share of the surface of no patch that agrees and is off by more than noise explains.
    misfit: float
    #: Noise of the surfaces over the pose's sigma in its weakest direction: how many times over they hold it; None
    #: where the covariance is not known.
    redundancy: float | None
    free_space_conflict: float
    overlap_from: float
    overlap_to: float
    #: Of surfaces that agree in shape: about 1 for the same, 0 for others; None where nothing can be said.
    appearance_similarity: float | None
    #: What is asked of it.
    least_similarity: float
    #: Whether it is of intensity only, whose law may change from scan to scan.
    by_intensity: bool
    #: Whether both scans may have a ceiling above them.
    enclosed: bool
    #: Small cells of surface that agree in shape whose colours were compared, and those of them that look different.
    cells_compared: int = 0
    cells_different: int = 0
    #: That the pose is right, one of all that the pair offers or none of them.
    probability: float | None = None
    #: Whether more surface stands where the other scan saw empty space than what moves about explains.
    contradicted: bool = False

    @property
    def unseen(self) -> bool:
        """Whether the scans are of rooms, which have copies, and nothing is known of their appearance."""
        return self.enclosed and self.appearance_similarity is None

    @property
    def strange(self) -> bool:
        """Whether surfaces under a ceiling that agree in shape do not look the same; outdoors shadows move."""
        similarity = self.appearance_similarity
        return self.enclosed and similarity is not None and similarity < self.least_similarity


@dataclass(frozen=True, kw_only=True)
class PairResult:
    """The outcome of one pair, whatever its scans are called; poses ``b_from_a`` between station coordinates."""

    verdict: LinkVerdict
    #: Why it is not accepted; None when it is.
    reason: str | None = None
    method: Method | None = None
    #: The pose; None where none was found.
    estimate: PoseEstimate | None = None
    #: The pose before the final alignment.
    initial_transform: Float64 | None = None
    #: Share of each station's surface that the other saw too, under the pose.
    overlap_from: float | None = None
    overlap_to: float | None = None
    #: Share of the compared surface that lies in space seen through, under the pose.
    free_space_conflict: float | None = None
    #: Score of the best other pose over that of this one.
    runner_up: float | None = None
    #: Other poses that explain the data nearly as well; loops may choose among those with a covariance.
    alternatives: tuple[PoseEstimate, ...] = ()
    #: Poses that were compared.
    hypotheses: int | None = None
    evidence: LinkEvidence | None = None
    #: What the steps of the paper's method found.
    paper: PaperEvidence | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)

    def inverted(self, a_origin: Float64, b_origin: Float64) -> Self:
        """Give the result of the pair the other way about; scanners stand at these (3,) places of the frames."""

        def turned(estimate: PoseEstimate) -> PoseEstimate:
            return estimate.inverted(a_origin, b_origin)

        evidence = self.evidence
        if evidence is not None:
            evidence = replace(evidence, overlap_from=evidence.overlap_to, overlap_to=evidence.overlap_from)
        return replace(
            self,
            estimate=None if self.estimate is None else turned(self.estimate),
            initial_transform=None if self.initial_transform is None else inverse(self.initial_transform),
            overlap_from=self.overlap_to,
            overlap_to=self.overlap_from,
            alternatives=tuple(turned(rival) for rival in self.alternatives),
            evidence=evidence,
        )

    @property
    def accepted(self) -> bool:
        """Whether the network may use it."""
        return self.verdict is LinkVerdict.ACCEPTED

    @property
    def transform(self) -> Float64 | None:
        """``b_from_a``, 4x4."""
        return None if self.estimate is None else self.estimate.transform

    @property
    def covariance(self) -> Float64 | None:
        """Of `transform`, 6x6."""
        return None if self.estimate is None else self.estimate.covariance

    @property
    def score(self) -> float:
        """That of the evidence; 0 where there is none."""
        return 0.0 if self.evidence is None else self.evidence.score

    @property
    def appearance_similarity(self) -> float | None:
        """That of the evidence; None where nothing is known."""
        return None if self.evidence is None else self.evidence.appearance_similarity

    @property
    def unseen(self) -> bool:
        """Whether the scans are of rooms, which have copies, and nothing is known of their appearance."""
        return self.evidence is not None and self.evidence.unseen

    @property
    def looks_alike(self) -> bool:
        """Whether the scans are of rooms, which have copies, and surfaces that agree in shape look the same."""
        found = self.evidence
        return found is not None and found.enclosed and not found.unseen and not found.strange

    @property
    def contradicted(self) -> bool:
        """Whether more stands where the other scan saw empty space than what moves about explains."""
        return self.evidence is not None and self.evidence.contradicted


@dataclass(frozen=True, kw_only=True)
class Link(PairResult):
    """The result of a pair with the names of its ends: `a` is `from_station`, `b` is `to_station`."""

    from_station: str
    to_station: str
    #: Why the pair was chosen among all.
    tried_because: str | None = None
    #: What a person decided of it.
    decision: UserDecision | None = None
    #: Whether it is accepted only because other links agree with it.
    confirmed_by_loops: bool = False

    @classmethod
    def named(
        cls, result: PairResult, from_station: str, to_station: str, because: str | None = None
    ) -> Self:
        """Give a result its names."""
        values = {f.name: getattr(result, f.name) for f in fields(PairResult)}
        return cls(from_station=from_station, to_station=to_station, tried_because=because, **values)
