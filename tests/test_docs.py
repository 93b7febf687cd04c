"""What the documentation and docstrings name must exist; pages must stay readable as text and as a site."""

import pkgutil
import re
from functools import cache
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PAGES = [
    *ROOT.glob("*.md"),
    *(ROOT / "docs").rglob("*.md"),
    *(ROOT / "policies").glob("*.md"),
    *(ROOT / "robots").rglob("*.md"),
]
FILES = [*PAGES, *(ROOT / "spin_rl").rglob("*.py")]
HISTORY = "CHANGELOG.md"
LONGEST_LINE = 140
CARDS = ROOT / "policies"  # written by spin_rl.cli.ship, a paragraph to a line

each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def names_of_files():
    return {
        path.name for folder in ("spin_rl", "tests", "docs", "conf") for path in (ROOT / folder).rglob("*.py")
    }


def prose(page):
    """Lines of a page outside of code, with their numbers."""
    fenced = False
    for number, line in enumerate(page.read_text().splitlines(), start=1):
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif not fenced and not line.startswith("    "):
            yield number, line


@cache
def anchors(page):
    """Anchors of a page's headings, as GitHub makes them."""
    found = []
    for _, line in prose(page):
        if heading := re.fullmatch(r"#+ (.*)", line):
            text = re.sub(r"\]\([^)]*\)", "", heading[1]).lower()
            found.append(re.sub(r"[^\w\- ]", "", text).replace(" ", "-"))
    return found


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_named_python_files_exist(file):
    known, missing = names_of_files(), []
    for name in set(re.findall(r"`([\w/]+\.py)`", file.read_text())):
        places = (ROOT, ROOT / "spin_rl", file.parent)
        found = name in known if "/" not in name else any((place / name).is_file() for place in places)
        inside = "/" in name and any(ROOT.glob(f"spin_rl/**/{name}"))
        if file.name != HISTORY and not found and not inside:
            missing.append(name)
    assert missing == []


@each_page
def test_links_lead_somewhere(page):
    for target, anchor in re.findall(r"\]\((?!\w+:)([^)#\s]*)(?:#([^)\s]*))?\)", page.read_text()):
        meant = page.parent / target if target else page
        assert meant.exists(), target
        if anchor:
            assert anchor in anchors(meant.resolve()), f"{target}#{anchor}"


@each_page
def test_headings_can_be_told_apart_by_their_anchors(page):
    if page.name != HISTORY:
        assert len(set(anchors(page))) == len(anchors(page))


@each_page
def test_lines_can_be_read_in_a_terminal(page):
    for number, line in prose(page):
        text = re.sub(r"\]\([^)]*\)", "]", line)
        if not text.startswith("|") and page.parent != CARDS:
            assert len(text) <= LONGEST_LINE, f"line {number}"


@each_page
def test_lists_and_tables_stand_apart_as_the_site_wants_them(page):
    before = ""
    for number, line in prose(page):
        for start in (r"\|", r"([-*]|\d+\.) "):
            opens = re.match(start, line) and not re.match(rf"{start}|  |#", before)
            assert not (opens and before.strip()), f"line {number}"
        before = line


def test_every_experiment_has_a_table_and_an_answer():
    entries = re.split(r"^### ", (ROOT / "docs/experiments.md").read_text(), flags=re.MULTILINE)[1:]
    for entry in entries:
        assert "\n|---" in entry and entry.count("**Answer.**") == 1, entry.splitlines()[0]


def test_every_page_is_in_the_sites_navigation():
    # Tags name Python functions that are there when the site is built.
    yaml.SafeLoader.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)
    navigation = str(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"])
    for page in (ROOT / "docs").rglob("*.md"):
        assert f"'{page.relative_to(ROOT / 'docs')}'" in navigation


@pytest.mark.parametrize("page", list((ROOT / "docs/api").glob("*.md")), ids=lambda page: page.stem)
def test_the_api_reference_names_what_there_is(page):
    names = re.findall(r"^::: ([\w.]+)$", page.read_text(), re.MULTILINE)
    assert names
    for name in names:
        documented = pkgutil.resolve_name(name)
        assert documented.__doc__
