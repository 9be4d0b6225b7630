"""Types of the Rust module: arrays in, arrays out."""

from pathlib import Path
from typing import Any

__version__: str

class FileFormatError(ValueError):
    """A file that cannot be used: (place, reason)."""

def pcd_header(path: Path) -> dict[str, Any]: ...
def pcd_read(path: Path, metres_per_unit: float) -> dict[str, Any]: ...
