"""A small room with a box in it, seen by a scanner and cameras by ray casting: the truth that maps are held against."""

import math
from dataclasses import dataclass

import numpy as np

from trihedral.fusion import camera as lens
from trihedral.scan import CameraModel, Photo, Scan, ScanHeader
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import MeshBuilder
from trihedral.simulate.photograph import Exposure, photograph
from trihedral.simulate.scene import Light
from trihedral.simulate.tracer import Tracer

SCANNER = np.array([0.0, 0.0, 1.5])


@dataclass
class Room:
    tracer: Tracer
    scan: Scan

    def photo(self, camera: CameraModel, pose: np.ndarray, name: str = "photo", **exposure: float) -> Photo:
        import cv2

        image = photograph(
            self.tracer, Light(), camera, pose, Exposure(**exposure), (5, len(name)), shadows=False
        )
        data = cv2.imencode(".png", image[..., ::-1])[1].tobytes()
        return Photo(name, "png", data, camera, pose)

    def truth(self, camera: CameraModel, pose: np.ndarray) -> np.ndarray:
        """(H, W, 3) where the ray of each pixel meets the room; NaN for none."""
        directions = lens.pixel_rays(camera) @ pose[:3, :3].T
        start = np.broadcast_to(pose[:3, 3], directions.shape)
        known = np.isfinite(directions[:, 0])
        points = np.full(directions.shape, np.nan)
        _, length = self.tracer.cast(start[known], directions[known])
        points[known] = start[known] + directions[known] * length[:, None]
        return points.reshape(camera.height, camera.width, 3)


def looking(heading_deg: float, place: tuple[float, float, float], pitch_deg: float = 0.0) -> np.ndarray:
    """station_from_camera of a level camera: built here from its axes, not by the code under test."""
    h, p = math.radians(heading_deg), math.radians(pitch_deg)
    view = np.array([math.cos(h) * math.cos(p), math.sin(h) * math.cos(p), math.sin(p)])
    right = np.cross(view, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(view, right), view])
    pose[:3, 3] = place
    return pose


def make_room() -> Room:
    b = MeshBuilder(3)
    b.box((-4, -3, 0), (4, 3, 3), M["brick"])
    b.box((1.5, -0.5, 0), (2.1, 0.5, 2.2), M["sign"])
    tracer = Tracer(b.mesh())
    step = math.radians(0.5)
    elevation = np.arange(math.radians(75), math.radians(-75), -step)
    azimuth = np.arange(0, 2 * math.pi - 1e-9, step)
    e, a = np.meshgrid(elevation, azimuth, indexing="ij")
    rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1).reshape(-1, 3)
    _, length = tracer.cast(np.broadcast_to(SCANNER, rays.shape), rays)
    rng = np.random.default_rng(1)
    xyz = SCANNER + rays * (length + 0.001 * rng.standard_normal(len(length)))[:, None]
    row, column = np.divmod(np.arange(len(rays), dtype=np.int32), np.int32(len(azimuth)))
    header = ScanHeader(
        "room.e57", 0, "room", "e57", len(rays), (len(elevation), len(azimuth)), False, False, 0, None,
        SCANNER, True, "m", True,
    )  # fmt: skip
    return Room(
        tracer, Scan(header, xyz.astype(np.float32), np.zeros(3), row=row, column=column.astype(np.int32))
    )


PINHOLE = CameraModel(
    "pinhole", 320, 240, (240.0, 242.0), (161.0, 118.0), (-0.12, 0.05, 0.001, -0.0008, -0.01)
)
SPHERICAL = CameraModel("spherical", 720, 360, pixel_angle=(math.radians(0.5), math.radians(0.5)))
CYLINDRICAL = CameraModel(
    "cylindrical",
    720,
    300,
    (1 / math.radians(0.5), 120.0),
    (359.5, 149.5),
    (),
    (math.radians(0.5), 1 / 120.0),
)
