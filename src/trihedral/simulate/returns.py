"""What beams bring back, stage by stage: straight or through panes, mixed at edges, from panes themselves."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float32, Float64
from trihedral.simulate.material import MIRRORS, REFLECTANCE
from trihedral.simulate.optics import STEP_M, Path, pane_reflects
from trihedral.simulate.tracer import Tracer, dot


class ReturnKind(IntEnum):
    """How a point came about."""

    DIRECT = 0  # one surface, straight from the scanner
    MIXED = 1  # the footprint lay over an edge: the point may float between surfaces
    THROUGH_GLASS = 2  # a surface behind glass
    GLASS = 3  # the pane itself
    GHOST = 4  # seen in a mirror or in a pane: there is nothing at this place


@dataclass(frozen=True)
class Returns:
    """What (N,) beams bring back."""

    #: (N,) int32 face that sends most back, -1 if nothing does.
    face: NDArray[np.int32]
    #: (N,) along the beam, metres.
    distance: Float64
    #: (N, 3) on that face.
    point: Float64
    #: (N,) of the incidence there.
    cosine: Float64
    #: (N,) of a whole beam's signal that the way there and back leaves, relative to that face's own.
    share: Float64
    #: (N,) uint8 `ReturnKind`.
    kind: NDArray[np.uint8]

    @staticmethod
    def along(path: Path) -> "Returns":
        """Returns of infinitely thin beams."""
        kind = np.where(path.pane >= 0, ReturnKind.THROUGH_GLASS, ReturnKind.DIRECT).astype(np.uint8)
        kind[path.mirrored] = ReturnKind.GHOST
        return Returns(path.face, path.distance, path.point, path.cosine, path.share**2, kind)

    def _columns(self) -> tuple[NDArray[Any], ...]:
        return self.face, self.distance, self.point, self.cosine, self.share, self.kind

    def of(self, chosen: NDArray[Any]) -> "Returns":
        """Those of some beams."""
        return Returns(*(column[chosen] for column in self._columns()))

    def replaced(self, at: NDArray[np.int64], by: "Returns") -> "Returns":
        """With other returns of the beams `at`."""
        columns = [column.copy() for column in self._columns()]
        for column, other in zip(columns, by._columns(), strict=True):
            column[at] = other
        return Returns(*columns)

    def within(self, least: float, most: float) -> NDArray[np.bool_]:
        """Whether there is one, at a range that the instrument measures."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self.face >= 0) & (self.distance >= least) & (self.distance <= most))


@dataclass(frozen=True)
class _PaneHits:
    """The first panes on the way of (M,) beams, and the beams."""

    face: NDArray[np.int32]
    #: (M,) metres to the pane.
    near: Float64
    place: Float64
    beam: Float64
    normal: Float64
    #: (M,) cosine between beam and the pane's normal, signed.
    along: Float64


def strongest_at_panes(
    tracer: Tracer, origins: Float64, beams: Float64, path: Path, behind: Returns, dirt: Float32
) -> Returns:
    """Of a pane's own return, what lies `behind` it and what it mirrors, keep the strongest.

    `dirt` (N,), standard normal, is how dusty the pane is where the beam meets it.
    """
    at = np.flatnonzero(path.pane >= 0)
    if not len(at):
        return behind
    face, start, beam = path.pane[at], origins[at], beams[at]
    near, normal = tracer.range_to(face, start, beam), tracer.planes.normal[face]
    hits = _PaneHits(face, near, start + near[:, None] * beam, beam, normal, dot(beam, normal))
    ghosts, ghost_signal = _ghosts(tracer, hits)
    panes, own_signal = _pane_returns(hits, dirt[at])
    there = behind.of(at)
    rho = REFLECTANCE[tracer.mesh.material[there.face]]
    signal = np.where(there.face >= 0, there.share * rho * there.cosine, 0.0)
    signal = signal / np.where(there.face >= 0, there.distance, 1.0) ** 2
    use_ghost = (ghost_signal > signal) & (ghost_signal > own_signal)
    use_own = (own_signal > signal) & (own_signal >= ghost_signal)
    return behind.replaced(at[use_ghost], ghosts.of(use_ghost)).replaced(at[use_own], panes.of(use_own))


def _ghosts(tracer: Tracer, hits: _PaneHits) -> tuple[Returns, Float64]:
    """What panes mirror, and how strong it is; of mirrors the path has it already."""
    mesh, along = tracer.mesh, hits.along
    reflected = np.where(MIRRORS[mesh.material[hits.face]], 0.0, pane_reflects(np.abs(along)))
    away = hits.beam - 2.0 * along[:, None] * hits.normal
    face, step = tracer.cast(hits.place + STEP_M * away, away)
    met = np.where(face >= 0, step, 1.0)
    cosine = np.abs(dot(away, tracer.planes.normal[face]))
    rho = REFLECTANCE[mesh.material[face]]
    signal = np.where(face >= 0, reflected**2 * rho * cosine / (hits.near + met) ** 2, 0.0)
    point = hits.place + (step + STEP_M)[:, None] * away
    kind = np.full(len(face), ReturnKind.GHOST, np.uint8)
    return Returns(face, hits.near + step + STEP_M, point, cosine, reflected**2, kind), signal


def _pane_returns(hits: _PaneHits, dirt: Float32) -> tuple[Returns, Float64]:
    """What panes send back themselves, and how strong it is."""
    # Dust lies in patches; head-on the pane itself is a mirror that looks back.
    dust = 0.012 * np.exp2(np.rint(1.5 * dirt))
    cosine, n = np.abs(hits.along), len(hits.face)
    steep = np.maximum(0.0, 1.0 - (1.0 - cosine) * 2000.0)
    signal = (dust * cosine + 0.5 * steep) / hits.near**2
    kind = np.full(n, ReturnKind.GLASS, np.uint8)
    return Returns(hits.face, hits.near, hits.place, cosine, np.full(n, 0.3), kind), signal
