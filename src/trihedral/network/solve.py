"""From the links of a job to its result: links kept or refused, poses, and what may be believed of each station."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.se3 import distance, inverse, motion
from trihedral.model.link import Link, LinkVerdict, PoseEstimate
from trihedral.model.registration import Loop, Registration
from trihedral.model.station import Station, StationResult, StationStatus
from trihedral.network.adjustment.adjustment import adjust
from trihedral.network.adjustment.datum import Placing
from trihedral.network.adjustment.surfaces import Surfaces, compared_anew
from trihedral.network.adjustment.systematic import Systematic, estimate
from trihedral.network.constraints.constraints import Constraints, resolved
from trihedral.network.constraints.user_links import decided
from trihedral.network.decision.alternatives import Choice, choose
from trihedral.network.decision.coherent_outliers import DECISIVE, Rival, rivals
from trihedral.network.decision.loop_closure import Closure, ClosureOptions, Edge, Verdict, consistent
from trihedral.network.graph.connectivity import bridges, parts, path
from trihedral.progress import Progress, Silent

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class NetworkOptions:
    """How links are judged together."""

    closure: ClosureOptions = field(default_factory=ClosureOptions)
    # Metres and radians added to every link's covariance at the least: what moves between scans and what a scanner's
    # calibration leaves is not in the noise of its points. Loops may show that it is more (docs/network.md).
    systematic_translation: float = 0.0005
    systematic_rotation: float = 2e-5
    # A link in doubt is accepted if it is no farther from the poses that the others give: metres and radians.
    confirmed_translation: float = 0.01
    confirmed_rotation: float = float(np.radians(0.05))
    # Two scans whose looks go together less than this where their shapes agree are of different rooms.
    stranger_similarity: float = 0.5
    # Probability from which a pose that loops outvote still speaks against where they put its two scans.
    outvoted_probability: float = 0.5

    @property
    def systematic(self) -> Systematic:
        """What is assumed of all links."""
        return Systematic(self.systematic_translation, self.systematic_rotation)


def solve(
    members: Sequence[Station],
    links: Sequence[Link],
    options: NetworkOptions | None = None,
    constraints: Constraints | None = None,
    surfaces: Surfaces | None = None,
    progress: Progress | None = None,
    threads: int | None = None,
) -> Registration:
    """Place the stations.

    Links that were accepted are closed in loops, and those that contradict the others are refused. Then ambiguous and
    doubtful links that agree with what the others say are accepted too. The frame is that of the constraints or of the
    files' poses, else that of the station with most links in the largest connected part.

    Parameters
    ----------
    surfaces
        Compares two stations' surfaces where all scans put them; without it, each link stays as its pair has it.
    progress
        Is told which step is at work, and each comparison of surfaces.
    threads
        Surfaces compared at once; by default as many as there are processors.

    Raises
    ------
    InputError
        The constraints name a scan that is not there, or control points whose axes or units are wrong.
    """
    options, progress = options or NetworkOptions(), progress or Silent()
    constraints = resolve(constraints or Constraints(), members)
    progress.phase("Closing loops", 1, "", 1.0, "")
    network = _Network(members, decided(constraints, links, members), options, constraints)
    agreed, doubts = network.concluded()
    progress.advance(f"{len(links)} links", 1.0)

    split = network.split(agreed.kept)
    edges = {component: inside for component, _, inside in split}
    if surfaces is not None:
        looped = {component: inside for component, part, inside in split if len(inside) >= len(part)}
        names = [member.name for member in members]
        anew = compared_anew(list(looped.values()), surfaces, network.systematic, names, progress, threads)
        edges |= dict(zip(looped, anew, strict=True))
    progress.phase("Adjusting all scans", len(split), "parts", len(members), "scans")
    placing = Placing(members, constraints, network.systematic, doubts)
    stations: dict[int, StationResult] = {}
    for component, part, _ in split:
        if len(part) == 1 and len(members) > 1 and not network.is_fixed(part[0]):
            stations[part[0]] = unplaced(members[part[0]], network.links)
        else:
            stations |= placing.placed(component, part, edges[component])
        progress.advance(f"{len(part)} scans", len(part))
    return Registration(
        stations=tuple(stations[index] for index in range(len(members))),
        links=tuple(network.links),
        loops=tuple(_loop(closure, members) for closure in agreed.closures),
        checks=placing.checks,
        control=tuple(placing.control),
        frame=placing.frame,
    )


def believed(
    members: Sequence[Station], links: Sequence[Link], options: NetworkOptions, constraints: Constraints
) -> list[Link]:
    """Links as `solve` would leave them: which of them are accepted once all are judged together.

    Parameters
    ----------
    links
        With what the constraints decide of them (`decided`); these are resolved.
    """
    network = _Network(members, links, options, constraints)
    network.concluded()
    return network.links


def resolve(constraints: Constraints, members: Iterable[Station]) -> Constraints:
    """Give the scans of the constraints the names that they have in the job; a file's name stands for its scan."""
    names = {m.name: (m.header.source.name, m.header.source.stem, m.header.name) for m in members}
    return resolved(constraints, names)


class _Network:
    """The links of a job while they are judged."""

    def __init__(
        self,
        members: Sequence[Station],
        links: Sequence[Link],
        options: NetworkOptions,
        constraints: Constraints,
    ) -> None:
        self.members = members
        self.links = list(links)
        self.options = options
        self.systematic = options.systematic
        self.given_up: set[int] = set()  # links of which `parted` has found that nobody can tell
        self.outvoted: set[int] = set()  # links that loops gave another pose than their scans make likely
        # Whether the place has copies of rooms or storeys that nothing tells apart: a pair's scans fit in two ways.
        self.copies = any(link.verdict is LinkVerdict.AMBIGUOUS and link.unseen for link in self.links)
        self.number = {member.name: index for index, member in enumerate(members)}
        self.fixed = {self.number[f.station]: np.array(f.pose) for f in constraints.fixed}
        self.place = {
            (self.number[link.from_station], self.number[link.to_station]): index
            for index, link in enumerate(self.links)
        }

    def is_fixed(self, station: int) -> bool:
        """Whether its pose is given."""
        return station in self.fixed

    def between_scanners(self, link: Link, pose: Float64) -> Float64:
        """A pose of the link between scanner-centred frames."""
        a, b = (self.members[self.number[name]] for name in (link.from_station, link.to_station))
        return motion(None, -b.header.scanner_origin) @ pose @ motion(None, a.header.scanner_origin)

    def between_stations(self, link: Link, pose: Float64) -> Float64:
        """Undo `between_scanners`."""
        a, b = (self.members[self.number[name]] for name in (link.from_station, link.to_station))
        return motion(None, b.header.scanner_origin) @ pose @ motion(None, -a.header.scanner_origin)

    def concluded(self) -> tuple[Verdict, dict[int, str]]:
        """Settle, learn from that what links err by, settle again, and give all links their last verdict."""
        agreed, doubts = self.settled()
        assumed = self.options.systematic
        # Links that err by more than they say fail loops that they should not.
        self.systematic = estimate([inside for _, _, inside in self.split(agreed.kept)], assumed)
        if self.systematic != assumed:
            agreed, more = self.settled()
            doubts |= more
        self.refuse(agreed.refused)
        return agreed, doubts

    def settled(self) -> tuple[Verdict, dict[int, str]]:
        """Judge until nothing changes; with stations that single links speak against (`parted`)."""
        agreed = self.judged()
        while self.unmasked(agreed.kept):
            agreed = self.judged()
        if self.promoted(agreed.kept):
            agreed = self.judged()
        while self.chosen(agreed.kept):
            agreed = self.judged()
        parted, doubts = self.parted(agreed)
        while parted:
            agreed = self.judged()
            parted, more = self.parted(agreed)
            doubts |= more
        return agreed, self.copied(agreed.kept) | doubts | self.contested(agreed)

    def judged(self) -> Verdict:
        """Which of the accepted links agree with each other.

        Links that were refused with wrong ones, but agree with the poses that the rest gives, are taken back.
        """
        closure = self.options.closure
        agreed = consistent(self._edges(), closure)
        poses = self._poses(agreed.kept) if agreed.refused else {}
        back = []
        for edge, _ in agreed.refused:
            off = self._apart(edge.transform, edge.a, edge.b, poses)
            if off and off[0] <= closure.translation and off[1] <= closure.rotation:
                back.append(edge)
        if not back:
            return agreed
        again = consistent([*agreed.kept, *back], closure)
        wrong = [(edge, loop) for edge, loop in agreed.refused if not any(edge is b for b in back)]
        return Verdict(again.kept, wrong + again.refused, again.closures)

    def _edges(self) -> list[Edge]:
        scale, more = self.systematic.scale, self.systematic.covariance
        edges = []
        for (a, b), index in self.place.items():
            link = self.links[index]
            if link.accepted and link.transform is not None and link.covariance is not None:
                if a in self.fixed and b in self.fixed:
                    continue
                locked = link.decision == "locked"
                covariance = link.covariance if locked else scale * link.covariance + more
                transform = self.between_scanners(link, link.transform)
                edges.append(Edge(a, b, transform, covariance, link.score, locked=locked))
        return edges + self._given()

    def _given(self) -> list[Edge]:
        """Edges that stand for the poses that are known, so that loops close over them."""
        if len(self.fixed) < 2:
            return []
        first, *others = sorted(self.fixed)
        scanner = {
            s: pose @ motion(None, self.members[s].header.scanner_origin) for s, pose in self.fixed.items()
        }
        covariance = np.diag([1e-12] * 3 + [1e-8] * 3)
        return [
            Edge(s, first, inverse(scanner[first]) @ scanner[s], covariance, 1.0, locked=True, given=True)
            for s in others
        ]

    def refuse(self, refused: Sequence[tuple[Edge, Closure]]) -> None:
        """Give the links that loops spoke against their verdict."""
        for edge, closure in refused:
            index = self.place[edge.ends]
            walk = " - ".join(self.members[s].name for s in closure.stations)
            miss = f"{1e3 * closure.translation:.0f} mm and {np.degrees(closure.rotation):.2f} deg"
            forced = "it was forced, but " if self.links[index].decision == "forced" else ""
            reason = f"{forced}the loop {walk} misses its start by {miss}"
            self.links[index] = replace(self.links[index], verdict=LinkVerdict.REFUSED, reason=reason)

    def promoted(self, edges: Sequence[Edge]) -> bool:
        """Accept the links in doubt that agree with the poses that the others give; whether there were any."""
        doubtful = (LinkVerdict.AMBIGUOUS, LinkVerdict.DOUBTFUL)
        in_doubt = [
            index
            for index, link in enumerate(self.links)
            # Copies of a place agree with each other, so loops do not take back what was seen to be empty.
            if link.verdict in doubtful and index not in self.given_up and not link.contradicted
        ]
        poses = self._poses(edges) if in_doubt else {}
        found = False
        for index in in_doubt:
            for choice in self._choices(index):
                off = self._apart(choice.transform, choice.a, choice.b, poses)
                if (
                    off
                    and off[0] <= self.options.confirmed_translation
                    and off[1] <= self.options.confirmed_rotation
                ):
                    self._take(choice)
                    found = True
                    break
        return found

    def chosen(self, edges: Sequence[Edge]) -> bool:
        """Accept poses of ambiguous links on which several of them agree; whether there were any."""
        ambiguous = [
            index
            for index, link in enumerate(self.links)
            if link.verdict is LinkVerdict.AMBIGUOUS and index not in self.given_up
        ]
        if len(ambiguous) < 2:
            return False
        poses = self._poses(edges)
        alone = [s for s in range(len(self.members)) if s not in poses]
        poses |= {s: (len(self.members) + k, np.eye(4)) for k, s in enumerate(alone)}
        found = choose([c for index in ambiguous for c in self._choices(index)], poses, self.options.closure)
        for choice in found:
            self._take(choice)
        return bool(found)

    def _choices(self, index: int) -> list[Choice]:
        """The poses of a link that it may have."""
        link = self.links[index]
        a, b = self.number[link.from_station], self.number[link.to_station]
        estimates = [link.estimate] if link.estimate is not None else []
        estimates += [rival for rival in link.alternatives if rival.covariance is not None]
        return [
            Choice(index, k, a, b, self.between_scanners(link, estimate.transform))
            for k, estimate in enumerate(estimates)
        ]

    def _take(self, choice: Choice) -> None:
        """Accept a link with one of its poses; the one that it had becomes an alternative."""
        link = self.links[choice.link]
        if choice.pose > 0 and link.estimate is not None:
            probability = link.evidence.probability if link.evidence is not None else None
            if (probability or 0.0) >= self.options.outvoted_probability:
                self.outvoted.add(choice.link)
            others = list(link.alternatives)
            chosen, others[choice.pose - 1] = others[choice.pose - 1], link.estimate
            link = replace(
                link,
                estimate=chosen,
                alternatives=tuple(others),
                # They were of the other pose.
                overlap_from=None,
                overlap_to=None,
                free_space_conflict=None,
            )
        self.links[choice.link] = replace(
            link, verdict=LinkVerdict.ACCEPTED, reason=None, confirmed_by_loops=True
        )

    def unmasked(self, edges: Sequence[Edge]) -> bool:
        """Refuse links that lead a scan onto others of another storey or room; whether there were any.

        Where two scans do not look the same under a pose, or surfaces of one stand where the other saw empty space, and
        the network puts them there all the same, one of the links that lead from one to the other is wrong. Refused
        are those whose own looks could not be compared, or, where surfaces contradict each other, that no loop checks.
        """
        strangers = [
            (link, link.contradicted)
            for link in self.links
            if self._strange(link) or (link.contradicted and not link.accepted)
        ]
        poses = self._poses(edges) if strangers else {}
        limits = self.options.closure
        ends = [edge.ends for edge in edges]
        unchecked = bridges(len(self.members), ends) if strangers else set()
        for stranger, contradicted in strangers:
            off = self._off(stranger, poses)
            if not off or off[0] > limits.translation or off[1] > limits.rotation:
                continue
            start, end = self.number[stranger.from_station], self.number[stranger.to_station]
            way = [k for k in path(len(self.members), ends, start, end) or [] if not edges[k].locked]
            unseen = [k for k in way if self.links[self.place[ends[k]]].appearance_similarity is None]
            suspects = [k for k in way if k in unchecked] if contradicted else unseen
            for k in suspects:
                both = f"{stranger.from_station} and {stranger.to_station}"
                what = (
                    "surfaces there contradict each other"
                    if contradicted
                    else "they do not look the same there"
                )
                index = self.place[ends[k]]
                reason = f"it would put {both} in one place, and {what}"
                self.links[index] = replace(self.links[index], verdict=LinkVerdict.REFUSED, reason=reason)
            if suspects:
                return True
        return False

    def _strange(self, link: Link) -> bool:
        similarity = link.appearance_similarity
        return similarity is not None and similarity < self.options.stranger_similarity

    def parted(self, agreed: Verdict) -> tuple[bool, dict[int, str]]:
        """Give up links where others that agree with each other join the scans elsewhere.

        Returns
        -------
        parted
            Whether there were any.
        doubts
            Stations whose pose single links speak against that are not outvoted clearly, with a reason.
        """
        poses = self._poses(agreed.kept) if agreed.refused else {}
        confirmed = [
            not edge.given and self.links[self.place[edge.ends]].confirmed_by_loops for edge in agreed.kept
        ]
        refused = [edge for edge, _ in agreed.refused]
        found = rivals(len(self.members), agreed.kept, refused, poses, confirmed)
        doubts: dict[int, str] = {}
        for one in found:
            part = {s for s, (number, _) in poses.items() if number == poses[min(one.stations)][0]}
            side = one.stations if 2 * len(one.stations) <= len(part) else part - one.stations
            if len(one.refused) > 1:
                self._give_up(one, poses)
                why = "links that would have it elsewhere were not outvoted clearly"
            else:
                names = " - ".join(self.members[s].name for s in one.refused[0].ends)
                links = "1 link" if len(one.kept) == 1 else f"{len(one.kept)} links"
                why = f"held by {links} only, and link {names}, refused, speaks against that"
            doubts |= dict.fromkeys(side, why)
        return any(len(one.refused) > 1 for one in found), doubts

    def contested(self, agreed: Verdict) -> dict[int, str]:
        """Stations that links which were given up still have elsewhere, not clearly outvoted, with a reason.

        What was given up bears out no pose, but counts for and against those that are left.
        """
        poses = self._poses(agreed.kept) if self.given_up else {}
        kept, against = list(agreed.kept), [edge for edge, _ in agreed.refused]
        for (a, b), index in self.place.items():
            link = self.links[index]
            if index in self.given_up and link.transform is not None and link.covariance is not None:
                edge = Edge(a, b, self.between_scanners(link, link.transform), link.covariance, 0.0)
                off = self._off(link, poses)
                limits = self.options.closure
                if off is not None:
                    agrees = off[0] <= limits.translation and off[1] <= limits.rotation
                    (kept if agrees else against).append(edge)
        found = rivals(len(self.members), kept, against, poses, [False] * len(kept)) if poses else []
        doubts: dict[int, str] = {}
        for one in found:
            part = {
                s for s, (number, _) in poses.items() if number == poses[min(one.stations & poses.keys())][0]
            }
            side = one.stations if 2 * len(one.stations & part) <= len(part) else part - one.stations
            why = "links that would have it elsewhere were not outvoted clearly"
            doubts |= dict.fromkeys(side, why)
        used, lost = [0] * len(self.members), [0] * len(self.members)
        for (a, b), index in self.place.items():
            for station in (a, b):
                used[station] += self.links[index].accepted
                lost[station] += index in self.given_up
        for station in range(len(self.members)):
            if lost[station] and used[station] <= DECISIVE * lost[station]:
                doubts.setdefault(station, f"{lost[station]} of its links could not be told right from wrong")
        return doubts | self.against_odds(agreed.kept)

    def against_odds(self, kept: Sequence[Edge]) -> dict[int, str]:
        """Stations with a link that would be another by itself, and few that hold by themselves, with a reason."""
        holding = [0] * len(self.members)
        for edge in kept:
            if edge.given or not self.links[self.place[edge.ends]].confirmed_by_loops:
                holding[edge.a] += 1
                holding[edge.b] += 1
        doubts: dict[int, str] = {}
        for index in sorted(self.outvoted - self.given_up):
            link = self.links[index]
            for station in (self.number[link.from_station], self.number[link.to_station]):
                if link.accepted and holding[station] <= DECISIVE:
                    doubts[station] = (
                        f"link {link.from_station} - {link.to_station} by itself would have it elsewhere"
                    )
        return doubts

    def copied(self, kept: Sequence[Edge]) -> dict[int, str]:
        """Stations that may stand in a copy of their room or storey, with a reason.

        Copies agree with each other, so loops over links under a ceiling whose looks could not be compared speak
        against none. What other links tie together stands in one of them; the largest such group of a part says which.
        """
        doubts: dict[int, str] = {}
        for _, part, inside in self.split(kept) if self.copies else ():
            told = [
                edge.ends
                for edge in inside
                if edge.given or edge.locked or not self.links[self.place[edge.ends]].unseen
            ]
            held = next((group for group in parts(len(self.members), told) if group[0] in part), part)
            apart = set(part) - set(held) if len(held) > 1 else set(part)
            doubts |= dict.fromkeys(
                apart, "nothing is known of its looks, and scans of this job fit in copies of a place"
            )
        return doubts

    def _give_up(self, found: Rival, poses: Mapping[int, tuple[int, Float64]]) -> None:
        """Call the links ambiguous that join some stations in one of two ways."""
        names = sorted(self.members[s].name for s in found.stations)
        pose = poses[min(found.stations)][1]
        apart = float(np.linalg.norm((found.motion @ pose - pose)[:3, 3]))
        who = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
        links = "1 link puts" if len(found.kept) == 1 else f"{len(found.kept)} links put"
        reason = (
            f"{links} {who} in one place, {len(found.refused)} others {apart:.2f} m away: which is right "
            "cannot be told"
        )
        for (a, b), index in self.place.items():
            link = self.links[index]
            across = (a in found.stations) != (b in found.stations)
            if not (link.accepted and across and poses.get(a, (-1,))[0] == poses.get(b, (-2,))[0]):
                continue
            pose_a, pose_b = poses[a][1], poses[b][1]
            if any(edge.ends == (a, b) for edge in found.kept):
                pose_a, pose_b = (
                    found.motion @ pose if s in found.stations else pose
                    for s, pose in ((a, pose_a), (b, pose_b))
                )
            self.given_up.add(index)
            elsewhere = self.between_stations(link, inverse(pose_b) @ pose_a)
            self.links[index] = replace(
                link,
                verdict=LinkVerdict.AMBIGUOUS,
                reason=reason,
                alternatives=(PoseEstimate(elsewhere),),
            )

    def split(self, edges: Sequence[Edge]) -> list[tuple[int, list[int], list[Edge]]]:
        """Number, stations and edges of each connected part, the largest first."""
        found = parts(len(self.members), [edge.ends for edge in edges])
        inside: list[list[Edge]] = [[] for _ in found]
        part_of = {station: component for component, part in enumerate(found) for station in part}
        for edge in edges:
            inside[part_of[edge.a]].append(edge)
        return [(component, part, inside[component]) for component, part in enumerate(found)]

    def _poses(self, edges: Sequence[Edge]) -> dict[int, tuple[int, Float64]]:
        """Part and adjusted pose in it of each station that has a link."""
        poses: dict[int, tuple[int, Float64]] = {}
        for component, part, inside in self.split(edges):
            if len(part) > 1:
                adjusted = adjust(part[0], inside, poses_only=True).poses
                poses |= {station: (component, pose) for station, pose in adjusted.items()}
        return poses

    def _off(self, link: Link, poses: Mapping[int, tuple[int, Float64]]) -> tuple[float, float] | None:
        """How far a link is from what the poses say (m, rad); None if they say nothing of it."""
        if link.transform is None:
            return None
        a, b = self.number[link.from_station], self.number[link.to_station]
        return self._apart(self.between_scanners(link, link.transform), a, b, poses)

    @staticmethod
    def _apart(
        transform: Float64, a: int, b: int, poses: Mapping[int, tuple[int, Float64]]
    ) -> tuple[float, float] | None:
        """The same of ``b_from_a`` between scanners."""
        ends = poses.get(a), poses.get(b)
        if ends[0] is None or ends[1] is None or ends[0][0] != ends[1][0]:
            return None
        return distance(inverse(ends[1][1]) @ ends[0][1], transform)


def unplaced(member: Station, links: Sequence[Link]) -> StationResult:
    """The station of a scan that no link places, with the reason."""
    own = [link for link in links if member.name in (link.from_station, link.to_station)]
    ambiguous = any(link.verdict is LinkVerdict.AMBIGUOUS for link in own)
    best = max(own, key=lambda link: (link.transform is not None, link.score), default=None)
    reason = "no other scan was compared with it"
    if best is not None:
        other = best.to_station if best.from_station == member.name else best.from_station
        reason = f"no link was accepted; the best, with {other}: {best.reason}"
    return StationResult(
        name=member.name,
        header=member.header,
        points=member.points,
        pose=None,
        tied=False,
        component=None,
        status=StationStatus.AMBIGUOUS if ambiguous else StationStatus.NOT_PLACED,
        reason=reason,
    )


def _loop(closure: Closure, members: Sequence[Station]) -> Loop:
    return Loop(
        stations=tuple(members[station].name for station in closure.stations),
        translation_m=closure.translation,
        rotation_deg=float(np.degrees(closure.rotation)),
        expected_translation_m=closure.expected_translation,
        ok=closure.ok,
        expected_rotation_deg=float(np.degrees(closure.expected_rotation)),
    )
