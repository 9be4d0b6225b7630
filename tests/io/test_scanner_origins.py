from pathlib import Path

import pytest

from trihedral.errors import InputError
from trihedral.io.scanner_origins import read_scanner_origins

EXPECTED = (("s1.las", (1.5, -2.0, 3.0)), ("station 2", (2_600_000.25, 1_200_000.5, 400.0)))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("t.csv", "file,x,y,z\ns1.las,1.5,-2,3\nstation 2,2600000.25,1200000.5,400\n"),
        ("t.csv", "# by hand\ns1.las;1,5;-2;3\nstation 2;2600000,25;1200000,5;400\n"),
        ("t.txt", "name E N H\ns1.las 1.5 -2 3\n\nstation 2 2600000.25 1200000.5 400\n"),
        ("t.tsv", "s1.las\t1.5\t-2\t3\nstation 2\t2600000.25\t1200000.5\t400\n"),
        ("t.csv", '\ufeff"s1.las", 1.5, -2, 3\n"station 2", 2600000.25, 1200000.5, 400\n'),
        ("t.toml", '"s1.las" = [1.5, -2, 3]\n"station 2" = [2600000.25, 1200000.5, 400]\n'),
    ],
)
def test_tables_of_any_common_form(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    assert read_scanner_origins(tmp_path / name) == EXPECTED


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("t.csv", "", "no positions"),
        ("t.csv", "a,1,2\n", "line 1: a name and three numbers"),
        ("t.csv", "a,1,2,3\na,1,2,3\n", "'a' is given twice"),
        ("t.csv", "a,1,2,3\nb,1,nan,3\n", "line 2: .*finite"),
        ("t.csv", "a,1,2,3\nb,1,x,3\n", "line 2: .*not three numbers"),
        ("t.toml", "a = [1, 2]", "not three numbers"),
        ("t.toml", "a = 1 2", "no valid TOML"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, name: str, text: str, says: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=says):
        read_scanner_origins(tmp_path / name)
