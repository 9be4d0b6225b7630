import json
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from support.stations import in_project, scanner_of, stations
from trihedral.cli import app
from trihedral.io.e57 import E57Scan, write_e57

runner = CliRunner()


def run(*arguments: str) -> tuple[int, str, str]:
    result = runner.invoke(app, ["info", *arguments], standalone_mode=False)
    assert result.exception is None, result.exception
    return int(result.return_value), result.stdout, result.stderr


def test_what_a_person_reads(shared: Path) -> None:
    code, text, errors = run(str(shared / "data/pump-room"))
    assert code == 0 and errors == ""
    for piece in (
        "E57",
        "155,201 points",
        "1,074 rows x 345 columns",
        "visual-reference, 3072 x 2304",
        "(stated)",
    ):
        assert piece in text


def test_assumptions_are_called_so(shared: Path) -> None:
    _, text, _ = run(str(shared / "data/eth-facade/s0.pcd"))
    assert "units     m (assumed)" in text
    assert "scanner   0.000, 0.000, 0.000 m (assumed)" in text


def test_what_a_program_reads(shared: Path) -> None:
    code, text, _ = run("--json", str(shared / "data/formats/ptx/complex-transform.ptx"))
    [entry] = json.loads(text)
    assert code == 0 and entry["format"] == "ptx"
    [scan] = entry["scans"]
    assert scan["grid"] == {"rows": 6, "columns": 2}
    assert [row[3] for row in scan["pose"]] == [-3.028748, -3.819741, -1.384333, 1.0]


def test_a_bad_file_does_not_hide_the_good_one(shared: Path, tmp_path: Path) -> None:
    good = tmp_path / "good.xyz"
    good.write_text("1 2 3\n-3 -2 1\n")
    code, text, errors = run(
        str(shared / "data/formats/e57-bad/bad-crc.e57"), str(good), str(tmp_path / "none")
    )
    assert code == 2
    assert "good.xyz: XYZ" in text
    assert "bad-crc.e57" in errors and "none" in errors


def test_points_are_not_read(tmp_path: Path) -> None:
    """A file of any size takes no longer: the records are never touched."""
    path = tmp_path / "sparse.pcd"
    header = (
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        "WIDTH {0}\nHEIGHT 1\nPOINTS {0}\nDATA binary\n"
    )
    count = 10**11
    with path.open("wb") as stream:
        stream.write(header.format(count).encode())
        stream.truncate(stream.tell() + 12 * count)
    code, text, _ = run(str(path))
    assert code == 0 and "100,000,000,000 points" in text


def test_points_are_read_where_it_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "gaps.xyz"
    path.write_text(
        "N;E;H;R;G;B\n"
        + "".join(f"{k % 7 + 1};{k % 9 - 4};{k % 5 - 2};{10 + k};20;{k % 3}\n" for k in range(150))
        + "1;2;3;0;0;0\n" * 50
    )
    _, text, _ = run(str(path))
    assert "by the heading: taken as x y z (2, 1, 3), red green blue (4, 5, 6)" in text
    assert "used" not in text
    code, text, _ = run("--points", str(path))
    assert code == 0
    assert "200 points, colour (75.0% of them have one)" in text
    assert "50 points (25.0%) have no colour" in text
    _, text, _ = run("--points", "--json", str(path))
    [scan] = json.loads(text)[0]["scans"]
    assert scan["used"] == {"points": 200, "colored": 0.75, "color": True, "intensity": False}


def test_where_a_scanner_stood_is_found_for_a_file_that_does_not_say_it(tmp_path: Path) -> None:
    scan = stations("office", 7)[0]
    write_e57(tmp_path / "a.e57", [E57Scan("a", in_project(scan, (1000.0, 2000.0, 0.0)))])
    _, text, _ = run(str(tmp_path / "a.e57"))
    assert "m (found from the points, sigma" in text
    [entry] = json.loads(run("--json", str(tmp_path / "a.e57"))[1])
    [found] = entry["scans"]
    truth = scanner_of(scan, (1000.0, 2000.0, 0.0))
    assert np.abs(np.array(found["scanner_origin"]) - truth).max() < 0.002
    assert max(found["scanner_origin_sigma_m"]) < 0.005
