"""The stated truth against estimators that share no code with the simulator."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from trihedral.simulate import ReturnKind, ScannerOptions, SimulatedScan, Site, make_site
from trihedral.simulate.covisible import reaches, still_points
from trihedral.simulate.files import pair_overlaps

Scanned = tuple[Site, tuple[SimulatedScan, ...]]


def noise_free(one: SimulatedScan) -> np.ndarray:
    """Points at their ranges without noise, along the recorded directions, project frame."""
    xyz = one.xyz.astype(float)
    xyz *= (one.true_range / np.linalg.norm(xyz, axis=1))[:, None]
    return xyz @ one.project_from_station[:3, :3].T + one.project_from_station[:3, 3]


def measured(one: SimulatedScan) -> np.ndarray:
    return one.xyz.astype(float) @ one.project_from_station[:3, :3].T + one.project_from_station[:3, 3]


def nearest_by_brute_force(site: Site, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Nearest range by Moeller and Trumbore's test of every ray with every triangle, float64."""
    v = site.scene.mesh.vertices.astype(float)[site.scene.mesh.faces]
    e1, e2, s = v[:, 1] - v[:, 0], v[:, 2] - v[:, 0], origin - v[:, 0]
    q = np.cross(s, e1)
    out = np.empty(len(directions))
    for k, d in enumerate(directions):
        p = np.cross(d, e2)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / np.einsum("ij,ij->i", e1, p)
            a = np.einsum("ij,ij->i", s, p) * inverse
            b = q @ d * inverse
            t = np.einsum("ij,ij->i", e2, q) * inverse
        good = (a >= 0) & (b >= 0) & (a + b <= 1) & (t > 1e-9)
        out[k] = t[good].min(initial=np.inf)
    return out


def test_ranges_are_those_of_the_mesh_to_a_hundredth_of_a_millimetre(scanned: Scanned) -> None:
    site, _ = scanned
    rng = np.random.default_rng(0)
    direction = rng.standard_normal((40, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    for pose in site.poses[:2]:
        origin = pose[:3, 3]
        _, length = site.still.cast(np.repeat(origin[None], len(direction), axis=0), direction)
        expected = nearest_by_brute_force(site, origin, direction)
        assert np.array_equal(np.isfinite(length), np.isfinite(expected))
        met = np.isfinite(length)
        assert met.sum() > 12
        assert np.abs(length[met] - expected[met]).max() < 1e-5


def test_range_noise_is_as_large_as_stated_and_has_no_mean(scanned: Scanned) -> None:
    site, scans = scanned
    for one in scans:
        error = np.linalg.norm(one.xyz.astype(float), axis=1) - one.true_range
        n = len(error)
        assert abs(error.mean()) < 4 * error.std() / np.sqrt(n)
        # The part that grows as the signal weakens comes on top.
        assert 1.0 <= error.std() / site.scanner.range_noise_m < 1.8
        near = (one.true_range < 4.0) & (one.intensity > 0.4)
        if near.sum() > 2000:
            assert abs(error[near].std() / site.scanner.range_noise_m - 1.0) < 0.05


def test_one_wall_seen_from_two_stations_is_one_plane(scanned: Scanned) -> None:
    site, scans = scanned
    surface = site.scene.mesh.surface
    vertices = site.scene.mesh.vertices.astype(float)[site.scene.mesh.faces]
    normals = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    scores, compared = [], 0
    for a in range(len(scans)):
        for b in range(a + 1, len(scans)):
            hits = []
            for one in (scans[a], scans[b]):
                direct = one.fixed & (one.kind == ReturnKind.DIRECT)
                hits.append((surface[one.face[direct]], measured(one)[direct]))
            counts = [np.bincount(ids, minlength=surface.max() + 1) for ids, _ in hits]
            shared = np.minimum(*counts)
            for number in np.argsort(-shared)[:30]:
                if shared[number] < 300:
                    break
                own = np.flatnonzero(surface == number)
                n = normals[own[0]] / np.linalg.norm(normals[own[0]])
                if np.ptp((vertices[own].reshape(-1, 3) - vertices[own[0], 0]) @ n) > 1e-4:
                    continue  # curved
                offsets = [(p[ids == number] - vertices[own[0], 0]) @ n for ids, p in hits]
                errors = [o.std() / np.sqrt(len(o)) for o in offsets]
                difference = offsets[0].mean() - offsets[1].mean()
                scores.append(difference / np.hypot(*errors))
                compared += 1
    assert compared >= 3
    assert np.sqrt(np.mean(np.square(scores))) < 2.0
    assert np.abs(scores).max() < 4.5


def point_to_plane(moving: np.ndarray, fixed: np.ndarray, steps: int = 3) -> tuple[np.ndarray, float, int]:
    """Shift (at the middle of the points) and turn in degrees that align two clouds best, from identity."""
    tree = cKDTree(fixed)
    motion = np.eye(4)
    for _ in range(steps):
        p = moving @ motion[:3, :3].T + motion[:3, 3]
        distance, index = tree.query(p, distance_upper_bound=0.1)
        near = np.isfinite(distance)
        reach, around = tree.query(fixed[index[near]], k=16)
        patch = fixed[around]
        centre = patch.mean(axis=1)
        spread = patch - centre[:, None]
        values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread) / 16)
        flat = (values[:, 0] < 1e-6) & (values[:, 1] > 100 * values[:, 0]) & (reach[:, -1] < 0.8)
        q, normal = p[near][flat], vectors[flat, :, 0]
        residual = np.einsum("ij,ij->i", q - centre[flat], normal)
        keep = np.abs(residual) < 3e-3 + 3 * np.median(np.abs(residual))
        rows = np.hstack([np.cross(q, normal), normal])[keep]
        step = np.linalg.lstsq(rows, -residual[keep], rcond=None)[0]
        turn = np.eye(4)
        turn[:3, :3], turn[:3, 3] = Rotation.from_rotvec(step[:3]).as_matrix(), step[3:]
        motion = turn @ motion
    middle = q.mean(axis=0)
    shift = motion[:3, :3] @ middle + motion[:3, 3] - middle
    angle = np.degrees(np.linalg.norm(Rotation.from_matrix(motion[:3, :3]).as_rotvec()))
    return shift, angle, int(keep.sum())


@pytest.mark.parametrize("scene", ["facade", "office", "site"])
def test_point_to_plane_alignment_started_at_the_truth_stays_there(scene: str) -> None:
    # Mixed pixels, movers, glass and ghosts are all in. Noise of ranges and directions is not: it averages out
    # (tested apart) and would hide a bias of a few tenths of a millimetre.
    site = make_site(
        scene, 5, 2, ScannerOptions(angular_noise_arcsec=0.0).with_beams(700_000), overlap=(0.65, 0.95)
    )
    rng = np.random.default_rng(0)
    clouds = []
    for one in site:
        # Thin in proportion to the density on a sphere: voxels would favour one side of a wall's noise.
        keep = rng.random(len(one)) < (one.true_range / 6.0) ** 2
        clouds.append(noise_free(one)[keep])
    some = rng.choice(len(clouds[0]), min(25_000, len(clouds[0])), replace=False)
    shift, angle, used = point_to_plane(clouds[0][some], clouds[1])
    assert used > 300
    assert np.abs(shift).max() < 2e-4
    assert angle < 0.002


def test_nearest_neighbours_at_the_truth_lie_within_the_sampling(scanned: Scanned) -> None:
    site, scans = scanned
    step = np.radians(site.scanner.angular_step_deg)
    compared = 0
    for a, b in ((0, 1), (1, 0), (1, 2), (2, 1)):
        origin = scans[b].project_from_station[:3, 3]
        points = still_points(scans[a])
        distance, _ = cKDTree(measured(scans[b])).query(points)
        far = np.linalg.norm(points - origin, axis=1)
        in_view = reaches(site.still, origin, points, 12.0, np.radians(-55.0)) & (far > 2.0)
        if in_view.sum() < 50:
            continue
        compared += 1
        assert np.median(distance[in_view] / far[in_view]) < 2.0 * step
    assert compared >= 2


def test_stated_overlap_is_what_a_neighbour_search_finds(scanned: Scanned) -> None:
    site, scans = scanned
    samples = [still_points(one) for one in scans]
    step = np.radians(site.scanner.angular_step_deg)
    trees = [cKDTree(noise_free(one)[one.fixed]) for one in scans]
    for pair in pair_overlaps(site, samples):
        a, b = site.names.index(pair["a"]), site.names.index(pair["b"])
        for own, other, stated in ((a, b, pair["overlap_a"]), (b, a, pair["overlap_b"])):
            points = samples[own]
            distance, _ = trees[other].query(points)
            far = np.linalg.norm(points - site.poses[other][:3, 3], axis=1)
            # Beams fall this far apart there on surfaces up to 70 degrees from head-on.
            found = np.mean(distance < 0.05 + step * far / np.cos(np.radians(70)))
            assert abs(found - stated) < 0.15, (pair, found)
