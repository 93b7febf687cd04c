"""The commit that a figure is stored with."""

import subprocess

import pytest

from spin_rl.machine import commit


def git(folder, *arguments):
    subprocess.run(["git", "-C", folder, "-c", "user.name=a", "-c", "user.email=a@b", *arguments], check=True)


@pytest.fixture
def checkout(tmp_path):
    """A checkout with a file of code and a result."""
    git(tmp_path, "init", "--quiet")
    for name in ("code.py", "results/reach/a.json", "docs/results.md"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "-m", "feat: a")
    return tmp_path


def test_the_commit_is_that_of_git(checkout):
    command = ["git", "-C", checkout, "rev-parse", "HEAD"]
    whole = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert len(commit(checkout)) == 12 and whole.startswith(commit(checkout))


@pytest.mark.parametrize(
    "name", ["results/reach/a.json", "docs/results.md", "results/reach/new.json", "new.py"]
)
def test_results_and_files_that_git_does_not_know_are_no_changes_of_the_code(checkout, name):
    clean = commit(checkout)
    (checkout / name).write_text("2")
    assert commit(checkout) == clean


def test_changed_code_is_told_committed_or_not(checkout):
    clean = commit(checkout)
    (checkout / "code.py").write_text("2")
    assert commit(checkout) == f"{clean}-dirty"
    git(checkout, "add", ".")
    assert commit(checkout) == f"{clean}-dirty"
    git(checkout, "commit", "--quiet", "-m", "feat: b")
    assert commit(checkout) not in (clean, f"{clean}-dirty")


def test_outside_of_a_checkout_there_is_none(tmp_path):
    assert commit(tmp_path) is None
    git(tmp_path, "init", "--quiet")
    assert commit(tmp_path) is None  # nothing is committed yet
