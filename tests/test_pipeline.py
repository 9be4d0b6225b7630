"""The steps of the default method put together: what one says to the other."""

from pathlib import Path

import numpy as np

from support.links import with_covariance, with_pose
from support.street import Job, street
from trihedral.geometry.se3 import motion
from trihedral.job.stages import PreparedStation
from trihedral.model.pairs import PairHistory
from trihedral.network.candidates.options import CandidateOptions
from trihedral.network.candidates.search import CandidateSearch
from trihedral.pipeline import Options, stages
from trihedral.scan import ScanHeader


def station(place):
    header = ScanHeader(
        Path(f"{place.name}.e57"), 0, place.name, "e57", 1, None, False, False, 0,
        None, place.header.scanner_origin, True, "m", True,
    )  # fmt: skip
    return PreparedStation(
        place.name, header, 1000, place.content, place.descriptor, key=place.content, load=lambda: None
    )


def test_stages_of_both_methods_carry_fingerprints_of_parts_that_are_there():
    auto, paper = stages(Options()), stages(Options(method="paper"))
    assert auto.program == paper.program, "they prepare scans alike"
    assert auto.pair_version != paper.pair_version


def test_pairs_are_looked_for_anew_where_loops_refuse_a_link():
    options = CandidateOptions(all_pairs_up_to=0, links=2)
    places = street(14)
    stations = [station(place) for place in places]
    _, history = Job(places).run(options)
    covariance = np.diag([1e-8] * 3 + [1e-6] * 3)
    links = [with_covariance(link, covariance) for link in history.links]
    ends = {
        frozenset((link.from_station, link.to_station)): k for k, link in enumerate(links) if link.accepted
    }
    of = {s.name: [pair for pair in ends if s.name in pair] for s in stations}

    def closes(name):
        (first,), (second,) = ({*pair} - {name} for pair in of[name])
        return frozenset((first, second)) in ends

    name = next(name for name, pairs in of.items() if len(pairs) == 2 and closes(name))
    assert CandidateSearch(options)(stations, PairHistory(links, history.previews)) == []
    wanted = stages(Options(candidates=options)).candidate_pairs
    assert wanted(stations, PairHistory(links, history.previews)) == []

    wrong = ends[of[name][0]]
    links[wrong] = with_pose(links[wrong], links[wrong].transform @ motion(None, np.array([3.0, 0, 0])))
    assert CandidateSearch(options)(stations, PairHistory(links, history.previews)) == [], (
        "a pair alone does not know"
    )
    assert any(name in (want.a, want.b) for want in wanted(stations, PairHistory(links, history.previews)))
