"""A progress file in which any value is of another kind is refused."""

import copy
import json
from pathlib import Path

import pytest

from trihedral.errors import InputError
from trihedral.job.progress_file import PROGRESS_FILE, read_progress

PHASE = {"name": "Preparing", "unit": "scans", "total": 3, "done": 1, "seconds": 1.5, "rate": 2.0}
RECORD = {
    "process": 1,
    "machine": "m",
    "began": 1.0,
    "now": 2.0,
    "ended": False,
    "notes": ["a"],
    "phases": [PHASE],
}


@pytest.mark.parametrize("odd", [[], {}, "x", -1, 1e400, 10**400])
def test_values_of_another_kind_are_refused(tmp_path: Path, odd: object) -> None:
    path = tmp_path / PROGRESS_FILE
    path.write_text(json.dumps(RECORD))
    assert read_progress(tmp_path) is not None
    for key in ("process", "machine", "began", "notes", "phases", "total", "name", "rate"):
        record = copy.deepcopy(RECORD)
        place = record["phases"][0] if key in PHASE else record
        if type(place[key]) is type(odd) or (odd == -1 and key in ("began", "rate")):
            continue
        place[key] = odd
        path.write_text(json.dumps(record))
        with pytest.raises(InputError, match=PROGRESS_FILE):
            read_progress(tmp_path)
