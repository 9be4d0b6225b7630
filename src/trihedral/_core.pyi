"""Types of the Rust module: arrays in, classes with named fields out."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__version__: str

class FileFormatError(ValueError):
    """A file that cannot be used: (place, reason)."""

class PointBlock:
    """The points of one scan as a reader hands them on, and what it left out."""

    def __init__(
        self,
        xyz: NDArray[np.float32],
        local_origin: list[float],
        intensity: NDArray[np.float32] | None,
        color: NDArray[np.uint8] | NDArray[np.uint16] | None,
        no_return: int,
        withheld: int,
    ) -> None: ...
    #: (N, 3) metres, station coordinates less `local_origin`.
    xyz: NDArray[np.float32]
    #: Three numbers, metres; zero unless coordinates are too large for 32-bit floats.
    local_origin: list[float]
    #: (N,) as stored, of E57 scaled to 0..1; None where the file has none.
    intensity: NDArray[np.float32] | None
    #: (N, 3) red, green, blue of 8 or 16 bits; None where the file has none.
    color: NDArray[np.uint8] | NDArray[np.uint16] | None
    #: (N,) grid indices as stored; None for points without a grid.
    row: NDArray[np.int32] | None
    column: NDArray[np.int32] | None
    #: Records left out: no finite number or absurd, at (0, 0, 0), marked as withheld, marked as invalid.
    not_finite: int
    no_return: int
    withheld: int
    invalid: int
    #: Points behind the last one that the header promises, which are not read.
    surplus: int
    #: The last line has no end.
    open_end: bool
    #: Scaled by the largest values because the file states no limits that hold.
    intensity_by_extremes: bool
    color_by_extremes: bool

class RecordHeader:
    """What a PCD or PLY file says of its points."""

    points: int
    #: Rows and columns of an organised cloud.
    grid: tuple[int, int] | None
    fields: list[str]
    #: Translation x y z, then the quaternion w x y z.
    viewpoint: list[float] | None
    intensity: bool
    color: bool

class PtxScan:
    """One scan of a PTX file."""

    columns: int
    rows: int
    structured: bool
    #: 4x4 as stored, for row vectors.
    matrix: list[list[float]]
    decimal_comma: bool
    intensity: bool
    color: bool
    def read(self, path: Path, metres_per_unit: float) -> PointBlock: ...

class PtsBlock:
    """One block of a PTS file."""

    declared: int
    points: int
    columns: int
    decimal_comma: bool
    #: Whether the first row is left out, as it is of another width than the rest.
    stray: bool
    used: list[int]
    intensity: bool
    color: bool
    def read(self, path: Path, metres_per_unit: float) -> PointBlock: ...

class XyzTable:
    """What the columns of a text file are."""

    names: list[str]
    columns: int
    decimal_comma: bool
    declared: int | None
    stray: int | None
    used: list[int]
    intensity: bool
    color: bool
    def read(self, path: Path, metres_per_unit: float) -> PointBlock: ...

def pcd_header(path: Path) -> RecordHeader: ...
def pcd_read(path: Path, metres_per_unit: float) -> PointBlock: ...
def ply_header(path: Path) -> RecordHeader: ...
def ply_read(path: Path, metres_per_unit: float) -> PointBlock: ...
def ptx_index(path: Path) -> list[PtxScan]: ...
def pts_index(path: Path) -> list[PtsBlock]: ...
def xyz_sniff(path: Path) -> XyzTable: ...
def text_kind(head: bytes) -> str | None: ...
def ptx_rows(
    xyz: NDArray[np.float64],
    intensity: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    order: NDArray[np.int64],
) -> bytes: ...
def e57_copy_with_poses(
    source: Path,
    target: Path,
    scans: dict[int, NDArray[np.float64]],
    images: dict[int, NDArray[np.float64]],
    coordinates: str | None,
) -> None: ...

class E57Pose:
    """A rigid motion as stored: nothing is checked."""

    #: w, x, y, z.
    quaternion: list[float]
    translation: list[float]

class E57ScanInfo:
    """What a file says of one of its scans."""

    guid: str
    name: str
    points: int
    fields: list[str]
    pose: E57Pose | None
    #: Least and largest row, least and largest column.
    index_bounds: list[int] | None
    #: Elements of extensions, with their prefix.
    extras: list[str]

class E57ImageInfo:
    """What a file says of one of its pictures."""

    name: str
    scan_guid: str
    pose: E57Pose | None
    kind: Literal["pinhole", "spherical", "cylindrical", "visual-reference"]
    png: bool
    width: int
    height: int
    #: Numbers of the camera model by their names in the standard.
    model: dict[str, float]

class E57File:
    """What a file says of itself, kept for reading parts of it; a str says what is wrong with a description."""

    def __init__(self, path: Path) -> None: ...
    def scans(self) -> list[E57ScanInfo | str]: ...
    def images(self) -> list[E57ImageInfo | str]: ...
    def read_points(self, scan_index: int, metres_per_unit: float) -> PointBlock: ...
    def read_image(self, image_index: int) -> bytes: ...

class E57Projection:
    """How a picture to be written was projected, in E57's own terms: metres, radians and pixels."""

    @staticmethod
    def visual_reference() -> E57Projection: ...
    @staticmethod
    def pinhole(focal: float, pixel: Sequence[float], principal: Sequence[float]) -> E57Projection: ...
    @staticmethod
    def spherical(pixel: Sequence[float]) -> E57Projection: ...
    @staticmethod
    def cylindrical(radius: float, pixel: Sequence[float], principal_y: float) -> E57Projection: ...

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
        colorless: NDArray[np.bool_] | None,
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
        projection: E57Projection,
    ) -> None: ...
    def finish(self, guid: str) -> None: ...

class PreparedSurfels:
    """An even sampling of a scan's surface: see `trihedral.scan.surfels`."""

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    thickness: NDArray[np.float32]
    support: NDArray[np.float32]
    count: NDArray[np.float32]
    intensity: NDArray[np.float32]
    color: NDArray[np.float32]
    patch: NDArray[np.int32]

class PreparedPatches:
    """Planar patches, largest first: see `trihedral.scan.patches`."""

    normals: NDArray[np.float64]
    areas: NDArray[np.float64]

class PreparedScan:
    """What a scan is reduced to; ranges as in `trihedral.scan.free_space`, noise as in `trihedral.scan.noise`."""

    surfels: PreparedSurfels
    patches: PreparedPatches
    spacing: float
    nearest: NDArray[np.float32]
    farthest: NDArray[np.float32]
    on_grid: bool
    range_noise: float
    angular_step: float
    surface_noise: float

class SurfelMap:
    """Planar surfels of one prepared scan with their search grids, and points seen too thinly for planes."""

    def __init__(
        self,
        *,
        points: NDArray[np.float32],
        normals: NDArray[np.float32],
        variances: NDArray[np.float32],
        kinds: NDArray[np.uint8],
        spacing: float,
        thin_points: NDArray[np.float32],
        thin_variances: NDArray[np.float32],
        areas: NDArray[np.float32],
        sparse_points: NDArray[np.float32],
        sparse_normals: NDArray[np.float32],
        seen_nearest: NDArray[np.float32],
        seen_farthest: NDArray[np.float32],
    ) -> None: ...
    @property
    def area(self) -> float: ...
    def __len__(self) -> int: ...

class Placements:
    """Motions of one upright scan onto another: (N,) yaws (rad), (N, 3) shifts (m), (N,) scores."""

    yaws: NDArray[np.float32]
    shifts: NDArray[np.float32]
    scores: NDArray[np.float32]

class Agreements:
    """Shares of the surface of `a`, as `b` sees it, then of `b`, under N poses: (N, 2); of each kind (N, 2, 3)."""

    agreeing: NDArray[np.float64]
    conflicting: NDArray[np.float64]
    near: NDArray[np.float64]
    holding: NDArray[np.float64]
    agreeing_of: NDArray[np.float64]
    conflicting_of: NDArray[np.float64]

class Stage:
    """One stage of a refinement: maximum correspondence distance (m), surfels of each station, iterations, weights."""

    max_distance: float
    samples: int
    iterations: int
    by_variance: bool

    def __init__(self, max_distance: float, samples: int, iterations: int, by_variance: bool) -> None: ...

class Fit:
    """What a refinement ended with.

    (4, 4) pose ``b_from_a``, (6, 6) normal matrix, scatter of the gradients of so many places, and of those of planes
    that are off as a whole (per m), (N,) offsets (m).
    """

    pose: NDArray[np.float64]
    information: NDArray[np.float64]
    scatter: NDArray[np.float64]
    places: int
    planes: NDArray[np.float64]
    chi_square: float
    offsets: NDArray[np.float32]

class Alignment:
    """What point-to-point ICP ended with: (4, 4) pose ``b_from_a``, metres, matched points."""

    pose: NDArray[np.float64]
    rmse: float
    matched: int
    iterations: int
    converged: bool

class PlaneSegment:
    """A plane ``normal . x = distance`` (m) and the indices of the points on it."""

    normal: NDArray[np.float64]
    distance: float
    thickness: float
    inliers: NDArray[np.uint32]

class SurfFeatures:
    """SURF features of a picture, the strongest first: (N, 2) pixels, (N,) scale, angle (rad), sign, descriptors."""

    pixels: NDArray[np.float32]
    scale: NDArray[np.float32]
    angle: NDArray[np.float32]
    sign: NDArray[np.int8]
    descriptors: NDArray[np.float32]

class DirectionGrid:
    """A scan's points on a grid of directions: (H, W) point indices, -1 for none, and whether ranges jump there."""

    points: NDArray[np.int64]
    edges: NDArray[np.bool_]

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

class Drawing:
    """What a camera sees: (H, W) distances (m), (H, W, 3) points centred on the scanner, colours that points take."""

    distances: NDArray[np.float32]
    points: NDArray[np.float32]
    sample: Sample

class Blend:
    """Colours mixed from several pictures: (N, 3), and (N,) whether a point takes one."""

    colors: NDArray[np.uint8]
    colored: NDArray[np.bool_]

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
    ) -> Drawing: ...
    def blend(self, samples: Sequence[Sample], gains: NDArray[np.float64]) -> Blend: ...

def prepare(
    xyz: NDArray[np.float32],
    *,
    row: NDArray[np.int32] | None,
    column: NDArray[np.int32] | None,
    intensity: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    colored: NDArray[np.bool_] | None,
    surfels: int,
    sound_normals: bool,
    least_patch_area: float,
) -> PreparedScan: ...
def upright_placements(
    a: SurfelMap,
    b: SurfelMap,
    upright_from_a: NDArray[np.float64],
    upright_from_b: NDArray[np.float64],
    yaws: NDArray[np.float32],
    *,
    cell: float,
    side: int,
    farthest: float,
    samples: int,
    shifts: int,
    places: int,
    heights: int,
) -> Placements: ...
def agreement(
    a: SurfelMap, b: SurfelMap, poses: NDArray[np.float64], *, offset: float, margin: float, samples: int
) -> Agreements: ...

class ComparedSurfels:
    """Surfels and thin points of one station under a pose."""

    #: (N, 3) in the frame of their own station.
    points: NDArray[np.float32]
    #: (N,) 0 loose, 1 of a patch, 2 static.
    kind: NDArray[np.uint8]
    #: (N,) 0 unknown, 1 agreeing, 2 conflicting, 3 hidden, 4 near.
    outcome: NDArray[np.uint8]
    #: (N,) distance from the plane at hand of the other station and its standard deviation (m); NaN where there is
    #: none.
    offset: NDArray[np.float32]
    sigma: NDArray[np.float32]

def compare_surfels(
    a: SurfelMap, b: SurfelMap, b_from_a: NDArray[np.float64], *, offset: float, margin: float, samples: int
) -> ComparedSurfels: ...
def refine_many(
    a: SurfelMap, b: SurfelMap, starts: NDArray[np.float64], stages: Sequence[Stage]
) -> list[NDArray[np.float64]]: ...
def refine_one(a: SurfelMap, b: SurfelMap, start: NDArray[np.float64], stages: Sequence[Stage]) -> Fit: ...
def surf(
    image: NDArray[np.uint8],
    mask: NDArray[np.bool_] | None,
    *,
    octaves: int,
    threshold: float,
    upright: bool,
    extended: bool,
    most: int,
) -> SurfFeatures: ...
def surf_determinants(image: NDArray[np.uint8], side: int) -> NDArray[np.float32]: ...
def segment_planes(
    points: NDArray[np.float32], *, tolerance: float, candidates: int, least: int, most: int, seed: int
) -> list[PlaneSegment]: ...
def align_points(
    a: NDArray[np.float32],
    b: NDArray[np.float32],
    start: NDArray[np.float64],
    *,
    max_distance: float,
    iterations: int,
    translation: float,
    rotation: float,
) -> Alignment: ...
def nearest_distances(
    points: NDArray[np.float32], queries: NDArray[np.float32], max_distance: float
) -> NDArray[np.float32]: ...
def thin(points: NDArray[np.float64], spacing: float) -> NDArray[np.uint32]: ...
def scanned_grid(
    xyz: NDArray[np.float32], row: NDArray[np.int32], column: NDArray[np.int32]
) -> DirectionGrid | None: ...
def projected_grid(xyz: NDArray[np.float32], step: float) -> DirectionGrid: ...
