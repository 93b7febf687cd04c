"""What the documentation and docstrings name must exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "spin_rl").rglob("*.py")]
HISTORY = "CHANGELOG.md"


def names_of_files():
    return {
        path.name for folder in ("spin_rl", "tests", "docs", "conf") for path in (ROOT / folder).rglob("*.py")
    }


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


@pytest.mark.parametrize("file", [file for file in FILES if file.suffix == ".md"], ids=lambda file: file.name)
def test_links_lead_somewhere(file):
    for target in re.findall(r"\]\((?!https?:)([^)#\s]+)", file.read_text()):
        assert (file.parent / target).exists(), target
