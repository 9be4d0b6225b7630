"""Initial alignment of two stations by what their pictures show (step 2 of the paper)."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from trihedral.errors import OptionError
from trihedral.geometry.arrays import Bool, Float64
from trihedral.geometry.se3 import Matrix, transform
from trihedral.initial.visual.features import Features
from trihedral.initial.visual.matching import MatchOptions, match
from trihedral.initial.visual.planar_motion import PlanarMotionOptions, planar_motion
from trihedral.initial.visual.rigid_agreement import RigidAgreement, rigid_agreement

Gate = Literal["planar-motion", "none"]


@dataclass(frozen=True)
class VisualOptions:
    """How matches of pictures become a pose."""

    #: How keypoints are matched.
    match: MatchOptions = field(default_factory=MatchOptions)
    #: What stands before the lifting: Eq. 3, which is the paper's, or nothing.
    gate: Gate = "planar-motion"
    #: How Eq. 3 is sought.
    planar: PlanarMotionOptions = field(default_factory=PlanarMotionOptions)
    #: Picture pairs that are chosen, as in the paper.
    picture_pairs: int = 3
    #: Metres within which two lifted points are one place, beside their pixels' footprint.
    tolerance: float = 0.05
    #: Pixels of either picture, on the surface: a keypoint is not found more exactly.
    tolerance_pixels: float = 2.0
    #: Places that must agree on the motion, or it is not believed.
    least_agreeing: int = 8
    #: Of Eq. 3's samples.
    seed: int = 0

    def __post_init__(self) -> None:
        if self.gate not in ("planar-motion", "none"):
            raise OptionError(f"gate is 'planar-motion' or 'none', not {self.gate!r}")
        if self.tolerance <= 0 or self.tolerance_pixels < 0:
            raise OptionError("tolerance must be positive and tolerance_pixels not negative")
        if self.picture_pairs < 1 or self.least_agreeing < 3:
            raise OptionError("picture_pairs must be at least 1 and least_agreeing at least 3")


@dataclass(frozen=True)
class PicturePair:
    """Matches between a picture of each station, the most distinct first."""

    #: Names of the pictures.
    view_a: str
    view_b: str
    #: (M, 2) x, y.
    pixels_a: Float64
    pixels_b: Float64
    #: (M, 3) metres, each in the coordinates of its `View.points`.
    points_a: Float64
    points_b: Float64
    #: (M,) metres within which the lifted points may differ.
    tolerance: Float64
    #: (M,) of the ratio test.
    ratio: Float64
    #: (M,) the match follows Eq. 3; all true where Eq. 3 was not asked for.
    planar: Bool
    #: (M,) the match follows the pose in 3D; all false where there is none.
    agreeing: Bool

    def __len__(self) -> int:
        return len(self.ratio)


@dataclass(frozen=True)
class VisualAlignment:
    """A pose from pictures, or why there is none, with the evidence."""

    #: 4x4 ``b_from_a`` between the coordinates of the two stations' `View.points`; None where refused.
    pose: Matrix | None
    #: Why there is none, in plain words; or what the reader of a pose should know. Empty where there is nothing.
    reason: str
    #: What the matches that gave the pose had passed: "none" too where Eq. 3 was asked for and led nowhere.
    gate: Gate
    #: The chosen picture pairs, the best first.
    pairs: tuple[PicturePair, ...]
    #: Picture pairs tried, their matches, those of them that follow Eq. 3, and matches of the chosen pairs that follow
    #: the pose.
    picture_pairs: int
    matches: int
    planar: int
    agreeing: int
    #: Metres, of the agreeing matches under the pose: fit, not accuracy. NaN where refused.
    rmse: float


def visual_alignment(
    features_a: Sequence[Features], features_b: Sequence[Features], options: VisualOptions | None = None
) -> VisualAlignment:
    """``b_from_a`` from the pictures of two stations.

    All pictures of one station are matched with all of the other. With the paper's gate, Eq. 3 is fitted to each
    picture pair, the pairs with the most inliers are chosen, and their inliers are lifted; a rigid motion in 3D is
    sought among them and fitted by Kabsch (Eq. 4) to what follows it. Eq. 3 holds for distant scenes only: where its
    inliers agree on no motion, all matches are lifted instead, and the result says so.

    Parameters
    ----------
    features_a, features_b
        `find_features` of each view of the stations, with descriptors of the same kind.
    """
    options = options or VisualOptions()
    rng_seed = np.random.SeedSequence(options.seed)
    pairs: list[PicturePair] = []
    for a in features_a:
        for b in features_b:
            pair = _matched(a, b, options)
            if options.gate == "planar-motion":
                pair = _gated(pair, a, b, options.planar, np.random.default_rng(rng_seed))
            pairs.append(pair)
    if options.gate == "none":
        return _aligned_by_all(pairs, options, "")
    chosen = _best(pairs, [int(pair.planar.sum()) for pair in pairs], options)
    found = _agreement(chosen, options, planar_only=True)
    if isinstance(found, RigidAgreement):
        return _alignment(found.pose, "", "planar-motion", chosen, pairs)
    return _aligned_by_all(
        pairs, options, f"Matches that follow Eq. 3 gave no pose ({found}); all matches were used"
    )


def _matched(a: Features, b: Features, options: VisualOptions) -> PicturePair:
    found = match(a.descriptors, b.descriptors, options.match, signs=(a.sign, b.sign))
    pixels = options.tolerance_pixels * np.maximum(a.footprint[found.a], b.footprint[found.b])
    return PicturePair(
        a.view,
        b.view,
        a.pixels[found.a],
        b.pixels[found.b],
        a.points[found.a],
        b.points[found.b],
        np.hypot(options.tolerance, pixels),
        found.ratio,
        planar=np.ones(len(found), dtype=bool),
        agreeing=np.zeros(len(found), dtype=bool),
    )


def _gated(
    pair: PicturePair, a: Features, b: Features, options: PlanarMotionOptions, rng: np.random.Generator
) -> PicturePair:
    tolerance = options.tolerance * max(float(np.hypot(*a.size)), float(np.hypot(*b.size)))
    found = planar_motion(pair.pixels_a, pair.pixels_b, tolerance, options.samples, rng)
    planar = np.zeros(len(pair), dtype=bool) if found is None else found.inliers
    return replace(pair, planar=planar)


def _best(pairs: list[PicturePair], counts: list[int], options: VisualOptions) -> list[PicturePair]:
    order = sorted(range(len(pairs)), key=lambda k: -counts[k])
    return [pairs[k] for k in order[: options.picture_pairs] if counts[k] > 0]


def _aligned_by_all(pairs: list[PicturePair], options: VisualOptions, note: str) -> VisualAlignment:
    """Without Eq. 3: the pose that all matches agree on, shown on the pairs that agree most."""
    found = _agreement(pairs, options, planar_only=False)
    if isinstance(found, str):
        reason = f"{note}; {found}" if note else found
        chosen = _best(pairs, [len(pair) for pair in pairs], options)
        return _alignment(None, f"{reason}.", "none", chosen, pairs)
    counts = [int(_follows(pair, found.pose).sum()) for pair in pairs]
    return _alignment(found.pose, f"{note}." if note else "", "none", _best(pairs, counts, options), pairs)


def _agreement(pairs: list[PicturePair], options: VisualOptions, planar_only: bool) -> RigidAgreement | str:
    """The motion of the lifted matches, or why there is none."""
    kept = [pair.planar if planar_only else np.ones(len(pair), dtype=bool) for pair in pairs]
    total = sum(int(k.sum()) for k in kept)
    if total < options.least_agreeing:
        return f"the pictures have {total} matches, and {options.least_agreeing} are needed"
    order = np.argsort(np.concatenate([p.ratio[k] for p, k in zip(pairs, kept, strict=True)]), kind="stable")
    a, b = (
        np.concatenate([getattr(p, name)[k] for p, k in zip(pairs, kept, strict=True)])[order]
        for name in ("points_a", "points_b")
    )
    tolerance = np.concatenate([p.tolerance[k] for p, k in zip(pairs, kept, strict=True)])[order]
    pair = np.repeat(np.arange(len(pairs)), [int(k.sum()) for k in kept])[order]
    found = rigid_agreement(a, b, tolerance, pair)
    if found is None:
        return f"no three of the {total} matches agree in 3D"
    places = _places(a[found.inliers], tolerance[found.inliers])
    if places < options.least_agreeing:
        return f"only {places} places of the {total} matches agree in 3D, and {options.least_agreeing} are needed"
    return found


def _places(points: Float64, tolerance: Float64) -> int:
    """Points that are apart from each other: a keypoint with two angles, or one seen in two pictures, counts once."""
    places: list[int] = []
    for k, point in enumerate(points):
        if all(np.linalg.norm(point - points[other]) > tolerance[k] for other in places):
            places.append(k)
    return len(places)


def _follows(pair: PicturePair, pose: Matrix) -> Bool:
    return _offsets(pair, pose) <= pair.tolerance


def _offsets(pair: PicturePair, pose: Matrix) -> Float64:
    offsets: Float64 = np.linalg.norm(transform(pose, pair.points_a) - pair.points_b, axis=1)
    return offsets


def _alignment(
    pose: Matrix | None, reason: str, gate: Gate, chosen: list[PicturePair], pairs: list[PicturePair]
) -> VisualAlignment:
    rmse = float("nan")
    if pose is not None:
        chosen = [
            replace(p, agreeing=_follows(p, pose) & (p.planar if gate == "planar-motion" else True))
            for p in chosen
        ]
        squares = np.concatenate([_offsets(pair, pose)[pair.agreeing] ** 2 for pair in chosen])
        rmse = float(np.sqrt(squares.mean()))
    return VisualAlignment(
        pose,
        reason,
        gate,
        tuple(chosen),
        len(pairs),
        sum(len(pair) for pair in pairs),
        sum(int(pair.planar.sum()) for pair in pairs) if gate == "planar-motion" or pose is None else 0,
        sum(int(pair.agreeing.sum()) for pair in chosen),
        rmse,
    )
