"""docs/results.md is what spin-eval writes of results/; and the tables as a user calls them."""

import json
import re
from pathlib import Path

import pytest
from stored_results import store_all

from spin_rl.cli import evaluate
from spin_rl.paths import RESULT_DIR
from spin_rl.reproduce import state
from spin_rl.reproduce.plan import PAPER
from spin_rl.reproduce.tables.page import open_stored, page
from spin_rl.reproduce.tables.registry import PLANS, TABLES
from spin_rl.reproduce.tables.texts import TEXTS

COMMITTED = Path(__file__).parents[2] / "docs" / "results.md"


@pytest.fixture
def results(tmp_path, monkeypatch):
    """A folder of results that is empty at first."""
    monkeypatch.setattr(state, "RESULT_DIR", tmp_path / "results")
    return tmp_path / "results"


@pytest.fixture
def spin_eval(monkeypatch, capsys):
    """Calls the command; returns its status, standard output and error."""

    def call(*arguments):
        monkeypatch.setattr("sys.argv", ["spin-eval", *arguments])
        status = 0
        try:
            evaluate.main()
        except SystemExit as end:
            status = end.code
        return status, *capsys.readouterr()

    return call


def test_the_committed_page_is_what_the_results_say():
    assert COMMITTED.read_text() == page(), "spin-eval table=all out=docs/results.md"


def test_rows_of_one_name_are_of_one_run():
    """A policy that was trained anew is measured anew in all tables."""
    runs = {}
    for file in sorted(RESULT_DIR.glob("*/*.json")):
        for training in json.loads(file.read_text())["trainings"]:
            run = (training["env_steps"], training["minutes"], training["success_rate"])
            assert runs.setdefault(training["name"], run) == run, file


def test_the_page_has_every_table_with_its_sentences_and_command(results):
    text = page()
    papers = [name for name, plan in PLANS.items() if plan == PAPER]  # another plan's once it can be made
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == [TEXTS[name].title for name in papers]
    for name in papers:
        assert text.count(f"\n    spin-eval table={name}\n") == 1
    assert text.count("Not measured yet, ") == text.count("\n    spin-reproduce ") == len(papers)
    assert "|" not in text
    store_all(open_stored("1").steps, lambda name, cell: 50)
    whole = page()
    assert whole.count("\n| --- |") == len(papers) and "Not measured yet, " not in whole


def test_the_page_has_tables_of_other_plans_once_they_can_be_made(results, monkeypatch):
    store_all(open_stored("1").steps, lambda name, cell: 50)
    made = TABLES["1"](open_stored("1"))
    monkeypatch.setattr(
        "spin_rl.reproduce.tables.page.TABLES", {**TABLES, "active_camera": lambda stored: made}
    )
    assert page().count(f"\n## {made.title}\n") == 2


def test_figures_in_the_tables_sentences_are_those_of_the_results():
    def told(table, pattern):
        return [float(figure) for figure in re.findall(pattern, TEXTS[table].about)]

    def result(name):
        return json.loads((RESULT_DIR / f"{name}.json").read_text())["result"]

    missed = []
    for mount in ("corridors_landscape", "corridors"):
        sight = result(f"sight/{mount}")
        pose_iv = sight["sight"]["pans"].index(0.0), sight["sight"]["tilts"].index(-0.2)
        missed.append(round(100 * sight["groups"][0]["unseen"][pose_iv[0]][pose_iv[1]]))
    assert told("fixcam", r"in (\d+) %") == missed

    def hard(name, key):
        rows = [row[key] for row in result(f"reach/{name}")["rows"] if row["difficulty"] == "hard"]
        return sum(rows) / len(rows)

    usual = {key: 0.5 * (hard("cvo-1", key) + hard("cvo-2", key)) for key in ("success_rate", "timeout_rate")}
    for name in ("visibility_3-2", "visibility_5-2"):
        lost = usual["success_rate"] - hard(name, "success_rate")
        assert told("visibility", r"lose (\d+) points") == [round(100 * lost)]
        assert 0.0 < hard(name, "timeout_rate") - usual["timeout_rate"] < 0.5 * lost
    for name in ("visibility_3-1", "visibility_5-1"):
        assert usual["success_rate"] - hard(name, "success_rate") < 0.02


def test_texts_are_two_sentences_at_most():
    assert TEXTS.keys() == TABLES.keys()
    for text in TEXTS.values():
        assert len(re.findall(r"[.!?](?= |$)", text.about)) <= 2
        assert text.about.endswith(".")


def test_all_tables_go_to_the_terminal_and_a_page(results, spin_eval, tmp_path):
    status, out, _ = spin_eval("table=all", f"out={tmp_path / 'page.md'}")
    assert status == 0 and out.startswith("# Results\n") and out.endswith(f"Wrote {tmp_path / 'page.md'}\n")
    assert (tmp_path / "page.md").read_text() == page()


def test_one_table_goes_to_the_terminal_and_every_format(results, spin_eval, tmp_path):
    store_all(open_stored("1").steps, lambda name, cell: 50)
    assert spin_eval("table=1")[1].endswith("(out=<file.md or .csv or .json or .txt> keeps it)\n")
    for ending in ("md", "csv", "json", "txt"):
        status, out, _ = spin_eval("table=fixcam", f"out={tmp_path / 'table'}.{ending}")
        assert status == 0 and out.startswith("FixCam: success") and "moving over FixCam IV on hard: " in out
    assert json.loads((tmp_path / "table.json").read_text())["missing"] is None
    assert (tmp_path / "table.csv").read_text().startswith("method,scenario,difficulty,success_rate,")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["table=nonsense"], "table: unknown 'nonsense'; choose from 1, place, fixcam"),
        (["table=[1]"], "table: "),
        (["table=dynamic"], "table: dynamic: not measured yet, 6 results: spin-reproduce run=true "),
        (["table=all", "fresh=true"], "fresh: name one table, of 1, place"),
        (["table=all", "out=a.csv"], "out: table=all is written to .md, not to a.csv"),
        (["table=1", "out=a"], "out: table=1 is written to .md or .csv or .json or .txt, not to a"),
        (["table=1", "policy=nav-cvo"], "policy: table=1 is of stored results"),
    ],
)
def test_what_cannot_be_shown_is_one_line(results, spin_eval, arguments, said):
    status, _, error = spin_eval(*arguments)
    assert status == 2 and error.startswith(f"spin-eval: error: {said}") and error.count("\n") == 1


@pytest.mark.parametrize("table", ["1", "all"])
def test_half_a_result_is_named(results, spin_eval, table):
    file = results / "reach" / "cvo-1.json"
    file.parent.mkdir(parents=True)
    file.write_text('{"command": "spin-eval", "re')
    status, _, error = spin_eval(f"table={table}")
    assert status == 2 and error.count("\n") == 1
    assert error.startswith(f"spin-eval: error: table: {file} is no whole JSON, which 1 reads; ")
