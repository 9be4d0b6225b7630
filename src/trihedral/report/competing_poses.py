"""Poses that explain a scan nearly as well as each other, drawn side by side."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trihedral.report.axes import Colour, as_png, as_uri, axes_around, paint
from trihedral.report.map import GREY, scanner_place
from trihedral.report.section import Clouds, Samples, SectionLevel, cut, trusted

_MOST_AMBIGUOUS = 6
_MOST_POSES = 3


@dataclass(frozen=True)
class CompetingPose:
    """One of several poses that explain a scan nearly as well, drawn over the scan it was matched to."""

    station: str
    neighbour: str
    letter: str
    picture: str
    width: float
    height: float
    #: Where it puts the scanner.
    x: float
    y: float
    heading_deg: float


def competing_poses(
    document: Mapping[str, Any],
    samples: Samples,
    slabs: Clouds,
    level: SectionLevel,
    colour: Colour,
) -> list[list[CompetingPose]]:
    """Draw the poses that compete for each ambiguous link between a trusted scan and one that is not."""
    poses = trusted(document)
    stations = {station["name"]: station for station in document["stations"]}
    groups: list[list[CompetingPose]] = []
    for link in document["links"]:
        if link["verdict"] != "ambiguous" or link["transform"] is None or len(groups) == _MOST_AMBIGUOUS:
            continue
        motions = [np.array(motion) for motion in (link["transform"], *link.get("alternatives", ()))]
        fixed, loose = link["to"], link["from"]
        if fixed not in poses:
            fixed, loose = loose, fixed
            motions = [np.linalg.inv(motion) for motion in motions]
        if fixed not in poses or loose in poses or fixed not in slabs or loose not in samples:
            continue
        found = [poses[fixed] @ motion for motion in motions[:_MOST_POSES]]
        clouds = [cut(pose, samples[loose], level) for pose in found]
        axes = axes_around([slabs[fixed], *clouds], [], 400.0, 1.0)
        group = []
        for index, (pose, cloud) in enumerate(zip(found, clouds, strict=True)):
            image = paint(axes, [(slabs[fixed], GREY), (cloud, colour)], 560)
            x, y = axes.at(scanner_place(stations[loose] | {"pose": pose}))
            heading = float(np.degrees(np.arctan2(pose[1, 0], pose[0, 0]))) % 360.0
            uri = as_uri(as_png(image, 16))
            group.append(CompetingPose(loose, fixed, chr(65 + index), uri, 400.0, axes.height, x, y, heading))
        groups.append(group)
    return groups
