"""A made-up office floor: seven stations that look around with noise, and a registration of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from support.links import link as made
from trihedral.model.link import LinkVerdict, PoseEstimate, Residuals
from trihedral.model.pairs import PairPreview
from trihedral.model.registration import Failure, Loop, PreviewRecord, Registration
from trihedral.model.station import StationResult, StationStatus
from trihedral.report import Input
from trihedral.scan import ScanHeader

HEIGHT = 2.8
SCANNER = 1.6
# Ends of walls in plan, metres; the gaps are doors.
WALLS = np.array(
    [
        *[[0, 0, 26, 0], [26, 0, 26, 14], [26, 14, 0, 14], [0, 14, 0, 0]],
        *[[0, 6, 3, 6], [4, 6, 12, 6], [13, 6, 21, 6], [22, 6, 26, 6]],
        *[[0, 8, 6, 8], [7, 8, 15, 8], [16, 8, 23, 8], [24, 8, 26, 8]],
        *[[0, 6.1, 3, 6.1], [4, 6.1, 12, 6.1], [13, 6.1, 21, 6.1], [22, 6.1, 26, 6.1]],
        *[[8, 0, 8, 6], [17, 0, 17, 6], [9, 8, 9, 14], [18, 8, 18, 14]],
        *[
            [11.0, 10.5, 11.6, 10.5],
            [11.6, 10.5, 11.6, 11.1],
            [11.6, 11.1, 11.0, 11.1],
            [11.0, 11.1, 11.0, 10.5],
        ],
    ],
    dtype=np.float64,
)
PLACES = {
    "s1": (3.5, 7),
    "s2": (12.5, 7.2),
    "s3": (21.5, 6.9),
    "s4": (12.4, 4),
    "s5": (15.4, 10),
    "s6": (3.4, 3),
    "s7": (24, 3),
}


def motion(yaw: float, place: tuple[float, float, float]) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = place
    return pose


def preview(x: float, y: float, rng: np.random.Generator, count: int) -> np.ndarray:
    """What a scanner at (x, y, SCANNER) sees, in its unrotated frame: first hit of each ray, 2 mm noise."""
    azimuth = rng.uniform(-np.pi, np.pi, count)
    tangent = rng.uniform(-1.4, 0.9, count)
    ax, ay, bx, by = WALLS.T
    dx, dy = np.cos(azimuth)[:, None], np.sin(azimuth)[:, None]
    ex, ey = bx - ax, by - ay
    cross = dx * ey - dy * ex
    with np.errstate(divide="ignore", invalid="ignore"):
        along = ((ax - x) * ey - (ay - y) * ex) / cross
        share = ((ax - x) * dy - (ay - y) * dx) / cross
    along = np.where((along > 0) & (share >= 0) & (share <= 1), along, np.inf).min(axis=1)
    floor = np.where(tangent < 0, -SCANNER / tangent, (HEIGHT - SCANNER) / tangent)
    reach = np.minimum(along, floor) + rng.normal(0, 0.002, count)
    points = np.stack([reach * np.cos(azimuth), reach * np.sin(azimuth), reach * tangent], axis=1)
    points = points[np.isfinite(points).all(axis=1)]
    # Even sampling, as prepared scans are: one point a 4 cm voxel.
    _, first = np.unique(np.floor(points / 0.04).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)].astype(np.float32)


@dataclass(frozen=True)
class Site:
    registration: Registration
    inputs: tuple[Input, ...]
    samples: dict[str, np.ndarray]
    truth: dict[str, np.ndarray]


def make_site(slip: dict[str, tuple[float, float]] | None = None, points: int = 120_000) -> Site:
    """Seven verified stations; `slip` moves a station's pose off the truth by (x, y) metres."""
    rng = np.random.default_rng(7)
    truth, samples, stations = {}, {}, []
    for index, (name, (x, y)) in enumerate(PLACES.items()):
        yaw = 0.7 * index
        truth[name] = motion(yaw, (x, y, 0.0))
        local = motion(-yaw, (0, 0, SCANNER))
        samples[name] = (preview(x, y, rng, points) @ local[:3, :3].T + local[:3, 3]).astype(np.float32)
        pose = truth[name].copy()
        pose[:2, 3] += (slip or {}).get(name, (0.0, 0.0))
        header = ScanHeader(
            source=Path(f"site/{name}.e57"),
            scan_index=0,
            name=name,
            format="e57",
            points=2_000_000 + index,
            grid=(1000, 2000),
            has_color=False,
            has_intensity=True,
            photos=0,
            file_pose=None,
            scanner_origin=np.array([0.0, 0.0, SCANNER]),
            origin_stated=True,
            units="m",
            units_stated=True,
        )
        sigma = (0.0004 + 0.0002 * index, 0.0005 + 0.0001 * index, 0.0003)
        stations.append(
            StationResult(
                name,
                header,
                1_950_000 + index,
                pose,
                True,
                0,
                StationStatus.VERIFIED,
                None,
                sigma,
                (0.002, 0.002, 0.004),
            )
        )
    poses = {station.name: station.pose for station in stations}
    links = []
    for index, (a, b) in enumerate(
        [
            ("s1", "s2"),
            ("s2", "s3"),
            ("s1", "s3"),
            ("s2", "s4"),
            ("s3", "s4"),
            ("s2", "s5"),
            ("s5", "s3"),
            ("s1", "s6"),
            ("s6", "s2"),
            ("s3", "s7"),
            ("s7", "s2"),
        ]
    ):
        p95 = 0.0062 + 0.0007 * ((index * 5) % 11)
        links.append(
            made(
                a,
                b,
                estimate=PoseEstimate(
                    np.linalg.inv(poses[b]) @ poses[a],
                    # It knows least along x of the scan that it leads to.
                    np.diag([1e-9, 1e-9, 2e-9, (0.0005 + 0.0003 * ((index * 3) % 7)) ** 2, 2e-7, 1e-7]),
                    Residuals(0.5 * p95, 0.3 * p95, p95, 2.6 * p95, 0.83 * p95),
                    compared=41_000,
                ),
                initial_transform=np.linalg.inv(poses[b]) @ poses[a] @ motion(0.004, (0.03, -0.02, 0.01)),
                overlap_from=0.35 + 0.03 * index,
                overlap_to=0.31 + 0.04 * index,
                free_space_conflict=0.0004 * index,
                runner_up=0.2 + 0.03 * index,
                seconds={"refine": 0.3},
            )
        )
    loops = tuple(
        Loop(names, 0.0015 + 0.0008 * i, 0.004 + 0.002 * i, 0.003, True)
        for i, names in enumerate(
            [
                ("s1", "s2", "s3"),
                ("s2", "s3", "s4"),
                ("s2", "s5", "s3"),
                ("s1", "s6", "s2"),
                ("s2", "s3", "s7"),
            ]
        )
    )
    inputs = tuple(
        Input(f"site/{name}.e57", f"{index:064x}", 48_000_000 + index) for index, name in enumerate(PLACES)
    )
    registration = Registration(
        tuple(stations),
        tuple(links),
        loops,
        options={"method": "auto", "sampling_m": 0.04, "level": None},
        seed=1234,
        timing={"prepare": 6.1, "pairs": 8.4, "network": 0.2},
    )
    return Site(registration, inputs, samples, truth)


def with_troubles(site: Site) -> Site:
    """The same job with s6 ambiguous, s7 not placed, one file unreadable and some pairs not used."""
    stations, links = [], []
    for station in site.registration.stations:
        if station.name == "s6":
            reason = "two poses explain s1 - s6 nearly as well (scores 0.97)"
            station = replace(station, status=StationStatus.AMBIGUOUS, reason=reason)
        if station.name == "s7":
            station = replace(
                station,
                pose=None,
                tied=False,
                component=None,
                status=StationStatus.NOT_PLACED,
                reason="too little shared surface with any other scan (best overlap 0.04)",
                sigma_translation_m=None,
                sigma_rotation_deg=None,
            )
        stations.append(station)
    for link in site.registration.links:
        ends = {link.from_station, link.to_station}
        if ends == {"s1", "s6"}:
            other = link.transform @ motion(np.pi, (3.0, -1.0, 0.0))
            link = replace(
                link,
                verdict=LinkVerdict.AMBIGUOUS,
                reason="another pose explains the data nearly as well (0.97)",
                runner_up=0.97,
                alternatives=(PoseEstimate(other),),
            )
        elif ends == {"s6", "s2"}:
            link = replace(link, verdict=LinkVerdict.DOUBTFUL, reason="overlap 0.06 is too little to check")
        elif ends == {"s3", "s7"}:
            reason = "11 % of the compared surface lies in space that was seen through"
            link = replace(link, verdict=LinkVerdict.REFUSED, reason=reason, free_space_conflict=0.11)
        elif ends == {"s2", "s7"}:
            link = made("s7", "s2", verdict=LinkVerdict.REFUSED, reason="no pose was found", evidence=None)
        links.append(link)
    loops = tuple(loop for loop in site.registration.loops if not {"s6", "s7"} & set(loop.stations))
    failure = Failure("site/s8.e57", None, "the file ends at byte 1048576, inside its points")
    registration = replace(
        site.registration, stations=tuple(stations), links=tuple(links), loops=loops, failures=(failure,)
    )
    return replace(site, registration=registration)


def with_previews(site: Site) -> Site:
    """The troubled job with pairs that were previewed; s7 is not placed."""
    because = "its plan is among the 4 most like that of the other"
    previews = (
        PreviewRecord(
            "s4", "s5", because, 1, PairPreview(0.4, 0.9, 0.1), False, "other links tied its scans"
        ),
        PreviewRecord(
            "s7", "s4", because, 1, PairPreview(0.01, None, 0.1), False, "too little surface agrees"
        ),
        PreviewRecord("s1", "s2", because, 1, PairPreview(0.5, 0.95, 0.1), True, None),
        PreviewRecord(
            "s5",
            "s7",
            "nothing ties a part",
            2,
            PairPreview(0.2, -0.1, 0.1),
            False,
            "surfaces do not look the same",
        ),
        PreviewRecord("s10", "s2", because, 3, PairPreview(1 / 3, float("nan"), 0.1), True, None),
    )
    never = [{"pairs": 1234, "because": "plans are less alike"}]
    registration = replace(site.registration, previews=previews, pairs={"never_looked_at": never})
    return replace(site, registration=registration)


@pytest.fixture(scope="session")
def looked(troubled: Site) -> Site:
    """The same with pairs that were previewed."""
    return with_previews(troubled)


@pytest.fixture(scope="session")
def site() -> Site:
    """Seven stations, all placed."""
    return make_site()


@pytest.fixture(scope="session")
def troubled(site: Site) -> Site:
    """Five placed, one ambiguous, one not placed, one file unreadable."""
    return with_troubles(site)


@pytest.fixture(scope="session")
def site_with_slip() -> Callable[[dict[str, tuple[float, float]]], Site]:
    """Make the site with some poses off by a known amount."""
    return make_site
