import dataclasses
import errno
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pye57
import pytest
from pypcd4 import PointCloud
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from trihedral.cli import app
from trihedral.errors import InputError, OptionError, OutputError
from trihedral.export import registered
from trihedral.export.registered import export
from trihedral.io import read_headers, read_scan
from trihedral.io.e57 import E57Scan, write_e57
from trihedral.model.registration import Registration
from trihedral.model.station import StationResult, StationStatus
from trihedral.output_folder import OWN_FOLDER, OutputFolder
from trihedral.report import Input, to_document, write_result


def pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(rng.normal(0, 0.4, 3)).as_matrix()
    out[:3, 3] = rng.normal(0, 20, 3)
    return out


def points(seed: int, count: int = 400) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 8, (count, 3)).astype(np.float32)


@dataclasses.dataclass
class Made:
    out: Path
    truth: dict[str, np.ndarray]  # points in project coordinates by name of the scan
    sources: list[Path]


def job(folder: Path, *, unplaced: tuple[str, ...] = (), apart: tuple[str, ...] = ()) -> Made:
    """Two scans in one E57 file, one as PCD, one as PTX with a grid; and the result of registering them."""
    raw = folder / "raw"
    raw.mkdir(parents=True)
    color = np.random.default_rng(9).integers(0, 256, (400, 3), dtype=np.uint8)
    write_e57(
        raw / "site.e57",
        [
            E57Scan("a", points(1), color=color, intensity=np.linspace(0, 1, 400, dtype=np.float32)),
            E57Scan("b/c", points(2), pose=pose(50)),
        ],
    )
    PointCloud.from_xyz_points(points(3)).save(raw / "site.pcd")
    cells = points(4, 20)
    rows = "\n".join(" ".join(f"{value:.4f}" for value in xyz) + " 0.5" for xyz in cells)
    unit = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    (raw / "d.ptx").write_text(f"5\n4\n{unit}{rows}\n")
    sources = [raw / "site.e57", raw / "site.pcd", raw / "d.ptx"]
    headers = [header for source in sources for header in read_headers(source)]
    names = ["site/a", "site/b/c", "site", "d"]
    stations, truth = [], {}
    for index, (name, header) in enumerate(zip(names, headers, strict=True)):
        scan = read_scan(header)
        placed = None if name in unplaced else pose(index + 10)
        if placed is not None:
            truth[name] = scan.xyz @ placed[:3, :3].T + placed[:3, 3]
        stations.append(
            StationResult(
                name=name,
                header=header,
                points=len(scan),
                pose=placed,
                tied=True,
                component=None if placed is None else int(name in apart),
                status=StationStatus.VERIFIED if placed is not None else StationStatus.NOT_PLACED,
                reason=None if placed is not None else "no link to any other scan",
            )
        )
    inputs = [
        Input(str(path), hashlib.sha256(path.read_bytes()).hexdigest(), path.stat().st_size)
        for path in sources
    ]
    out = folder / "out"
    out.mkdir()
    write_result(to_document(Registration(tuple(stations), (), ()), inputs), out / "registration.json")
    return Made(out, truth, sources)


def paged(path: Path) -> bytes:
    """What the pages of an E57 file hold, without their checksums."""
    data = path.read_bytes()
    return b"".join(data[at : at + 1020] for at in range(0, len(data), 1024))


def test_laz_one_a_scan(tmp_path: Path) -> None:
    made = job(tmp_path)
    done = export(made.out, "laz")
    names = ["d.laz", "site.laz", "site_a.laz", "site_b_c.laz"]
    assert [path.name for path in done.files] == names
    assert {path.parent for path in done.files} == {made.out / "export"} and not done.left_out
    for file, name in zip(done.files, ["d", "site", "site/a", "site/b/c"], strict=True):
        np.testing.assert_allclose(laspy.read(file).xyz, made.truth[name], atol=1e-4)


def test_ply_and_pcd_merged(tmp_path: Path) -> None:
    made = job(tmp_path)
    truth = np.concatenate([made.truth[name] for name in ("d", "site", "site/a", "site/b/c")])
    [path] = export(made.out, "pcd", tmp_path / "elsewhere", merged=True).files
    assert path == tmp_path / "elsewhere" / "merged.pcd"
    np.testing.assert_allclose(PointCloud.from_path(path).numpy(("x", "y", "z")), truth, atol=1e-4)
    [path] = export(made.out, "ply", merged=True).files
    [header] = read_headers(path)
    assert header.points == len(truth) and header.has_color and header.has_intensity


def test_ptx_keeps_grid_and_pose(tmp_path: Path) -> None:
    made = job(tmp_path)
    [path] = export(made.out, "ptx", merged=True).files
    headers = read_headers(path)
    assert [header.grid for header in headers] == [(4, 5), None, None, None]
    for header, name in zip(headers, ["d", "site", "site/a", "site/b/c"], strict=True):
        found = read_scan(header).xyz @ header.file_pose[:3, :3].T + header.file_pose[:3, 3]
        np.testing.assert_allclose(found, made.truth[name], atol=1e-5)


def test_e57_is_a_copy_with_poses(tmp_path: Path) -> None:
    made = job(tmp_path)
    done = export(made.out, "e57")
    assert [path.name for path in done.files] == ["d.e57", "site.e57", "site-2.e57"]
    for path, members in zip(done.files, [["d"], ["site"], ["site/a", "site/b/c"]], strict=True):
        file = pye57.E57(str(path))
        assert file.scan_count == len(members)
        for index, name in enumerate(members):
            data = file.read_scan(index, ignore_missing_fields=True, transform=True)
            found = np.stack([data[f"cartesian{axis}"] for axis in "XYZ"], axis=1)
            np.testing.assert_allclose(found, made.truth[name], atol=1e-5)
    # The points lie before the XML section and are the source's own, byte for byte.
    copied, source = (paged(path) for path in (done.files[2], made.sources[0]))
    end = source.index(b"<?xml")
    assert copied[48:end] == source[48:end]


def test_unplaced_scans_are_left_out_and_named(tmp_path: Path) -> None:
    made = job(tmp_path, unplaced=("site/b/c", "d"))
    done = export(made.out, "e57")
    assert [name for name, _ in done.left_out] == ["d", "site/b/c"]
    assert [path.name for path in done.files] == ["site.e57", "site-2.e57"]
    file = pye57.E57(str(done.files[1]))
    assert file.scan_count == 1
    assert any("written anew, not copied" in note for note in done.notes)


def test_groups_without_a_common_frame_are_not_merged(tmp_path: Path) -> None:
    made = job(tmp_path, apart=("site/b/c",))
    done = export(made.out, "laz", merged=True)
    assert [path.name for path in done.files] == ["merged.laz", "merged-2.laz"]
    np.testing.assert_allclose(laspy.read(done.files[1]).xyz, made.truth["site/b/c"], atol=1e-4)
    assert any("site/b/c" in note for note in done.notes)


def test_a_changed_or_missing_source_is_refused(tmp_path: Path) -> None:
    made = job(tmp_path)
    text = made.sources[2].read_text()
    made.sources[2].write_text(text.replace("0.5", "0.6", 1))
    with pytest.raises(InputError, match=r"d\.ptx: it has changed since it was registered"):
        export(made.out, "laz")
    made.sources[2].write_text(text + "\n")
    with pytest.raises(InputError, match="changed"):
        export(made.out, "laz")
    made.sources[2].unlink()
    with pytest.raises(InputError, match="no such file"):
        export(made.out, "laz")
    assert {path.name for path in (made.out / "export").iterdir()} == {OWN_FOLDER}


def test_nothing_that_is_not_ours_is_replaced(tmp_path: Path) -> None:
    made = job(tmp_path)
    with pytest.raises(OutputError, match="one of the scans that were registered"):
        export(made.out, "e57", tmp_path / "raw")
    kept = tmp_path / "mine" / "site.laz"
    kept.parent.mkdir()
    kept.write_text("survey of 2019")
    with pytest.raises(OutputError, match="trihedral did not write it"):
        export(made.out, "laz", kept.parent)
    assert kept.read_text() == "survey of 2019"
    first = export(made.out, "laz").files
    assert export(made.out, "laz").files == first
    with pytest.raises(OptionError, match="laz"):
        export(made.out, "dxf")  # type: ignore[arg-type]


def test_what_a_killed_export_left_is_removed(tmp_path: Path) -> None:
    made = job(tmp_path)
    OutputFolder(made.out / "export").close()
    (made.out / "export" / f".trihedral-{32 * 'a'}.part").write_text("half")
    export(made.out, "laz", merged=True)
    assert {path.name for path in (made.out / "export").iterdir()} == {OWN_FOLDER, "merged.laz"}


def test_no_placed_scan(tmp_path: Path) -> None:
    made = job(tmp_path, unplaced=("site/a", "site/b/c", "site", "d"))
    with pytest.raises(InputError, match="no scan is placed"):
        export(made.out, "ply")


def test_the_files_are_read_as_they_were_registered(tmp_path: Path) -> None:
    """Units that the user stated for the job hold for its export."""
    source = tmp_path / "mm.xyz"
    source.write_text("1000 2000 3000\n-1000 500 250\n")
    document = {
        "schema": "trihedral.registration/1",
        "software": {"version": "0", "options": {"read": {"units": "mm", "scanner_origin": None}}, "seed": 0},
        "inputs": [
            {
                "path": str(source),
                "sha256": hashlib.sha256(source.read_bytes()).hexdigest(),
                "bytes": source.stat().st_size,
            }
        ],
        "verdict": {"exit": 0, "text": ""},
        "stations": [
            {
                **{
                    "name": "mm",
                    "source": str(source),
                    "scan_index": 0,
                    "points": 2,
                    "pose": np.eye(4).tolist(),
                },
                **{"tied": False, "component": 0, "status": "verified", "reason": None},
            }
        ],
        **{"links": [], "loops": [], "timing": {}},
    }
    (tmp_path / "registration.json").write_text(json.dumps(document))
    [path] = export(tmp_path, "laz").files
    np.testing.assert_allclose(laspy.read(path).xyz, [[1, 2, 3], [-1, 0.5, 0.25]], atol=1e-9)


def test_the_command(tmp_path: Path) -> None:
    made = job(tmp_path, unplaced=("d",))
    result = CliRunner().invoke(
        app, ["export", str(made.out), "--format", "ply", "--merged", "-q"], standalone_mode=False
    )
    assert result.return_value == 0
    assert result.stdout.strip() == str(made.out / "export" / "merged.ply")
    assert "not exported: d: no link to any other scan" in result.stderr


def places(value: object, at: tuple[object, ...] = ()) -> Iterator[tuple[object, ...]]:
    """Where values of a document are, those of matrices as one."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, one in inner:
        yield (*at, key)
        if key not in ("pose", "transform"):
            yield from places(one, (*at, key))


def test_a_result_with_any_value_of_another_kind_is_refused_or_exported(tmp_path: Path) -> None:
    made = job(tmp_path)
    path = made.out / "registration.json"
    whole = json.loads(path.read_text())
    refused = 0
    for count, at in enumerate([*places(whole)]):
        document = json.loads(json.dumps(whole))
        holder = document
        for key in at[:-1]:
            holder = holder[key]
        holder[at[-1]] = [[], {}, "x", -1, 1e400, 10**400, None, [["a", 1]]][count % 8]
        path.write_text(json.dumps(document))
        try:
            export(made.out, "ply", tmp_path / "to" / str(count))
        except (InputError, OptionError) as error:
            refused += "registration.json" in str(error)
    assert refused > 30


def test_an_export_goes_on_where_a_failed_one_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = job(tmp_path)
    whole = {path.name: path.read_bytes() for path in export(made.out, "ply", tmp_path / "whole").files}
    target = tmp_path / "elsewhere"
    write, written = registered._write_points, []

    def failing(path: Path, *rest: Any) -> None:
        if len(written) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(path)
        write(path, *rest)

    monkeypatch.setattr(registered, "_write_points", failing)
    with pytest.raises(OutputError, match="the disk is full"):
        export(made.out, "ply", target)
    kept = {path.name: path.stat().st_mtime_ns for path in target.glob("*.ply")}
    assert len(kept) == 2
    monkeypatch.setattr(registered, "_write_points", write)
    done = export(made.out, "ply", target).files
    assert {path.name: path.read_bytes() for path in done} == whole
    assert {path.name: path.stat().st_mtime_ns for path in done if path.name in kept} == kept
    assert {path.name for path in target.iterdir()} == {OWN_FOLDER, *whole}


def test_two_exports_at_once_do_not_meet(tmp_path: Path) -> None:
    made = job(tmp_path)
    with OutputFolder(made.out / "export"), pytest.raises(OutputError, match="another run of trihedral"):
        export(made.out, "ply")


def test_a_linked_export_folder_is_not_followed(tmp_path: Path) -> None:
    made = job(tmp_path)
    (tmp_path / "foreign").mkdir()
    (made.out / "export").symlink_to(tmp_path / "foreign")
    with pytest.raises(OutputError, match="it is a link"):
        export(made.out, "ply")
    assert list((tmp_path / "foreign").iterdir()) == []
