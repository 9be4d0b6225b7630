"""What is damaged: a small file of each kind, and what reads it."""

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from PIL import Image

from support.e57_pages import PAYLOAD, content, seal
from trihedral.fusion.rig import LineScanner, Profiles
from trihedral.io import ReadOptions, read_headers, read_photos, read_scan
from trihedral.io.camera import read_camera, read_pairs, write_camera
from trihedral.io.e57 import E57Scan, write_e57
from trihedral.io.pictures import read_grey
from trihedral.io.rig import write_rig
from trihedral.io.scanner_origins import read_scanner_origins
from trihedral.job.progress_file import read_progress
from trihedral.network.constraints.file import read_constraints
from trihedral.report.reading import read_result
from trihedral.scan import CameraModel

OPTIONS = ReadOptions(units="m", scanner_origin=(0.0, 0.0, 0.0))
POINTS = np.random.default_rng(6).normal(0, 5, (60, 3)).round(2)
ROWS = "".join(f"{x} {y} {z} 0.5 1 2 3\n" for x, y, z in POINTS)
UNIT = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
CAMERA = CameraModel("pinhole", 64, 48, (50.0, 51.0), (31.0, 24.5))
CONSTRAINTS = """crs = "EPSG:25832"
[level]
sigma_arcsec = 180
[fixed]
station = "a"
pose = [[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]
[[forced]]
from = "a"
to = "b"
[control]
points = "control.csv"
sigma_mm = 3
[[control.measurement]]
scan = "a"
point = "P1"
xyz = [1, 2, 3]
"""


@dataclass(frozen=True)
class Kind:
    """A file by name, what is in it, and what reads it; `sealed` makes checksums right after the damage."""

    file: str
    sample: Callable[[Path], bytes]
    read: Callable[[Path], object]
    sealed: Callable[[bytes], bytes] = bytes


def points(path: Path) -> None:
    for header in read_headers(path, OPTIONS):
        scan = read_scan(header, OPTIONS)
        assert np.isfinite(scan.xyz).all() and np.isfinite(scan.local_origin).all()
        for values in (scan.intensity, scan.color, scan.row, scan.column):
            assert values is None or len(values) == len(scan)
        read_photos(header)


def las(form: int, suffix: str) -> Callable[[Path], bytes]:
    def made(folder: Path) -> bytes:
        header = laspy.LasHeader(point_format=form, version="1.4" if form > 5 else "1.2")
        header.scales = [0.001] * 3
        data = laspy.LasData(header)
        data.x, data.y, data.z = POINTS.T
        data.write(folder / f"made.{suffix}")
        return (folder / f"made.{suffix}").read_bytes()

    return made


def e57(folder: Path) -> bytes:
    write_e57(folder / "made.e57", [E57Scan(name="one", xyz=POINTS.astype(np.float32))])
    return content(folder / "made.e57")


def e57_sealed(data: bytes) -> bytes:
    return seal(data[: 60 * PAYLOAD])


def rig(folder: Path) -> Path:
    turns, beams = np.radians(np.arange(0.0, 360.0, 30.0)), np.radians(np.linspace(-90, 90, 9))
    ranges = np.full((len(turns), len(beams)), 5.0, np.float32)
    profiles = Profiles(LineScanner("line", 0.2, 1.3, np.eye(4)), turns, beams, ranges, None)
    write_rig(folder / "one.toml", "one", [profiles])
    return folder / "one.toml"


def rig_part(folder: Path) -> bytes:
    rig(folder)
    return (folder / "one-line.npz").read_bytes()


def profiles_table(folder: Path) -> bytes:
    path = rig(folder)
    path.write_text(path.read_text().replace("one-line.npz", "one.csv"))
    rows = "".join(f"{turn}," + ",".join("5.25" for _ in range(9)) + "\n" for turn in range(0, 360, 30))
    return ("body_angle_deg," + ",".join(str(beam) for beam in range(-80, 100, 20)) + "\n" + rows).encode()


def camera(folder: Path) -> bytes:
    write_camera(folder / "made.toml", "front", CAMERA, np.eye(4))
    return (folder / "made.toml").read_bytes()


def constraints(folder: Path) -> bytes:
    (folder / "control.csv").write_text("P1,1,2,3\n")
    return CONSTRAINTS.encode()


def control(folder: Path) -> bytes:
    (folder / "site.toml").write_text(CONSTRAINTS)
    return b"name,x,y,z,sigma_mm,check\nP1,1,2,3,2,yes\nP2,4.5,5,6,,\n"


def picture(kind: str) -> Callable[[Path], bytes]:
    def made(folder: Path) -> bytes:
        pixels = np.random.default_rng(0).integers(0, 255, (24, 32, 3)).astype(np.uint8)
        stream = io.BytesIO()
        Image.fromarray(pixels).save(stream, kind)
        return stream.getvalue()

    return made


def result(folder: Path) -> bytes:
    pose = np.eye(4).tolist()
    station = {
        **{"name": "a", "source": "a.e57", "scan_index": 0, "points": 3, "pose": pose, "tied": True},
        **{"component": 0, "status": "verified", "reason": None},
        **{"sigma_translation_m": [0, 0, 0], "sigma_rotation_deg": [0, 0, 0]},
    }
    return json.dumps(
        {
            "schema": "trihedral.registration/1",
            **{"software": {}, "verdict": {"exit": 0, "text": ""}, "timing": {}, "inputs": []},
            **{"stations": [station], "links": [], "loops": []},
        }
    ).encode()


def progress(folder: Path) -> bytes:
    phase = {"name": "Preparing", "unit": "scans", "total": 3, "done": 1, "seconds": 1.5, "rate": None}
    record = {"process": 1, "machine": "m", "began": 1.0, "now": 2.0, "ended": False, "notes": ["a"]}
    return json.dumps({**record, "phases": [phase]}).encode()


def text(head: str) -> Callable[[Path], bytes]:
    return lambda folder: (head + ROWS).encode()


def binary_ply(folder: Path) -> bytes:
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 60\nproperty float x\nproperty float y\n"
    return f"{head}property float z\nend_header\n".encode() + POINTS.astype("<f4").tobytes()


KINDS = {
    "las": Kind("a.las", las(3, "las"), points),
    "laz": Kind("a.laz", las(3, "laz"), points),
    "laz-layered": Kind("a.laz", las(7, "laz"), points),
    "e57": Kind("a.e57", e57, points, e57_sealed),
    "xyz": Kind("a.xyz", text(""), points),
    "pts": Kind("a.pts", text("60\n"), points),
    "ptx": Kind("a.ptx", text(f"6\n10\n{UNIT}"), points),
    "ply": Kind("a.ply", binary_ply, points),
    "rig": Kind("one.toml", lambda folder: rig(folder).read_bytes(), points),
    "npz": Kind("one-line.npz", rig_part, lambda path: points(path.with_name("one.toml"))),
    "profiles": Kind("one.csv", profiles_table, lambda path: points(path.with_name("one.toml"))),
    "camera": Kind("camera.toml", camera, read_camera),
    "pairs": Kind("pairs.csv", lambda folder: b"x,y,z,column,row\n1,2,3,4,5\n6,7,8,9,10\n", read_pairs),
    "origins": Kind("origins.csv", lambda folder: b"a.las,1,2,3\nb.las,4,5,6\n", read_scanner_origins),
    "constraints": Kind("trihedral.toml", constraints, read_constraints),
    "control": Kind("control.csv", control, lambda path: read_constraints(path.with_name("site.toml"))),
    "jpeg": Kind("a.jpg", picture("JPEG"), read_grey),
    "png": Kind("a.png", picture("PNG"), read_grey),
    "progress": Kind("progress.json", progress, lambda path: read_progress(path.parent)),
    "result": Kind("registration.json", result, read_result),
}
