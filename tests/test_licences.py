"""The list of licences names all that is used, and OpenCV decodes nothing."""

import importlib.metadata
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
LISTED = {
    row.split(" | ")[0].removeprefix("| ").lower()
    for row in (ROOT / "docs" / "licences.md").read_text(encoding="utf-8").splitlines()
    if row.startswith("| ")
}


def required(name: str) -> set[str]:
    """Names of what a package needs, and what these need, where it is installed; extras apart."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        one = re.match(r"[\w.-]+", waiting.pop())
        assert one is not None
        key = re.sub(r"[-_.]+", "-", one[0]).lower()
        try:
            needs = importlib.metadata.requires(one[0]) or []
        except importlib.metadata.PackageNotFoundError:
            continue
        if key not in found:
            found.add(key)
            waiting += [need for need in needs if "extra ==" not in need]
    return found


def test_every_package_that_is_used_at_run_time_is_listed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    own = [*project["dependencies"], *project["optional-dependencies"]["simulate"]]
    used = set().union(*(required(need) for need in [*own, *project["optional-dependencies"]["dask"]]))
    assert used - {re.sub(r"[-_.]+", "-", name) for name in LISTED} == set()


def test_every_crate_that_the_project_names_is_listed() -> None:
    for part in ("core", "bindings"):
        manifest = tomllib.loads((ROOT / part / "Cargo.toml").read_text(encoding="utf-8"))
        assert set(manifest["dependencies"]) - {"trihedral-core"} <= LISTED


def test_opencv_opens_and_decodes_nothing() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py"))
    assert not re.search(r"cv2\.(imread|imdecode|VideoCapture|FileStorage)", text)
