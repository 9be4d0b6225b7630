"""What a reader of the pages relies on: links lead somewhere, every page is found, commands are as written."""

import json
import re
import tomllib
from pathlib import Path

import pytest
import typer

from trihedral.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(
    page
    for folder in (".", "docs", "docs/method", "benchmarks/results")
    for page in (ROOT / folder).glob("*.md")
)
FENCE = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
# Made by `make docs`.
MADE = ("docs/figures/made", "docs/api")


def links(page: Path) -> list[str]:
    """Targets of a page's links that are no addresses on the network."""
    found = LINK.findall(FENCE.sub("", page.read_text(encoding="utf-8")))
    return [target for target in found if not re.match(r"[a-z]+:", target)]


def anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_there_are_pages_to_check() -> None:
    assert len(PAGES) > 25
    assert sum(len(links(page)) for page in PAGES) > 80


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    for target in links(page):
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        if there.is_relative_to(ROOT) and str(there.relative_to(ROOT)).startswith(MADE):
            continue
        assert there.exists(), target
        assert not anchor or anchor in anchors(there), target


def test_every_page_is_reached_from_the_readme() -> None:
    reached, ahead = set[Path](), [ROOT / "README.md"]
    while ahead:
        page = ahead.pop()
        if page not in reached and page.suffix == ".md":
            reached.add(page)
            ahead += [(page.parent / target.partition("#")[0]).resolve() for target in links(page)]
    assert set(PAGES) <= reached


def test_every_figure_that_a_page_shows_is_drawn() -> None:
    drawn = set(re.findall(r'^    "(\w+)": ', (ROOT / "docs/figures/__main__.py").read_text(), re.MULTILINE))
    shown = {
        Path(target).stem for page in PAGES for target in links(page) if "figures/made/" in target
    }  # fmt: skip
    assert shown == drawn


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_line_of_prose_is_over_120_characters(page: Path) -> None:
    # A row of a table cannot be broken; the tables of benchmarks are written by programs, with their captions.
    written_by_hand = "results" not in page.parts or page.name == "reproduce.md"
    lines = page.read_text(encoding="utf-8").splitlines() if written_by_hand else []
    assert [line for line in lines if len(line) > 120 and not line.startswith("|")] == []


def commands() -> list[list[str]]:
    """Every `trihedral VERB ...` of the code blocks, without its comment."""
    found = []
    for page in PAGES:
        for line in page.read_text().splitlines():
            if line.startswith("    trihedral "):
                found.append(line.partition(" #")[0].split()[1:])
    return found


def test_commands_have_the_verbs_and_options_that_pages_say() -> None:
    group = typer.main.get_command(app)
    verbs = group.commands  # type: ignore[attr-defined]
    assert len(commands()) > 15
    for verb, *rest in commands():
        known = {option for parameter in verbs[verb].params for option in parameter.opts}
        options = {word for word in rest if re.match(r"--?[a-z]", word)}
        assert options <= known, (verb, options - known)


def test_citation_and_changelog_speak_of_the_version_that_is_built() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert re.search(rf"^## {re.escape(version)}$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)


def test_keys_that_the_glossary_says_are_kept_are_written() -> None:
    table = (ROOT / "docs/glossary.md").read_text().partition("## Words that are kept")[2]
    keys = {
        key
        for row in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)
        for key in re.findall(r"`(\w+)`", row)
    }
    assert {"looks", "likeness"} <= keys
    written = "\n".join(path.read_text() for path in (ROOT / "src/trihedral").rglob("*.py"))
    for key in keys:
        assert json.dumps(key) in written, key
