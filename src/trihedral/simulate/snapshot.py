"""A scene at the moment of one scan: who has moved where."""

import math
from dataclasses import dataclass

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.simulate.mesh import Rng, joined
from trihedral.simulate.scene import Light, Scene
from trihedral.simulate.tracer import Tracer


@dataclass(frozen=True)
class Snapshot:
    """A scene while one station measures it."""

    tracer: Tracer
    #: The mesh's first so many faces stand still.
    fixed_faces: int
    light: Light
    #: Whether the sun casts some; a lamp indoors stands for many and casts none.
    shadows: bool = False


def with_movers(scene: Scene, still: Tracer, head: Float64, clearance: float, draws: int, rng: Rng) -> Tracer:
    """Put the movers of a scene where they are during one scan; `still` is the scene without them.

    A mover nearer than `clearance` to the scanner's `head` (3,), project frame, is drawn anew, `draws` times at most.
    """
    moved = []
    for number, mover in enumerate(scene.movers):
        for _ in range(draws):
            pose = mover.place(rng)
            if pose is None:
                break
            mesh = mover.mesh.placed(pose, texture=number + 1)
            low, high = mesh.bounds()
            if math.hypot(*np.maximum(0.0, np.maximum(low - head, head - high))) > clearance:
                moved.append(mesh)
                break
    return Tracer(joined([scene.mesh, *moved])) if moved else still
