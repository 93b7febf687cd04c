"""Breaks a copy of the package in one place after another: do the tests notice?

    make mutants                  all of table.yaml, some minutes
    make mutants ARGS='-k fetch'  those with this in their name
    make mutants ARGS='-j 4'      four at a time instead of two

Exits with 1 if a mutant survives, is stale (its text is not in the file exactly once) or cannot be judged.
The checkout is only read. Mutated kernels are compiled anew and end in Warp's cache beside the others.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

import yaml

ROOT = Path(__file__).resolve().parents[2]
TABLE = Path(__file__).with_name("table.yaml")
COPIED = ("spin_rl", "conf", "robots", "policies", "tests", "pyproject.toml")
LIMIT_S = 600.0
KILLED = "killed"


@dataclass(frozen=True)
class Mutant:
    """One change, and the tests that must fail with it; paths are from the repository's root."""

    name: str
    file: str
    old: str
    new: str
    tests: list[str]


@dataclass(frozen=True)
class Verdict:
    """What became of a mutant, and one line about it."""

    kind: str
    detail: str = ""


def read_table(path: Path) -> list[Mutant]:
    """Read all mutants.

    Raises:
        ValueError: An entry lacks a key or has another one, or two have one name.
    """
    mutants = []
    for entry in yaml.safe_load(path.read_text(encoding="utf-8")):
        try:
            mutants.append(Mutant(**entry | {"tests": entry["tests"].split()}))
        except (KeyError, TypeError) as error:
            raise ValueError(f"{path.name}: {entry.get('name', entry)}: {error}") from None
    names = [mutant.name for mutant in mutants]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{path.name}: two mutants are called {name}")
    return mutants


def stale(mutant: Mutant, root: Path) -> str | None:
    """Say why a mutant cannot be made of this checkout, or None if it can."""
    for path in (mutant.file, *mutant.tests):
        if not (root / path).is_file():
            return f"there is no {path}"
    count = (root / mutant.file).read_text(encoding="utf-8").count(mutant.old)
    return None if count == 1 else f"its text is {count} times in {mutant.file}"


def copy_checkout(folder: Path) -> None:
    """Copy what the tests need."""
    folder.mkdir()
    for name in COPIED:
        source, target = ROOT / name, folder / name
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, target)


def run_tests(tests: list[str], folder: Path, limit_s: float | None) -> tuple[int, list[str]]:
    """Run test files of the copy until the first failure; return pytest's exit code and output."""
    # Without files of byte code: two mutants of one second and size would share them.
    env = os.environ | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "--tb=line", "-p", "no:cacheprovider", *tests]
    done = subprocess.run(
        command, cwd=folder, env=env, timeout=limit_s, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    return done.returncode, done.stdout.splitlines()


def judge(mutant: Mutant, folder: Path) -> Verdict:
    """Make a mutant in the copy, run its tests, and undo it."""
    path = folder / mutant.file
    whole = path.read_text(encoding="utf-8")
    path.write_text(whole.replace(mutant.old, mutant.new), encoding="utf-8")
    try:
        code, output = run_tests(mutant.tests, folder, LIMIT_S)
    except subprocess.TimeoutExpired:
        return Verdict("STUCK", f"its tests go on after {LIMIT_S:.0f} s")
    finally:
        path.write_text(whole, encoding="utf-8")
    if code == 0:
        return Verdict("SURVIVED", " ".join(mutant.tests))
    failed = [line.removeprefix("FAILED ").split(" - ")[0] for line in output if line.startswith("FAILED ")]
    if code == 1 and failed:
        return Verdict(KILLED, failed[0])
    # A change that does not even load proves nothing about the tests.
    return Verdict("BROKEN", f"pytest ended with {code}: {output[-1] if output else ''}")


def judge_all(mutants: list[Mutant], folders: list[Path]) -> bool:
    """Judge and print every mutant, one at a time in each copy; return whether all were killed."""
    idle: SimpleQueue[Path] = SimpleQueue()
    for folder in folders:
        idle.put(folder)

    def judge_one(mutant: Mutant) -> str:
        start, folder = time.monotonic(), idle.get()
        why_not = stale(mutant, folder)
        verdict = judge(mutant, folder) if why_not is None else Verdict("STALE", why_not)
        idle.put(folder)
        seconds = time.monotonic() - start
        print(f"{verdict.kind:8} {mutant.name}  ({seconds:.0f} s) {verdict.detail}", flush=True)
        return verdict.kind

    with ThreadPoolExecutor(len(folders)) as pool:
        kinds = list(pool.map(judge_one, mutants))
    counts = ", ".join(f"{kinds.count(kind)} {kind.lower()}" for kind in dict.fromkeys(kinds))
    print(f"{len(mutants)} mutants: {counts}")
    return set(kinds) <= {KILLED}


def main() -> int:
    """Judge the chosen mutants; return the exit code."""
    parser = argparse.ArgumentParser(description="Do the tests notice what breaks?")
    parser.add_argument("-k", dest="part", default="", help="only mutants with this in their name")
    parser.add_argument("-j", dest="jobs", type=int, default=2, help="how many at a time")
    args = parser.parse_args()
    part = args.part
    mutants = [mutant for mutant in read_table(TABLE) if part in mutant.name]
    if not mutants:
        print(f"no mutant has {part!r} in its name")
        return 1
    with tempfile.TemporaryDirectory(prefix="spin-rl-mutants-") as name:
        folders = [Path(name) / str(job) for job in range(args.jobs)]
        for folder in folders:
            copy_checkout(folder)
        tests = sorted({test for mutant in mutants if not stale(mutant, ROOT) for test in mutant.tests})
        code, output = run_tests(tests, folders[0], None) if tests else (0, [])
        if code != 0:
            print("\n".join([*output[-20:], "These tests must pass before anything is broken."]))
            return 1
        return 0 if judge_all(mutants, folders) else 1


if __name__ == "__main__":
    sys.exit(main())
