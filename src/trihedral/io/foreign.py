"""Files that only their makers' programs read, by their suffix: what they are, and what to export instead."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

_E57 = "E57 with one setup a scan (structured, if it can be chosen)"
_FARO = ("FARO SCENE", _E57)
_ZF = ("Z+F LaserControl", _E57)
_RECAP = ("Autodesk ReCap", f"{_E57}; PTS keeps neither setups nor the scanner's place")
_RIEGL = ("RIEGL RiSCAN PRO", f"{_E57}, or LAS of each scan in the scanner's own frame (SOCS)")
_LEICA = ("Leica", f"{_E57} or PTX, from Cyclone or Cyclone REGISTER 360")
_TOPCON = ("Topcon", f"{_E57} or PTX, from ScanMaster or MAGNET Collage")
_TRIMBLE = ("Trimble RealWorks", _E57)
_STONEX = ("Stonex", f"{_E57} or PTX, from Reconstructor")
_DOTPRODUCT = ("DotProduct", _E57)
_SURPHASER = ("Surphaser", f"{_E57} or PTX, from SurphExpress")
_POINTOOLS = ("Bentley Pointools", _E57)
_CLOUDCOMPARE = ("CloudCompare", "E57 (keeps the scanner's place) or PLY, one file a scan")
_ROS = ("ROS", "one PCD a scan, at rest")
_PACKETS = ("a sensor's network packets", "one PCD or LAS a scan, at rest")
_ARCHIVE = ("an archive", "nothing: unpack it")
_MESH = ("a mesh or drawing", "the scans that it was made from")

# Suffix: whose it is, and what to export there instead.
MAKERS = {
    **dict.fromkeys((".fls", ".fws", ".lsproj", ".iqscan", ".iqmod"), _FARO),
    **dict.fromkeys((".zfs", ".zfprj", ".zfc"), _ZF),
    **dict.fromkeys((".rcp", ".rcs", ".pcg"), _RECAP),
    **dict.fromkeys((".rdb", ".rdbx", ".rxp", ".rsp", ".3dd"), _RIEGL),
    **dict.fromkeys((".lgs", ".lgsx", ".ptg", ".imp", ".blk", ".b2g"), _LEICA),
    **dict.fromkeys((".cl3", ".clr"), _TOPCON),
    **dict.fromkeys((".tzf", ".tzs", ".tdx", ".rwp"), _TRIMBLE),
    ".x3a": _STONEX,
    ".dp": _DOTPRODUCT,
    ".c3d": _SURPHASER,
    ".pod": _POINTOOLS,
    ".bin": _CLOUDCOMPARE,
    **dict.fromkeys((".bag", ".db3", ".mcap"), _ROS),
    ".pcap": _PACKETS,
    **dict.fromkeys((".zip", ".7z", ".gz", ".rar", ".tar"), _ARCHIVE),
    **dict.fromkeys((".obj", ".stl", ".fbx", ".glb", ".dxf", ".dwg"), _MESH),
}


def what_it_is(path: Path) -> tuple[str, str] | None:
    """Say what a file or folder of such a name is, and what to do; None for other names."""
    found = MAKERS.get(path.suffix.lower())
    if found is None:
        return None
    maker, instead = found
    kind = path.suffix.lower()
    if found in (_ARCHIVE, _PACKETS, _MESH):
        return f"it is {maker} ({kind})", f"Give {instead}" if found is not _ARCHIVE else "Unpack it"
    return f"it is a file of {maker} ({kind}), which only its maker's programs read", f"Export {instead}"


def said_of(paths: Iterable[Path]) -> tuple[str, str] | None:
    """Say of a folder's content which such files it has, and what to do; None if it has none."""
    known = [path for path in paths if path.suffix.lower() in MAKERS]
    if not known:
        return None
    counts = Counter(path.suffix.lower() for path in known)
    kinds = [f"{count} {suffix} of {MAKERS[suffix][0]}" for suffix, count in sorted(counts.items())]
    said = what_it_is(known[0])
    return f"the folder holds no scans that can be read, but {', '.join(kinds)}", said[1] if said else ""
