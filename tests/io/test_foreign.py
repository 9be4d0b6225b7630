"""Files of makers' own formats are named for what they are."""

from pathlib import Path

import pytest

from trihedral.errors import InputError
from trihedral.io import detect, find_inputs
from trihedral.io.foreign import MAKERS


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Scan_001.FLS", "FARO SCENE"),
        ("a.zfs", "Z+F LaserControl"),
        ("a.rcp", "Autodesk ReCap"),
        ("a.rdbx", "RIEGL RiSCAN PRO"),
        ("a.lgsx", "Leica"),
        ("a.ptg", "Leica"),
        ("a.cl3", "Topcon"),
        ("a.tzf", "Trimble RealWorks"),
        ("a.x3a", "Stonex"),
        ("a.dp", "DotProduct"),
    ],
)
@pytest.mark.parametrize("content", [b"\x00\x01\x02binary" * 50, b"<xml>text</xml>\n" * 9])
def test_a_makers_file_is_named_and_what_to_export(
    tmp_path: Path, name: str, said: str, content: bytes
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        detect(path)
    assert said in str(caught.value) and "Export E57" in str(caught.value)
    with pytest.raises(InputError, match="the folder holds no scans that can be read, but 1") as caught:
        find_inputs([tmp_path])
    assert said in str(caught.value) and "E57" in str(caught.value)


def test_a_scan_that_is_a_folder(tmp_path: Path) -> None:
    (tmp_path / "Scan_001.fls").mkdir()
    with pytest.raises(InputError, match="FARO SCENE"):
        find_inputs([tmp_path / "Scan_001.fls"])


def test_the_content_counts_and_not_the_name(tmp_path: Path) -> None:
    path = tmp_path / "rows.bin"
    path.write_text("1 2 3\n4 5 6\n")
    assert detect(path) == "xyz"


def test_every_entry_says_what_to_do() -> None:
    for suffix, (maker, instead) in MAKERS.items():
        assert suffix == suffix.lower() and suffix.startswith(".") and maker and instead
