"""report.html: one file that opens offline and shows a person how far the result may be trusted."""

import base64
import hashlib
from collections import Counter
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from numpy.typing import NDArray

from trihedral.atomic import write_new
from trihedral.report.axes import assign_colours
from trihedral.report.competing_poses import competing_poses
from trihedral.report.map import plan, scanner_place, section
from trihedral.report.paper_figures import StationAppearance, coloured_cloud, link_figures
from trihedral.report.section import Samples, between, choose_level, cut, thinned, trusted
from trihedral.report.summary import mean
from trihedral.report.wall_offsets import wall_offsets, worst_places
from trihedral.report.wall_profile import wall_profile
from trihedral.verdict.profile import Profile
from trihedral.verdict.ranking import (
    SIGMAS_TOO_SMALL,
    checked_worst_first,
    control_worst_first,
    loop_factor,
    loop_factors,
    loops_worst_first,
    passed_over_first_missed,
    percentile,
    scaled_sigma,
    unused_links,
    used_links,
    weakest_sigma,
)

_VERDICTS = {0: ("passed", "✓"), 3: ("incomplete", "!"), 4: ("tolerance", "✕")}
_STATUS = {"verified": "✓", "single-linked": "1", "ambiguous": "?", "not-placed": "✕"}
_LINKS = {"accepted": "✓", "ambiguous": "?", "doubtful": "~", "refused": "✕"}
_COMPETING = (213, 94, 0)
_MOST_PREVIEWS = 200  # rows; registration.json has all
_WALL_SLAB = 0.3  # metres of height that wall offsets are measured over


def write_report(
    path: Path | str,
    document: Mapping[str, Any],
    samples: Samples,
    appearance: StationAppearance | None = None,
) -> None:
    """Write report.html atomically.

    Parameters
    ----------
    document
        As `to_document` or `read_result` give it.
    samples
        For each station, by name, (N, 3) evenly sampled points in station coordinates, metres. Stations
        without any are listed and mapped all the same.
    appearance
        Colours and pictures of the stations, for the figures that need them.

    Raises
    ------
    OutputError
        The file cannot be written, or one is there.
    """
    write_new(path, render(document, samples, appearance).encode(errors="backslashreplace"))


def render(document: Mapping[str, Any], samples: Samples, appearance: StationAppearance | None = None) -> str:
    """Write the page as text; same document and samples, same text."""
    here = files("trihedral.report")
    script = (here / "report.js").read_text("utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters.update(mm=_mm, count=lambda number: f"{number:,}".replace(",", " "))
    template = environment.from_string((here / "report.html.j2").read_text("utf-8"))
    context = _context(document, samples, appearance)
    style = (here / "report.css").read_text("utf-8")
    return template.render(style=style, script=script, script_digest=digest, **context)


def _mm(metres: float | None, digits: int = 1) -> str:
    return "–" if metres is None else f"{metres * 1e3:.{digits}f}"


# Keys that the schema does not require, with what their absence means.
_VERDICT_DEFAULTS: dict[str, Any] = {"problems": []}
_STATION_DEFAULTS: dict[str, Any] = {
    "sigma_translation_m": None,
    "sigma_rotation_deg": None,
    "scanner_origin": None,
    "notes": [],
}
_LINK_DEFAULTS: dict[str, Any] = {
    **dict.fromkeys(("rmse_m", "median_m", "p90_m", "p95_m", "max_m", "free_space_conflict", "runner_up")),
    **{"weakest_direction": None, "alternatives": [], "evidence": {}, "network": None},
}
_LOOP_DEFAULTS: dict[str, Any] = {"expected_translation_m": None}


def _complete(document: Mapping[str, Any]) -> dict[str, Any]:
    """Give every key that the page speaks of."""
    return {
        **document,
        "failures": document.get("failures", []),
        "frame": document.get("frame"),
        "control": document.get("control", []),
        "pairs": document.get("pairs", {}),
        "verdict": _VERDICT_DEFAULTS | document["verdict"],
        "stations": [_STATION_DEFAULTS | station for station in document["stations"]],
        "links": [_LINK_DEFAULTS | link for link in document["links"]],
        "loops": [_LOOP_DEFAULTS | loop for loop in document["loops"]],
    }


def _context(
    document: Mapping[str, Any], samples: Samples, appearance: StationAppearance | None
) -> dict[str, Any]:
    document = _complete(document)
    limits = Profile(**document["verdict"]["profile"]) if "profile" in document["verdict"] else None
    used = used_links(document)
    broken = frozenset(
        (link["from"], link["to"])
        for link in used
        if limits is not None and limits.link_problem(link.get("p90_m"), link.get("p95_m"))
    )
    verdict_class, verdict_symbol = _VERDICTS[document["verdict"]["exit"]]
    word, _, rest = document["verdict"]["text"].partition(": ")
    return {
        "document": document,
        "verdict": {"class": verdict_class, "symbol": verdict_symbol, "word": word, "rest": rest},
        **_drawings(document, samples, used, broken),
        **_tables(document, limits, used, broken),
        "figures": link_figures(document, samples, appearance),
        "cloud": None if appearance is None else coloured_cloud(document, samples, appearance),
        "profile": limits,
    }


def _drawings(
    document: Mapping[str, Any],
    samples: Samples,
    used: list[Mapping[str, Any]],
    broken: frozenset[tuple[str, str]],
) -> dict[str, Any]:
    """Map, section and pieces of wall, and the figures at the top, which need the walls."""
    poses = trusted(document)
    some = thinned(poses, samples)
    level = choose_level(poses, some)
    # Offsets need more height than a section that shows single walls.
    slabs = {name: cut(poses[name], samples[name], level.widened(_WALL_SLAB)) for name in some}
    thin = {name: between(slab, level) for name, slab in slabs.items()}
    colours = assign_colours(list(poses), [(link["from"], link["to"]) for link in used])
    worst = (used[0]["from"], used[0]["to"]) if used else None
    places = {s["name"]: scanner_place(s) for s in document["stations"] if s["name"] in slabs}
    offsets = wall_offsets(slabs, places)
    cloud_section = section(document, thin, colours) if some else None
    profiles = [
        wall_profile(offset, slabs, cloud_section.axes, colours, chr(65 + index))
        for index, offset in enumerate(worst_places(offsets, 4))
        if cloud_section is not None
    ]
    return {
        "key": _key_figures(document, used, offsets),
        "level": level,
        "thickness_cm": round((level.top - level.bottom) * 100),
        "plan": plan(document, thin, colours, broken, worst),
        "section": cloud_section,
        "profiles": profiles,
        "candidates": competing_poses(document, samples, thin, level, _COMPETING),
    }


def _tables(
    document: Mapping[str, Any],
    limits: Profile | None,
    used: list[Mapping[str, Any]],
    broken: frozenset[tuple[str, str]],
) -> dict[str, Any]:
    poses, options = trusted(document), document["software"]["options"]
    folder, notes = _shared(document["stations"])
    passed_over = passed_over_first_missed(document)
    factor, through = loop_factor(document), loop_factors(document)
    verification = options.get("auto", {}).get("verification", {})
    overlap = verification.get("evidence", {}).get("offset")
    return {
        "stations": _stations(document, limits, folder, notes),
        "folder": folder,
        "notes": notes,
        "factor": factor if factor is not None and factor > SIGMAS_TOO_SMALL else None,
        "overlap_mm": overlap * 1e3 if isinstance(overlap, float) else None,
        "used": [
            {
                **_link(link, poses, (link["from"], link["to"]) in broken),
                "loops": through.get(frozenset((link["from"], link["to"]))),
            }
            for link in used
        ],
        "closure": options.get("network", {}).get("closure"),
        "unused": [_link(link, poses, False) for link in unused_links(document)],
        "passed_over": passed_over[:_MOST_PREVIEWS],
        "passed_over_more": len(passed_over[_MOST_PREVIEWS:]),
        "never_looked_at": document["pairs"].get("never_looked_at", []),
        "loops": loops_worst_first(document),
        "network": checked_worst_first(document),
        "control": control_worst_first(document),
        "against": [link for link in document["links"] if link.get("against_reference")],
        "settings": _flat(options),
        "timing": _flat(document["timing"]),
    }


def _key_figures(
    document: Mapping[str, Any], used: list[Mapping[str, Any]], offsets: list[Any]
) -> dict[str, Any]:
    loops = loops_worst_first(document)
    slack = max(
        (link for link in used if weakest_sigma(link)), key=lambda k: weakest_sigma(k) or 0.0, default=None
    )
    rms = [link["rmse_m"] for link in used if link.get("rmse_m") is not None]
    distances = [abs(offset.metres) for offset in offsets]
    pairs = {frozenset(offset.stations) for offset in offsets}
    stations = document["stations"]
    total = len(stations) + len(document.get("failures", ()))
    return {
        "total": total,
        "trusted": len(trusted(document)),
        "link": used[0] if used else None,
        "loop": loops[0] if loops else None,
        "slack": slack,
        "slack_sigma": None if slack is None else weakest_sigma(slack),
        "mean_rms": mean(rms) if rms and document["verdict"]["exit"] != 3 else None,
        "walls": len(distances),
        "walls_links": sum(frozenset((link["from"], link["to"])) in pairs for link in used),
        "walls_p95": percentile(distances, 0.95) if distances else None,
        "walls_max": max(distances, default=None),
    }


def _shared(stations: list[Mapping[str, Any]]) -> tuple[str, list[str]]:
    """Folder that all files lie in, with its last slash, and notes that hold for every scan; said once."""
    if len(stations) < 2:
        return "", []
    folders = {station["source"].rpartition("/")[0] for station in stations}
    notes = [note for note in stations[0]["notes"] if all(note in s["notes"] for s in stations)]
    return f"{folders.pop()}/" if len(folders) == 1 and folders != {""} else "", notes


def _stations(
    document: Mapping[str, Any], limits: Profile | None, folder: str, common: list[str]
) -> list[dict[str, Any]]:
    accepted = [link for link in document["links"] if link["accepted"]]
    tied = Counter(link[end] for link in accepted for end in ("from", "to"))
    in_file = Counter(station["source"] for station in document["stations"])
    rows = []
    for number, station in enumerate(document["stations"], start=1):
        row = {
            **station,
            "number": number,
            "symbol": _STATUS[station["status"]],
            "links": tied[station["name"]],
        }
        if station["pose"] is not None:
            pose = np.array(station["pose"])
            row["x"], row["y"], row["z"] = pose[:3, 3].tolist()
            row["heading"] = float(np.degrees(np.arctan2(pose[1, 0], pose[0, 0]))) % 360.0
            row["tilt"] = float(np.degrees(np.arctan2(np.hypot(pose[0, 2], pose[1, 2]), pose[2, 2])))
        sigma = station.get("sigma_translation_m")
        row["frame"] = bool(sigma) and not any(sigma) and not any(station["sigma_rotation_deg"] or [1.0])
        judged = limits is not None and station["tied"]
        row["problem"] = (
            limits.station_problem(scaled_sigma(document, station)) if limits and judged else None
        )
        row["file"] = station["source"].removeprefix(folder)
        if in_file[station["source"]] > 1:
            row["file"] += f", scan {station['scan_index'] + 1}"
        row["own_notes"] = [note for note in station["notes"] if note not in common]
        rows.append(row)
    worst_first = list(reversed(_STATUS))
    return sorted(rows, key=lambda row: worst_first.index(row["status"]))


def _link(link: Mapping[str, Any], poses: Mapping[str, NDArray[np.float64]], over: bool) -> dict[str, Any]:
    row = {
        **link,
        "symbol": _LINKS[link["verdict"]],
        "over": over,
        "weak": weakest_sigma(link),
        "weak_axis": None,
    }
    weakest = link.get("weakest_direction")
    if weakest and weakest.get("axis") and link["to"] in poses:
        axis = poses[link["to"]][:3, :3] @ np.array(weakest["axis"])
        axis = axis if axis[np.argmax(np.abs(axis))] > 0 else -axis
        row["weak_axis"] = (np.round(axis, 2) + 0.0).tolist()  # adding 0 takes the sign off a zero
    return row


def _flat(value: Any, name: str = "") -> list[tuple[str, str]]:
    """Nested settings as rows of a dotted name and a text."""
    if isinstance(value, Mapping):
        return [row for key, item in value.items() for row in _flat(item, f"{name}.{key}" if name else key)]
    if isinstance(value, list):
        return [(name, ", ".join(str(item) for item in value))]
    if isinstance(value, float):
        return [(name, f"{value:.6g}")]
    return [(name, "–" if value is None else str(value))]
