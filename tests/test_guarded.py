"""Input files: regular ones only, read as they are, errors that name them."""

import os
from pathlib import Path

import pytest

from trihedral.errors import InputError, OptionError
from trihedral.guarded import blamed_on, open_input, read_bytes, read_toml, stamp_of
from trihedral.io.camera import FORMAT as CAMERA_FORMAT
from trihedral.io.camera import read_camera
from trihedral.io.scanner_origins import read_scanner_origins
from trihedral.network.constraints.file import read_constraints


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


def test_what_is_no_regular_file_is_refused_without_waiting(pipe: Path, tmp_path: Path) -> None:
    for path in (pipe, Path("/dev/zero"), tmp_path):
        with pytest.raises(InputError, match=r"regular file|folder"):
            read_bytes(path)


def test_tables_do_not_wait_for_the_pipe_that_they_name(pipe: Path, tmp_path: Path) -> None:
    site = tmp_path / "trihedral.toml"
    for text in ('[control]\npoints = "pipe"\n', '[[fixed]]\nfrom = "pipe"\n'):
        site.write_text(text)
        with pytest.raises(InputError, match=r"pipe.*not a regular file"):
            read_constraints(site)
    with pytest.raises(InputError, match="not a regular file"):
        read_scanner_origins(pipe)


def test_a_zero_byte_in_a_name_is_said(tmp_path: Path) -> None:
    site = tmp_path / "trihedral.toml"
    site.write_text('[control]\npoints = "a\\u0000b"\n')
    with pytest.raises(InputError, match="no file can have that name"):
        read_constraints(site)


@pytest.mark.parametrize(
    "text",
    ["a = " + "9" * 5000, "a = " + "[" * 5000 + "]" * 5000, "a = [1", "a = 1\n\0"],
    ids=["digits", "nested", "open", "zero"],
)
def test_toml_that_python_cannot_hold_is_no_valid_toml(tmp_path: Path, text: str) -> None:
    path = tmp_path / "trihedral.toml"
    path.write_text(text)
    for read in (read_toml, read_constraints, read_camera, read_scanner_origins):
        with pytest.raises(InputError, match="no valid TOML"):
            read(path)


@pytest.mark.parametrize("number", ["9" * 400, "-" + "9" * 400, "1e308", "nan", "true"])
def test_numbers_that_no_measurement_has_are_refused(tmp_path: Path, number: str) -> None:
    site = tmp_path / "trihedral.toml"
    for text in (
        f"[level]\nsigma_arcsec = {number}\n",
        f'[[locked]]\nfrom = "a"\nto = "b"\nsigma_mm = {number}\n',
        f'[[control.point]]\nname = "p"\nxyz = [{number}, 0, 0]\n',
        f'[[control.point]]\nname = "p"\nxyz = [1, 0, 0]\nsigma_mm = [{number}, 1, 1]\n',
        f'[fixed]\nstation = "a"\npose = [[1,0,0,{number}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n',
    ):
        if number == "true" and "pose" in text:
            continue
        site.write_text(text)
        with pytest.raises((InputError, OptionError), match=r"trihedral\.toml"):
            read_constraints(site)
    camera = tmp_path / "camera.toml"
    camera.write_text(f'format = "{CAMERA_FORMAT}"\nwidth = 10\nheight = 10\nfocal_px = [{number}, 5]\n')
    with pytest.raises(InputError, match="focal_px"):
        read_camera(camera)


@pytest.mark.parametrize("sigma", ["1e-320", "1e-7", "1e10", "-1", "0"])
def test_sigmas_are_those_that_a_measurement_can_have(tmp_path: Path, sigma: str) -> None:
    site = tmp_path / "trihedral.toml"
    site.write_text(f"[level]\nsigma_arcsec = {sigma}\n")
    with pytest.raises(InputError, match=r"level\.sigma_arcsec"):
        read_constraints(site)


def test_whatever_goes_wrong_is_blamed_on_the_file(tmp_path: Path) -> None:
    class PanicException(BaseException):
        pass

    for error in (IndexError("list index"), MemoryError(), PanicException("overflow"), OSError(5, "I/O")):
        with pytest.raises(InputError, match=r"scan\.las"), blamed_on(tmp_path / "scan.las"):
            raise error
    for error in (KeyboardInterrupt(), SystemExit(3), OptionError("which")):
        with pytest.raises(type(error)), blamed_on(tmp_path / "scan.las"):
            raise error


def test_a_state_tells_a_change_that_was_made_to_look_old(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"one")
    before, times = stamp_of(path), path.stat()
    path.write_bytes(b"two")
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    after = stamp_of(path)
    assert (after.bytes, after.modified_ns) == (before.bytes, before.modified_ns)
    assert after != before


def test_no_more_is_read_than_the_file_held_when_it_was_opened(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"x" * 100)
    with pytest.raises(InputError, match="more than the 10"):
        read_bytes(path, most=10)
    with open_input(path) as stream:
        assert stream.read() == b"x" * 100
