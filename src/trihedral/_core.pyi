"""Types of the Rust module: arrays in, arrays out."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__version__: str

class FileFormatError(ValueError):
    """A file that cannot be used: (place, reason)."""

class PtxScan:
    columns: int
    rows: int
    structured: bool
    position: list[float]
    matrix: list[list[float]]
    intensity: bool
    color: bool

class PtsBlock:
    declared: int
    points: int
    intensity: bool
    color: bool

class XyzTable:
    names: list[str]
    columns: int
    decimal_comma: bool
    used: list[int]
    intensity: bool
    color: bool

def pcd_header(path: Path) -> dict[str, Any]: ...
def pcd_read(path: Path, metres_per_unit: float) -> dict[str, Any]: ...
def ply_header(path: Path) -> dict[str, Any]: ...
def ply_read(path: Path, metres_per_unit: float) -> dict[str, Any]: ...
def ptx_index(path: Path) -> list[PtxScan]: ...
def ptx_read(path: Path, scan: PtxScan, metres_per_unit: float) -> dict[str, Any]: ...
def pts_index(path: Path) -> list[PtsBlock]: ...
def pts_read(path: Path, block: PtsBlock, metres_per_unit: float) -> dict[str, Any]: ...
def xyz_sniff(path: Path) -> XyzTable: ...
def xyz_read(path: Path, table: XyzTable, metres_per_unit: float) -> dict[str, Any]: ...
def ptx_rows(
    xyz: NDArray[np.float64],
    intensity: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    order: NDArray[np.int64],
) -> bytes: ...
def e57_copy_with_poses(
    source: Path,
    target: Path,
    scans: list[tuple[int, NDArray[np.float64]]],
    images: list[tuple[int, NDArray[np.float64]]],
    coordinates: str | None,
) -> None: ...

class E57File:
    """What a file says of itself, kept for reading parts of it."""

    def __init__(self, path: Path) -> None: ...
    def describe(self) -> dict[str, Any]: ...
    def read_points(self, scan_index: int, metres_per_unit: float) -> dict[str, Any]: ...
    def read_image(self, image_index: int) -> bytes: ...

class E57Writer:
    """Writes one E57 file, scan after scan; arrays are flat and contiguous."""

    def __init__(self, path: Path) -> None: ...
    def set_coordinates(self, text: str) -> None: ...
    def add_scan(
        self,
        name: str,
        guid: str,
        pose: NDArray[np.float64] | None,
        xyz: NDArray[np.float32] | NDArray[np.float64],
        step: float | None,
        intensity: NDArray[np.float32] | None,
        color: NDArray[np.uint8] | None,
        row: NDArray[np.int32] | None,
        column: NDArray[np.int32] | None,
        invalid: NDArray[np.bool_] | None,
    ) -> None: ...
    def add_photo(
        self,
        name: str,
        guid: str,
        scan_guid: str,
        pose: NDArray[np.float64] | None,
        png: bool,
        data: bytes,
        size: tuple[int, int],
        kind: str,
        model: list[float],
    ) -> None: ...
    def finish(self, guid: str) -> None: ...

class Station:
    """Planar elements of one prepared scan with their search tree, and points seen too thinly for planes."""

    def __init__(
        self,
        points: NDArray[np.float32],
        normals: NDArray[np.float32],
        variances: NDArray[np.float32],
        kinds: NDArray[np.uint8],
        spacing: float,
        thin_points: NDArray[np.float32],
        thin_variances: NDArray[np.float32],
        areas: NDArray[np.float32],
        wide_points: NDArray[np.float32],
        wide_normals: NDArray[np.float32],
        seen_nearest: NDArray[np.float32],
        seen_farthest: NDArray[np.float32],
    ) -> None: ...
    @property
    def area(self) -> float: ...
    def __len__(self) -> int: ...

class Camera:
    """How directions become pixels: see `trihedral.fusion.camera`."""

    @staticmethod
    def pinhole(
        size: tuple[int, int],
        focal: Sequence[float],
        centre: Sequence[float],
        coefficients: Sequence[float],
        fold: float,
    ) -> Camera: ...
    @staticmethod
    def spherical(size: tuple[int, int], pixel_angle: Sequence[float]) -> Camera: ...
    @staticmethod
    def cylindrical(size: tuple[int, int], pixel_angle: float, focal: float, centre: float) -> Camera: ...
    @property
    def pixels_per_radian(self) -> float: ...
    def project(self, xyz: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def rays(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]: ...

class Sample:
    """Colours that a scan's points would take from one picture."""

    def __len__(self) -> int: ...
    def every(self, stride: int) -> tuple[NDArray[np.uint32], NDArray[np.float32]]: ...

class Surface:
    """A scan's points, connected where neighbouring beams met one surface."""

    def __init__(
        self,
        xyz: NDArray[np.float32],
        centre: NDArray[np.float32],
        row: NDArray[np.int32] | None,
        column: NDArray[np.int32] | None,
    ) -> None: ...
    @property
    def step(self) -> float: ...
    @property
    def range_noise(self) -> float: ...
    def draw(
        self,
        camera: Camera,
        pose: NDArray[np.float64],
        rays: NDArray[np.float64],
        image: NDArray[np.uint8],
        border: float,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], Sample]: ...
    def blend(
        self, samples: Sequence[Sample], gains: NDArray[np.float64]
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]: ...

SIGHT_ROWS: int
SIGHT_COLUMNS: int

def prepare(
    xyz: NDArray[np.float32],
    row: NDArray[np.int32] | None,
    column: NDArray[np.int32] | None,
    intensity: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    colored: NDArray[np.bool_] | None,
    elements: int,
    least_area: float,
) -> dict[str, Any]: ...
def upright_placements(
    a: Station,
    b: Station,
    upright_from_a: NDArray[np.float64],
    upright_from_b: NDArray[np.float64],
    yaws: NDArray[np.float32],
    *,
    cell: float,
    side: int,
    reach: float,
    samples: int,
    shifts: int,
    places: int,
    heights: int,
) -> NDArray[np.float32]: ...
def agreement(
    a: Station, b: Station, poses: NDArray[np.float64], *, offset: float, margin: float, samples: int
) -> NDArray[np.float64]: ...
def element_outcomes(
    a: Station, b: Station, b_from_a: NDArray[np.float64], *, offset: float, margin: float
) -> NDArray[np.uint8]: ...
def refine_many(
    a: Station, b: Station, starts: NDArray[np.float64], stages: Sequence[tuple[float, int, int, bool]]
) -> list[list[list[float]]]: ...
def refine_one(
    a: Station, b: Station, start: NDArray[np.float64], stages: Sequence[tuple[float, int, int, bool]]
) -> tuple[
    list[list[float]], NDArray[np.float64], NDArray[np.float64], int, float, NDArray[np.float32], bool
]: ...
def surf(
    image: NDArray[np.uint8],
    mask: NDArray[np.bool_] | None,
    *,
    octaves: int,
    threshold: float,
    upright: bool,
    extended: bool,
    most: int,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
def surf_determinants(image: NDArray[np.uint8], side: int) -> NDArray[np.float32]: ...
def segment_planes(
    points: NDArray[np.float32], *, tolerance: float, candidates: int, least: int, most: int, seed: int
) -> list[tuple[list[float], float, float, NDArray[np.uint32]]]: ...
def align_points(
    a: NDArray[np.float32],
    b: NDArray[np.float32],
    start: NDArray[np.float64],
    *,
    reach: float,
    iterations: int,
    translation: float,
    rotation: float,
) -> tuple[list[list[float]], float, int, int, bool]: ...
def nearest_distances(
    points: NDArray[np.float32], queries: NDArray[np.float32], reach: float
) -> NDArray[np.float32]: ...
def scanned_grid(
    xyz: NDArray[np.float32], row: NDArray[np.int32], column: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]] | None: ...
def projected_grid(xyz: NDArray[np.float32], step: float) -> tuple[NDArray[np.int64], NDArray[np.bool_]]: ...
