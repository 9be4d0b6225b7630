import errno
import os
from pathlib import Path

import pytest

from trihedral.errors import InputError, OptionError
from trihedral.io import ReadOptions, detect, find_inputs, read_headers, read_scan

ROWS = "1 2 3\n-4 5 6\n7 -8 9\n"


def test_content_decides_not_the_suffix(tmp_path: Path, shared: Path) -> None:
    formats = shared / "data/formats"
    samples = {
        "e57": formats / "e57/bunnyFloat.e57",
        "ptx": formats / "ptx/no-color.ptx",
        "pts": formats / "pts/test.pts",
        "laz": formats / "las/indoor.laz",
        "pcd": formats / "pcd/utm17_tab.pcd",
    }
    for kind, sample in samples.items():
        disguised = tmp_path / f"{kind}.jpg"
        disguised.symlink_to(sample)
        assert detect(disguised) == kind
    (tmp_path / "rows.las").write_text(ROWS)
    assert detect(tmp_path / "rows.las") == "xyz"


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "empty"),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "binary file of no known point format"),
        (b"Dear surveyor,\nhere are the scans.\n", "not rows of point coordinates"),
        (ROWS.encode("utf-16"), "UTF-16"),
        (b"name,qw,qx\nA,1,0\nB,1,0\n", "not rows of point coordinates"),
    ],
)
def test_what_is_no_scan_says_why(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "scan.e57"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"scan\.e57: .*{reason}"):
        detect(path)


def test_folders_and_missing_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="folder, not a file"):
        detect(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        find_inputs([tmp_path / "none.e57"])
    with pytest.raises(InputError, match="no scans"):
        find_inputs([tmp_path])
    (tmp_path / "notes.txt").write_text("to do: survey\n")
    (tmp_path / "result.json").write_text("{}")
    with pytest.raises(InputError, match="no scans"):
        find_inputs([tmp_path])


def test_a_folder_gives_its_scans_once_in_order(tmp_path: Path) -> None:
    for name in ("b.xyz", "a.csv", ".hidden.xyz", "readme.txt"):
        (tmp_path / name).write_text(ROWS if name != "readme.txt" else "hello\n")
    (tmp_path / "broken.e57").write_text("no")
    (tmp_path / "again.xyz").symlink_to(tmp_path / "b.xyz")
    found = find_inputs([tmp_path, tmp_path / "b.xyz"])
    assert [path.name for path in found] == ["a.csv", "again.xyz", "broken.e57"]
    assert len(found) == len({path.resolve() for path in found})


def test_one_folder_a_setup(tmp_path: Path) -> None:
    for name in ("setup2", "setup1"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scan.xyz").write_text(ROWS)
    assert [path.parent.name for path in find_inputs([tmp_path])] == ["setup1", "setup2"]


def test_no_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "locked.xyz"
    path.write_text(ROWS)

    def refuse(*_: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(os, "open", refuse)  # the superuser may read a file of mode 000
    with pytest.raises(InputError, match="no permission"):
        read_headers(path)


def test_scanner_far_outside_its_points_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "map.xyz"
    path.write_text("100 100 0\n101 102 1\n103 101 2\n")
    with pytest.raises(InputError, match="cannot be at"):
        read_scan(read_headers(path)[0])
    options = ReadOptions(scanner_origin=(0.0, 0.0, 0.0))
    scan = read_scan(read_headers(path, options)[0], options)
    assert len(scan) == 3 and scan.header.origin_stated


def test_options_are_checked() -> None:
    with pytest.raises(OptionError, match="units"):
        ReadOptions(units="km")  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="scanner origin"):
        ReadOptions(scanner_origin=(0.0, float("nan"), 0.0))
