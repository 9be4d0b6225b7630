"""registration.json and poses.csv: to the schema, exact, same result same bytes, clear when broken."""

import csv
import itertools
import json
import math
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from support.links import evidence
from trihedral.errors import InputError
from trihedral.model.link import PoseEstimate, Residuals
from trihedral.report import Document, read_result, to_document, write_poses, write_result


@pytest.fixture(scope="module")
def validator() -> jsonschema.Draft202012Validator:
    schema = json.loads((files("trihedral.report") / "registration.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_the_schema_asks_for_all_that_the_design_asks_for(shared: Path, validator) -> None:
    asked = json.loads((shared / "registration.schema.json").read_text())

    def within(less, more):
        if isinstance(less, dict):
            return isinstance(more, dict) and all(k in more and within(v, more[k]) for k, v in less.items())
        return less == more

    assert within(asked, validator.schema)


def test_every_job_keeps_to_the_schema(site, troubled, looked, validator, tmp_path):
    alone = replace(site.registration, stations=site.registration.stations[:1], links=(), loops=())
    nothing_found = replace(troubled.registration, links=(), loops=())
    for registration in (
        site.registration,
        troubled.registration,
        looked.registration,
        alone,
        nothing_found,
    ):
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.json"
        write_result(to_document(registration, site.inputs), path)
        validator.validate(json.loads(path.read_text()))


def test_what_is_written_is_read_back_bit_for_bit(troubled, tmp_path):
    document = to_document(troubled.registration, troubled.inputs)
    write_result(document, tmp_path / "registration.json")
    again = read_result(tmp_path)
    assert again == document
    for station, entry in zip(troubled.registration.stations, again["stations"], strict=True):
        if station.pose is not None:
            assert np.array(entry["pose"]).tobytes() == station.pose.tobytes()


def test_the_order_of_files_and_links_does_not_show(looked, tmp_path):
    registration = looked.registration
    turned = replace(
        registration,
        stations=registration.stations[::-1],
        links=registration.links[::-1],
        loops=registration.loops[::-1],
        previews=registration.previews[::-1],
        options=dict(reversed(list(registration.options.items()))),
    )
    for name, job, inputs in (("a", registration, looked.inputs), ("b", turned, looked.inputs[::-1])):
        write_result(to_document(job, inputs), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_previews_say_what_was_decided_of_each_pair(looked):
    previews = to_document(looked.registration, looked.inputs)["looks"]
    assert [(k["from"], k["to"]) for k in previews] == [
        ("s1", "s2"),
        ("s4", "s5"),
        ("s5", "s7"),
        ("s7", "s4"),
        ("s10", "s2"),
    ]
    assert previews[2] == {
        "from": "s5",
        "to": "s7",
        "because": "nothing ties a part",
        "round": 2,
        "score": 0.2,
        "likeness": -0.1,
        "decision": "passed over",
        "reason": "surfaces do not look the same",
    }
    assert (previews[4]["score"], previews[4]["likeness"]) == (1 / 3, None)
    assert (previews[0]["decision"], previews[0]["reason"]) == ("registered", None)


def test_the_evidence_of_a_link_is_written_with_the_flags_that_are_set(site):
    first = site.registration.links[0]
    plain = to_document(replace(site.registration, links=(first,)), ())["links"][0]["evidence"]
    # What the method itself found, beside the pose's own figures.
    assert (plain["score"], plain["held_area_m2"], plain["compared"]) == (0.5, 100.0, 41_000)
    assert plain["weakest_rotation_deg"] == pytest.approx(math.degrees(math.sqrt(2e-9)))
    flags = ("unseen", "contradicted", "forced", "locked", "confirmed_by_loops")
    assert not {*flags, "likeness", "appearance_similarity"} & plain.keys()
    for flag, changes in {
        "unseen": {"evidence": evidence(enclosed=True)},
        "contradicted": {"evidence": evidence(contradicted=True)},
        "forced": {"decision": "forced"},
        "locked": {"decision": "locked"},
        "confirmed_by_loops": {"confirmed_by_loops": True},
    }.items():
        registration = replace(site.registration, links=(replace(first, **changes),))
        found = to_document(registration, ())["links"][0]["evidence"]
        assert {name: found[name] for name in flags if name in found} == {flag: True}
    seen = replace(first, evidence=evidence(appearance_similarity=0.9, enclosed=True))
    found = to_document(replace(site.registration, links=(seen,)), ())["links"][0]["evidence"]
    assert found["likeness"] == found["appearance_similarity"] == 0.9 and "unseen" not in found


def test_time_lies_under_timing_and_seconds_only(site):
    slower = replace(
        site.registration,
        timing={"prepare": 99.0},
        links=tuple(replace(link, seconds={"refine": 77.0}) for link in site.registration.links),
    )
    first, second = (to_document(r, site.inputs) for r in (site.registration, slower))
    assert first != second
    for document in (first, second):
        del document["timing"]
        for link in document["links"]:
            del link["seconds"]
    assert first == second


def test_figures_that_are_not_finite_become_null_and_poses_must_be_finite(site, validator):
    first = site.registration.links[0]
    link = replace(
        first,
        estimate=PoseEstimate(
            first.transform, np.diag([1.0] * 3 + [np.inf] * 3), Residuals(math.nan, 0.001, math.inf, 0.003)
        ),
        overlap_from=math.nan,
    )
    document = to_document(replace(site.registration, links=(link,)), site.inputs)
    entry = document["links"][0]
    assert (entry["rmse_m"], entry["median_m"], entry["p95_m"]) == (None, 0.001, None)
    assert entry["weakest_direction"]["sigma_m"] is None and entry["covariance"] is None
    assert entry["overlap"] is None
    validator.validate(document)

    broken = replace(site.registration.stations[0], pose=np.full((4, 4), np.nan))
    with pytest.raises(ValueError, match="finite"):
        to_document(replace(site.registration, stations=(broken,), links=()), site.inputs)


def test_failures_are_in_the_document(troubled):
    document = to_document(troubled.registration, troubled.inputs)
    assert document["failures"] == [
        {
            "path": "site/s8.e57",
            "scan_index": None,
            "reason": "the file ends at byte 1048576, inside its points",
        }
    ]


def matrix_of(w: float, x: float, y: float, z: float) -> np.ndarray:
    """Rotation of a unit quaternion, from the textbook's formula."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_poses_csv_holds_the_same_poses(troubled, tmp_path):
    half_turns = [
        np.diag([1.0, -1.0, -1.0, 1.0]),
        np.diag([-1.0, -1.0, 1.0, 1.0]),
        np.diag([-1.0, 1.0, -1.0, 1.0]),
    ]
    stations = list(troubled.registration.stations)
    for index, pose in enumerate(half_turns):
        stations[index] = replace(stations[index], pose=pose)
    document = to_document(replace(troubled.registration, stations=tuple(stations)), ())
    write_poses(document, tmp_path / "poses.csv")
    with (tmp_path / "poses.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == [station.name for station in stations]
    assert [row["status"] for row in rows] == [station.status.value for station in stations]
    for row, station in zip(rows, stations, strict=True):
        quaternion = [row[key] for key in ("qw", "qx", "qy", "qz")]
        if station.pose is None:
            assert {*quaternion, row["tx"], row["sigma_tx_m"]} == {""}
            continue
        values = [float(text) for text in quaternion]
        assert values[0] >= 0.0
        np.testing.assert_allclose(matrix_of(*values), station.pose[:3, :3], atol=1e-15)
        assert [float(row[key]) for key in ("tx", "ty", "tz")] == station.pose[:3, 3].tolist()
        assert [float(row[f"sigma_t{axis}_m"]) for axis in "xyz"] == list(station.sigma_translation_m)
        assert [float(row[f"sigma_r{axis}_deg"]) for axis in "xyz"] == list(station.sigma_rotation_deg)


def test_names_that_need_quoting_survive(site, tmp_path):
    name = 'north, "old"\nwing'
    station = replace(site.registration.stations[0], name=name)
    document = to_document(replace(site.registration, stations=(station,), links=(), loops=()), ())
    write_poses(document, tmp_path / "poses.csv")
    write_result(document, tmp_path / "registration.json")
    with (tmp_path / "poses.csv").open(newline="") as file:
        assert next(csv.DictReader(file))["name"] == name
    assert read_result(tmp_path)["stations"][0]["name"] == name


def test_names_of_files_that_are_not_utf8_can_be_written(site, tmp_path):
    station = replace(site.registration.stations[0], name=b"caf\xe9".decode(errors="surrogateescape"))
    document = to_document(replace(site.registration, stations=(station,), links=(), loops=()), ())
    write_poses(document, tmp_path / "poses.csv")
    write_result(document, tmp_path / "registration.json")
    assert read_result(tmp_path) == document


def spoil(document: Document, *steps: tuple[list[object], object]) -> str:
    copy = json.loads(json.dumps(document))
    for path, value in steps:
        place = copy
        for key in path[:-1]:
            place = place[key]
        if value is KeyError:
            del place[path[-1]]
        else:
            place[path[-1]] = value
    return json.dumps(copy)


MIRROR = np.diag([1.0, 1.0, -1.0, 1.0]).tolist()


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        (["schema"], "trihedral.registration/2", "registration/2"),
        (["stations"], KeyError, "stations"),
        (["links"], {}, "links"),
        (["verdict"], None, "verdict"),
        (["stations", 1, "status"], KeyError, r"stations\[1\]: lacks status"),
        (["stations", 1], "s2", r"stations\[1\]"),
        (["stations", 1, "name"], "s1", "s1"),
        (["stations", 0, "pose"], MIRROR, r"stations\[0\]\.pose: is not a rigid motion"),
        (["stations", 0, "pose"], [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]], "rigid"),
        (["stations", 0, "pose"], [[1, 0], [0, 1]], "rigid"),
        (["stations", 0, "pose"], "identity", "rigid"),
        (["stations", 0, "pose", 0, 3], math.nan, "rigid"),
        (["links", 0, "transform"], MIRROR, r"links\[0\]"),
        (["links", 0, "to"], "s99", "s99"),
        (["loops", 0, "ok"], KeyError, r"loops\[0\]"),
    ],
)
def test_a_result_that_others_could_not_rely_on_is_refused(site, tmp_path, path, value, says):
    file = tmp_path / "registration.json"
    file.write_text(spoil(to_document(site.registration, site.inputs), (path, value)))
    with pytest.raises(InputError, match=says) as caught:
        read_result(file)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(
    "content", [b"", b"[]", b"7", b"{}", b'{"schema": null}', b"\xff\xfe{", b"[" * 200_000]
)
def test_what_is_no_result_at_all_is_refused(tmp_path, content):
    (tmp_path / "registration.json").write_bytes(content)
    with pytest.raises(InputError, match=r"registration\.json"):
        read_result(tmp_path)


def test_a_result_cut_short_anywhere_is_refused(troubled, tmp_path):
    file = tmp_path / "registration.json"
    write_result(to_document(troubled.registration, troubled.inputs), file)
    whole = file.read_bytes()
    for end in itertools.chain(range(0, len(whole) - 2, 397), [len(whole) - 2]):
        file.write_bytes(whole[:end])
        with pytest.raises(InputError):
            read_result(file)


def test_a_missing_result_says_what_writes_it(tmp_path):
    with pytest.raises(InputError, match="trihedral register"):
        read_result(tmp_path)
