"""Several distinct poses for a pair of scans: what the selection chooses from."""

from dataclasses import dataclass, field

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.geometry.distinct import distinct
from trihedral.initial.plan.proposals import PlanOptions, plan_poses
from trihedral.scan.prepared import Prepared

# Poses this near to each other (m, rad) are one.
SAME_TRANSLATION = 0.1
SAME_ROTATION = np.radians(1.0)


@dataclass(frozen=True)
class HypothesisOptions:
    """Where poses come from."""

    #: From plans of walls and things, laid on each other.
    plan: PlanOptions = field(default_factory=PlanOptions)


def propose(a: Prepared, b: Prepared, options: HypothesisOptions | None = None) -> list[Float64]:
    """Distinct poses ``b_from_a`` in scanner-centred coordinates, those of the plans that go together best first."""
    options = options or HypothesisOptions()
    if not len(a.surfel_map) or not len(b.surfel_map):
        return []
    poses = np.array([pose for pose, _ in plan_poses(a, b, options.plan)]).reshape(-1, 4, 4)
    kept = distinct(poses, range(len(poses)), translation=SAME_TRANSLATION, rotation=SAME_ROTATION)
    return [poses[index] for index in kept]
