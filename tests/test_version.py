"""The fingerprint that stored results carry."""

import pytest

from trihedral import version


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with a room, a file and a folder that holds no source."""
    for path in ("version.py", "room/one.py", "room/inside/two.py", "file.py", "empty/notes.txt"):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(path)
    monkeypatch.setattr(version, "__file__", str(tmp_path / "version.py"))
    return tmp_path


def test_what_a_part_says_is_in_the_fingerprint_and_nothing_else(package):
    before = version.fingerprint("room"), version.fingerprint("room", "file.py")
    assert before[0] != before[1]
    (package / "file.py").write_text("changed")
    assert version.fingerprint("room") == before[0]
    assert version.fingerprint("room", "file.py") != before[1]
    (package / "room/inside/two.py").write_text("changed")
    assert version.fingerprint("room") != before[0]


@pytest.mark.parametrize("part", ["rooms", "room/missing.py", "empty"])
def test_a_part_without_source_is_refused_by_its_name(package, part):
    with pytest.raises(ValueError, match=part):
        version.fingerprint("room", part)
