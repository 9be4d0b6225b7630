"""Registers terrestrial laser scans without targets and says how far each pose may be trusted.

import trihedral

result = trihedral.register(["a.e57", "b.e57"])
result.stations["a"].pose  # 4x4, project_from_station
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trihedral.api import Result, register
    from trihedral.errors import InputError, OptionError, OutputError, TrihedralError
    from trihedral.io import ReadOptions
    from trihedral.pipeline import Options
    from trihedral.version import VERSION as __version__  # noqa: N811

__all__ = [
    "InputError",
    "OptionError",
    "Options",
    "OutputError",
    "ReadOptions",
    "Result",
    "TrihedralError",
    "__version__",
    "register",
]

# Where each name lives; loaded when first used, so that the command line's help does not wait for NumPy.
_HOME = {
    "InputError": "errors",
    "OptionError": "errors",
    "Options": "pipeline",
    "OutputError": "errors",
    "ReadOptions": "io",
    "Result": "api",
    "TrihedralError": "errors",
    "register": "api",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.import_module("trihedral.version").VERSION
    if name in _HOME:
        return getattr(importlib.import_module(f"trihedral.{_HOME[name]}"), name)
    raise AttributeError(f"module 'trihedral' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
