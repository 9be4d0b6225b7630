"""Results of pairs as JSON text, and back: what a job keeps of them, and what workers send."""

import json
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.model.link import PairResult

if TYPE_CHECKING:
    from cattrs import Converter


def to_text(result: PairResult) -> str:
    """Write the result of a pair; numbers keep their last bit."""
    return json.dumps(_converter().unstructure(result))


def from_text(text: str) -> PairResult:
    """Undo `to_text`.

    Raises
    ------
    Exception
        The text is of another program: whatever is wrong with it, the pair is registered again.
    """
    result: PairResult = _converter().structure(json.loads(text), PairResult)
    return result


@cache
def _converter() -> "Converter":
    from cattrs import Converter  # here: it takes as long to import as half of the command's help

    converter = Converter()
    converter.register_unstructure_hook_func(lambda kind: kind == Float64, lambda matrix: matrix.tolist())
    converter.register_structure_hook_func(
        lambda kind: kind == Float64, lambda rows, _: np.array(rows, dtype=np.float64)
    )
    return converter
