import re
import struct
from pathlib import Path

import numpy as np
import pye57
import pytest

from support.e57_files import JPEG, by_pye57, cameras, motion, pictures_by_pye57
from support.e57_pages import PAYLOAD, check_checksums, content, header, logical, pages, with_xml, xml
from trihedral.errors import InputError, OutputError
from trihedral.io import read_headers, read_photos, read_scan
from trihedral.io.e57 import E57Scan, copy_with_poses, write_e57
from trihedral.scan import Photo

E57 = "data/formats/e57"
FILES = [
    *(f"{E57}/{name}.e57" for name in ("A_B", "bunnyInt19", "tiny_pc_and_images", "tiny_pc_with_extension")),
    *(
        f"{E57}/{name}.e57"
        for name in ("las2e57_no_images_tag", "translationWithoutRotation", "testWithNormals")
    ),
    "data/pump-room/pumpAVisualReferenceImage.e57",
]


def without_poses(text: str) -> str:
    return re.sub(r"<pose .*?</pose>\s*", "", text, flags=re.DOTALL)


@pytest.mark.parametrize("name", FILES)
def test_only_poses_change(shared: Path, tmp_path: Path, name: str) -> None:
    source = shared / name
    before = source.read_bytes()
    rng = np.random.default_rng(1)
    target = tmp_path / "copy.e57"
    poses = {found.scan_index: motion(rng) for found in read_headers(source)}
    copy_with_poses(source, target, poses)
    assert source.read_bytes() == before
    # The binary part is the same byte for byte; of the XML all but the poses is.
    _, offset, _ = header(source)
    assert header(target)[1] == offset
    assert content(target)[48 : logical(offset)] == content(source)[48 : logical(offset)]
    whole = offset // 1024
    assert pages(target)[1:whole] == pages(source)[1:whole]
    assert without_poses(xml(target)) == without_poses(xml(source).rstrip("\0"))
    # The file is whole.
    check_checksums(target)
    assert header(target)[0] == target.stat().st_size
    # And the independent reader finds the poses, points and pictures.
    reader = pye57.E57(str(target))
    for index, pose in poses.items():
        found = reader.get_header(index)
        np.testing.assert_allclose(found.rotation_matrix, pose[:3, :3], atol=1e-12)
        np.testing.assert_array_equal(found.translation, pose[:3, 3])
        old, new = by_pye57(source, index), by_pye57(target, index)
        assert old.keys() == new.keys()
        for field, values in old.items():
            np.testing.assert_array_equal(new[field], values)
    if "images2D" in [reader.root[i].elementName() for i in range(reader.root.childCount())]:
        assert pictures_by_pye57(target) == pictures_by_pye57(source)


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Three scans; the second has pictures of all kinds, and one without a pose."""
    rng = np.random.default_rng(2)
    photos = [
        Photo(kind, "jpeg", JPEG + kind.encode(), camera, motion(rng)) for kind, camera in cameras().items()
    ]
    photos.append(Photo("loose", "jpeg", JPEG, cameras()["pinhole"], None))
    path = tmp_path / "site.e57"
    write_e57(
        path,
        [
            E57Scan("a", rng.normal(size=(4000, 3)), pose=motion(rng)),
            E57Scan("b", rng.normal(size=(4000, 3)), pose=motion(rng), photos=photos),
            E57Scan("c", rng.normal(size=(4000, 3))),
        ],
    )
    return path


def test_pictures_move_with_their_scan_and_others_stay(site: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    target = tmp_path / "moved.e57"
    poses = {1: motion(rng), 2: motion(rng)}
    copy_with_poses(site, target, poses)
    check_checksums(target)
    before, after = read_headers(site), read_headers(target)
    np.testing.assert_array_equal(after[0].file_pose, before[0].file_pose)
    for index, pose in poses.items():
        np.testing.assert_allclose(after[index].file_pose, pose, atol=1e-12)
    # In its station a picture stays where it was: it moved along.
    for old, new in zip(read_photos(before[1]), read_photos(after[1]), strict=True):
        assert (new.data, new.camera, new.name) == (old.data, old.camera, old.name)
        if old.station_from_camera is None:
            assert new.station_from_camera is None
        else:
            np.testing.assert_allclose(new.station_from_camera, old.station_from_camera, atol=1e-11)
    # In the file it is where the new pose puts it (by the independent reader).
    reader = pye57.E57(str(target))
    old_reader = pye57.E57(str(site))
    pairs = zip(reader.image_file.root()["images2D"], old_reader.image_file.root()["images2D"], strict=True)
    moved = 0
    for new, old in pairs:
        if not old.isDefined("pose"):
            assert not new.isDefined("pose")
            continue
        centres = [[image["pose"]["translation"][axis].value() for axis in "xyz"] for image in (new, old)]
        expected = poses[1] @ np.linalg.inv(before[1].file_pose) @ [*centres[1], 1.0]
        np.testing.assert_allclose(centres[0], expected[:3], atol=1e-9)
        moved += 1
    assert moved == 4


def test_no_pose_at_all_gives_the_same_file(site: Path, tmp_path: Path) -> None:
    target = tmp_path / "same.e57"
    copy_with_poses(site, target, {})
    assert target.read_bytes() == site.read_bytes()


def test_moving_there_and_back_changes_nothing(site: Path, tmp_path: Path) -> None:
    there, back = tmp_path / "there.e57", tmp_path / "back.e57"
    original = {found.scan_index: found.file_pose for found in read_headers(site) if found.scan_index < 2}
    rng = np.random.default_rng(4)
    copy_with_poses(site, there, {index: motion(rng) for index in original})
    copy_with_poses(there, back, original)
    assert header(back)[:2] == header(site)[:2]
    for old, new in zip(read_headers(site), read_headers(back), strict=True):
        if old.file_pose is not None:
            np.testing.assert_allclose(new.file_pose, old.file_pose, atol=1e-12)
        for one, other in zip(read_photos(old), read_photos(new), strict=True):
            if one.station_from_camera is not None:
                np.testing.assert_allclose(other.station_from_camera, one.station_from_camera, atol=1e-11)


@pytest.mark.parametrize("gap", [b"", bytes(7), bytes(3000)])
def test_the_xml_may_sit_before_the_data(site: Path, tmp_path: Path, gap: bytes) -> None:
    """A file whose XML is followed by data: a blob of an extension that the XML refers to."""
    blob = struct.pack("<QQ", 0, 16 + 900) + bytes(range(225)) * 4
    text = xml(site).replace("<e57Root ", '<e57Root xmlns:x="urn:x" ', 1)
    place = 10**9
    for _ in range(3):  # the offset's own digits move the blob
        named = text.replace(
            "</e57Root>",
            f'<x:extra type="Blob" fileOffset="{place}" length="900"/></e57Root>',
        )
        _, offset, _ = header(site)
        at = logical(offset) + len(named.encode()) + len(gap)
        place = at // PAYLOAD * 1024 + at % PAYLOAD
    source = with_xml(site, named, tmp_path / "early.e57", after=gap + blob + bytes(5000))
    assert content(source)[logical(place) : logical(place) + len(blob)] == blob
    target = tmp_path / "copy.e57"
    pose = motion(np.random.default_rng(5))
    copy_with_poses(source, target, {0: pose})
    check_checksums(target)
    assert header(target)[0] == target.stat().st_size
    assert content(target)[48 : len(content(source))] == content(source)[48:]
    assert without_poses(xml(target)) == without_poses(named)
    np.testing.assert_allclose(read_headers(target)[0].file_pose, pose, atol=1e-12)
    reader = pye57.E57(str(target))
    np.testing.assert_allclose(reader.get_header(0).rotation_matrix, pose[:3, :3], atol=1e-12)
    for old, new in zip(read_headers(site), read_headers(target), strict=True):
        np.testing.assert_array_equal(read_scan(new).xyz, read_scan(old).xyz)


def test_what_an_extension_keeps_in_a_pose_and_odd_xml_survive(site: Path, tmp_path: Path) -> None:
    text = xml(site).replace("\n", "\r\n")
    text = text.replace("<e57Root ", '<!-- öäü & <pose> -->\r\n<e57Root  xmlns:x="urn:x" ', 1)
    text = text.replace("</rotation>", '</rotation> <x:sigma type="Float">0.5</x:sigma><!-- kept? -->', 1)
    text = text.replace(
        '<points type="CompressedVector"', '<pose type="Structure"/><points type="CompressedVector"'
    )
    first = text.index('<pose type="Structure"/>')
    text = text[:first] + text[first + len('<pose type="Structure"/>') :]
    second = text.index('<pose type="Structure"/>')
    text = text[:second] + text[second + len('<pose type="Structure"/>') :]
    source = with_xml(site, text, tmp_path / "odd.e57")
    rng = np.random.default_rng(6)
    poses = {0: motion(rng), 2: motion(rng)}
    target = tmp_path / "copy.e57"
    copy_with_poses(source, target, poses)
    check_checksums(target)
    assert '<x:sigma type="Float">0.5</x:sigma>' in xml(target)
    assert "<!-- öäü & <pose> -->\r\n" in xml(target)
    for index, found in enumerate(read_headers(target)):
        expected = poses[index] if index in poses else read_headers(source)[index].file_pose
        np.testing.assert_allclose(found.file_pose, expected, atol=1e-12)


def test_a_prefix_for_the_standard_itself_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "plain.e57"
    write_e57(path, [E57Scan("a", np.ones((5, 3)))])
    text = re.sub(r"<(/?)(?![?!])(\w)", r"<\1e:\2", xml(path)).replace("xmlns=", "xmlns:e=")
    source = with_xml(path, text, tmp_path / "prefixed.e57")
    pose = motion(np.random.default_rng(7))
    target = tmp_path / "copy.e57"
    copy_with_poses(source, target, {0: pose})
    assert '<e:pose type="Structure">' in xml(target)
    np.testing.assert_allclose(read_headers(target)[0].file_pose, pose, atol=1e-12)


def test_the_reference_system_is_named_in_new_files_and_in_copies(site: Path, tmp_path: Path) -> None:
    """Read by pye57; named twice, the second name stands."""
    first, second = tmp_path / "first.e57", tmp_path / "second.e57"
    copy_with_poses(site, first, {0: motion(np.random.default_rng(1))}, "EPSG:25832")
    copy_with_poses(first, second, {}, "PROJCS[a]")
    written = tmp_path / "written.e57"
    write_e57(written, [E57Scan(name="a", xyz=np.eye(3))], crs="EPSG:25832")
    for path, name in ((first, "EPSG:25832"), (second, "PROJCS[a]"), (written, "EPSG:25832")):
        check_checksums(path)
        file = pye57.E57(str(path))
        assert file.image_file.root()["coordinateMetadata"].value() == name
    assert xml(second).replace("PROJCS[a]", "EPSG:25832") == xml(first)


def test_damage_anywhere_in_the_source_is_named_and_leaves_no_copy(site: Path, tmp_path: Path) -> None:
    data = site.read_bytes()
    rng = np.random.default_rng(8)
    folder = tmp_path / "out"
    folder.mkdir()
    broken = tmp_path / "broken.e57"
    for at in rng.integers(48, len(data), 60):
        changed = bytearray(data)
        changed[at] ^= 0x10
        broken.write_bytes(changed)
        with pytest.raises(InputError, match="damaged"):
            copy_with_poses(broken, folder / "copy.e57", {0: np.eye(4)})
    assert list(folder.iterdir()) == []


def test_impossible_copies_are_refused(site: Path, tmp_path: Path) -> None:
    before = site.read_bytes()
    with pytest.raises(InputError, match="source and the target"):
        copy_with_poses(site, site, {})
    with pytest.raises(InputError, match="no scan 3"):
        copy_with_poses(site, tmp_path / "copy.e57", {3: np.eye(4)})
    with pytest.raises(ValueError, match="pose of scan 0"):
        copy_with_poses(site, tmp_path / "copy.e57", {0: np.zeros((4, 4))})
    with pytest.raises(OutputError, match="No such file"):
        copy_with_poses(site, tmp_path / "missing" / "copy.e57", {})
    with pytest.raises(InputError):
        copy_with_poses(tmp_path / "missing.e57", tmp_path / "copy.e57", {})
    assert site.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["site.e57"]
