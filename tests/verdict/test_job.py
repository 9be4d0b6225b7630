"""The exit code and the summary: what each trouble turns them into."""

from dataclasses import replace

import pytest

from trihedral.model.link import LinkVerdict
from trihedral.model.registration import ControlMiss, Failure, Loop
from trihedral.model.station import StationStatus
from trihedral.report import summary, to_document
from trihedral.verdict.profile import PROFILES
from trihedral.verdict.ranking import loop_factors

STRICT = PROFILES["interior"]


def exit_of(registration, profile=PROFILES["exterior"]):
    return to_document(registration, (), profile)["verdict"]["exit"]


def with_station(registration, index, **changes):
    stations = list(registration.stations)
    stations[index] = replace(stations[index], **changes)
    return replace(registration, stations=tuple(stations))


def test_all_placed_and_within_tolerance_is_0(site):
    assert exit_of(site.registration) == 0
    assert exit_of(with_station(site.registration, 2, status=StationStatus.SINGLE_LINKED)) == 0


def test_a_scan_that_one_path_holds_is_named_though_it_passes(site):
    document = to_document(with_station(site.registration, 2, status=StationStatus.SINGLE_LINKED), ())
    assert "s3" in document["verdict"]["text"]


@pytest.mark.parametrize(
    "changes",
    [
        {"pose": None, "status": StationStatus.NOT_PLACED, "component": None},
        {"status": StationStatus.AMBIGUOUS},
        {"component": 1},
    ],
)
def test_a_scan_without_a_trusted_pose_in_the_frame_is_3_and_named_with_its_reason(site, changes):
    registration = with_station(site.registration, 4, reason="because of the fog", **changes)
    verdict = to_document(registration, ())["verdict"]
    assert verdict["exit"] == 3
    assert "s5" in verdict["text"]
    assert any("s5" in problem for problem in verdict["problems"])
    if changes.get("component") != 1:
        assert any("because of the fog" in problem for problem in verdict["problems"])


def test_an_unreadable_file_is_3_even_when_all_others_are_placed(site):
    registration = replace(site.registration, failures=(Failure("cut.e57", None, "the file ends early"),))
    verdict = to_document(registration, ())["verdict"]
    assert verdict["exit"] == 3
    assert "7 of 8" in verdict["text"]
    assert verdict["problems"] == ["cut.e57: not read (the file ends early)"]


def test_a_link_over_the_limit_is_4_and_named(site):
    # The largest P95 of the made-up site is 13.2 mm, on s1 - s3.
    verdict = to_document(site.registration, (), STRICT)["verdict"]
    assert verdict["exit"] == 4
    assert any("s1 - s3" in problem and "13.2 mm" in problem for problem in verdict["problems"])


def test_missing_scans_outweigh_tolerance_and_both_are_said(troubled):
    verdict = to_document(troubled.registration, (), STRICT)["verdict"]
    assert verdict["exit"] == 3
    assert "interior" in verdict["text"]
    assert any("s1 - s3" in problem for problem in verdict["problems"])


def test_links_that_are_not_used_do_not_break_the_tolerance(site):
    links = tuple(
        replace(link, verdict=LinkVerdict.REFUSED) if link.estimate.residuals.p95_m > 0.010 else link
        for link in site.registration.links
    )
    assert exit_of(replace(site.registration, links=links), STRICT) == 0


def test_a_loop_of_used_links_that_does_not_close_is_4(site):
    loops = (Loop(("s1", "s2", "s3"), 0.2, 1.0, 0.003, False),)
    assert exit_of(replace(site.registration, loops=loops)) == 4
    # The same loop through a refused link is why that link was refused, not a problem left.
    links = tuple(
        replace(link, verdict=LinkVerdict.REFUSED)
        if {link.from_station, link.to_station} == {"s1", "s3"}
        else link
        for link in site.registration.links
    )
    assert exit_of(replace(site.registration, loops=loops, links=links)) == 0


def test_one_scan_alone_passes(site):
    alone = replace(site.registration, stations=site.registration.stations[:1], links=(), loops=())
    alone = with_station(alone, 0, status=StationStatus.SINGLE_LINKED, tied=False)
    for profile in PROFILES.values():
        assert exit_of(alone, profile) == 0


def test_the_summary_leads_with_verdict_then_worst_link_then_worst_loop(site):
    lines = summary(to_document(site.registration, ())).splitlines()
    assert lines[0].startswith("PASSED")
    assert lines[1].startswith("worst link") and "s1 - s3" in lines[1] and "13.2 mm" in lines[1]
    assert lines[2].startswith("worst loop") and "s2 - s3 - s7" in lines[2] and "4.7 mm" in lines[2]
    assert lines[3].startswith("P95")


def test_every_residual_is_called_fit_not_accuracy(site, troubled):
    for job in (site, troubled):
        for line in summary(to_document(job.registration, ())).splitlines():
            if line.startswith(("worst link", "P95", "means   ")) and "mm" in line:
                assert "fit, not accuracy" in line


def test_no_mean_is_printed_while_a_scan_is_missing(site, troubled):
    # Independent of the wording: the mean RMS of the accepted links must not occur.
    for job, expected in ((site, True), (troubled, False)):
        links = [link for link in job.registration.links if link.accepted]
        mean = sum(link.estimate.residuals.rmse_m for link in links) / len(links)
        assert (f"RMS {mean * 1e3:.1f} mm" in summary(to_document(job.registration, ()))) is expected


def test_the_summary_of_a_job_without_links_says_so(site):
    alone = replace(site.registration, stations=site.registration.stations[:1], links=(), loops=())
    lines = summary(to_document(alone, ())).splitlines()
    assert "no link" in lines[1]


def test_names_cannot_send_commands_to_the_terminal(site):
    registration = with_station(
        site.registration, 0, name="\x1b]0;owned\x07\ns1", status=StationStatus.AMBIGUOUS
    )
    text = summary(to_document(replace(registration, links=(), loops=()), ()))
    assert "\x1b" not in text and "\x07" not in text
    assert "\ns1" not in text
    text.encode()


def loops_missing_by(times):
    return tuple(Loop(("s1", "s2", "s3"), times * 0.002, 0.001, 0.002, True) for _ in range(3))


def test_sigmas_that_loops_contradict_are_called_too_small(site):
    for times, said in ((1.0, False), (6.0, True)):
        text = summary(to_document(replace(site.registration, loops=loops_missing_by(times)), ()))
        assert ("sigmas      too small" in text) is said
    assert f"{6.0:.1f} times" in text


def test_tolerances_on_position_take_the_loops_into_account(site):
    # The largest sigma of the made-up site is 1.6 mm: 3.1 mm at 95 %, within 5 mm, unless loops say 2 times as much.
    estimates = [link.estimate for link in site.registration.links]
    fitting = [replace(one, residuals=replace(one.residuals, p95_m=0.004)) for one in estimates]
    links = tuple(
        replace(link, estimate=one) for link, one in zip(site.registration.links, fitting, strict=True)
    )
    for times, code in ((1.0, 0), (2.0, 4)):
        registration = replace(site.registration, links=links, loops=loops_missing_by(times))
        assert exit_of(registration, PROFILES["loa40"]) == code


def test_the_link_that_spoils_its_loops_stands_out(site):
    loops = (
        Loop(("s1", "s2", "s3"), 0.012, 0.001, 0.002, True),
        Loop(("s2", "s3", "s4"), 0.012, 0.001, 0.002, True),
        Loop(("s2", "s5", "s3"), 0.012, 0.001, 0.002, True),
        Loop(("s1", "s6", "s2"), 0.002, 0.001, 0.002, True),
    )
    factors = loop_factors(to_document(replace(site.registration, loops=loops), ()))
    assert factors[frozenset(("s2", "s3"))] == pytest.approx(6.0)
    assert factors[frozenset(("s1", "s2"))] == pytest.approx(((36 + 1) / 2) ** 0.5)
    assert frozenset(("s4", "s5")) not in factors


def test_scans_that_nothing_checks_are_named_whatever_the_verdict(site):
    alone = with_station(site.registration, 2, status=StationStatus.SINGLE_LINKED)
    missing = with_station(alone, 4, pose=None, status=StationStatus.NOT_PLACED, component=None)
    for registration, profile, code in ((alone, STRICT, 4), (missing, PROFILES["exterior"], 3)):
        verdict = to_document(registration, (), profile)["verdict"]
        assert verdict["exit"] == code
        assert verdict["text"].endswith("held by one path of links only: s3")


def control(point, metres, check=True):
    return ControlMiss(point, "s2", check, (metres, 0.0, 0.0), (0.002, 0.002, 0.002), metres / 0.002)


def test_a_control_point_that_is_far_off_is_4_and_is_named(site):
    near, far = control("C1", 0.005), control("C2", 0.012, check=False)
    assert exit_of(replace(site.registration, control=(near,))) == 0
    document = to_document(replace(site.registration, control=(near, far)), ())
    assert document["verdict"]["exit"] == 4
    (problem,) = document["verdict"]["problems"]
    assert "C2" in problem and "s2" in problem and "12.0 mm" in problem and "6.0 times" in problem
    assert exit_of(replace(site.registration, control=(near, far)), PROFILES["none"]) == 0


def test_the_summary_tells_checks_and_control_apart(site):
    misses = (control("C1", 0.005), control("C2", 0.004), control("C3", 0.001, check=False))
    lines = summary(to_document(replace(site.registration, control=misses), ())).splitlines()
    (checks,) = [line for line in lines if line.startswith("checks")]
    assert "2 points" in checks and "C1" in checks and "5.0 mm" in checks and "2.5 sigma" in checks
    assert any(line.startswith("control") and "C3" in line for line in lines)


def test_a_link_that_a_person_gave_has_no_fit_to_judge(site):
    links = list(site.registration.links)
    index = next(k for k, link in enumerate(links) if link.accepted)
    links[index] = replace(
        links[index], method="given", estimate=replace(links[index].estimate, residuals=None)
    )
    assert exit_of(replace(site.registration, links=tuple(links))) == 0
