"""The table of the original's parts names commands that are there, and its proofs can fail."""

from __future__ import annotations

import ast
import json
import re
import shlex
from collections import Counter
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.lab import original
from agribot.lab.original import PartProof, PartTable

ROOT = Path(__file__).parents[2]
TABLE = original.load_table()
# Rows of each package and promise of the original.
COUNTS = {"A": 14, "B": 10, "C": 8, "D": 8, "E": 3, "F": 14, "G": 9, "H": 7, "I": 4, "P": 27}
COUNTS |= {"J": 5, "K": 1, "L": 18, "M": 12, "N": 1}


def _proof(*commands: str, **rest: object) -> PartProof:
    words = {"id": "A1", "part": "a part", "shows": "it works", "commands": list(commands)}
    return PartProof(**(words | rest))  # type: ignore[arg-type]


def _end_of(proof: PartProof) -> tuple[str, str]:
    (outcome,) = original.prove([proof], ROOT, {"lines.txt": "one\n"})
    return outcome.state, outcome.reason


def test_every_part_of_the_original_has_one_row() -> None:
    ids = [proof.id for proof in TABLE.proofs]
    assert len(set(ids)) == len(ids) == 141
    assert Counter(name[0] for name in ids) == COUNTS
    assert [group.letter for group in TABLE.groups] == list(COUNTS)


def test_every_test_that_a_row_names_is_there() -> None:
    commands = {command for proof in TABLE.proofs for command in proof.commands}
    absent: list[tuple[str, str]] = []
    for command in sorted(commands):
        program, *words = shlex.split(command)
        if program != "pytest":
            assert program == "agribot", command
            continue
        names = re.findall(r"def (test_\w+)", (ROOT / words[0]).read_text(encoding="utf-8"))
        # What follows "and" is the id of a case.
        terms = words[2].split(" or ") if len(words) > 1 else [""]
        wanted = [term.split(" and ")[0].strip("()") for term in terms]
        absent += [(command, word) for word in wanted if not any(word in name for name in names)]
    assert not absent


def test_patterns_and_values_of_the_table_can_be_read() -> None:
    for proof in TABLE.proofs:
        assert proof.shows, proof.id
        for pattern in proof.expect:
            re.compile(pattern)
        for value in proof.values:
            path, sign, limit = value.split()
            assert path, value
            assert sign in {"==", ">=", "<=", ">", "<"}, value
            assert isinstance(ast.literal_eval(limit), int | float), value


def test_a_command_whose_output_shows_what_is_expected_passes() -> None:
    assert _end_of(_proof("agribot --version", expect=[r"^agribot \d"])) == ("pass", "")
    in_a_list = _proof("agribot describe --json", values=["links.1.mass_kg > 1"])
    assert _end_of(in_a_list) == ("pass", "")


@pytest.mark.parametrize(
    ("proof", "reason"),
    [
        (_proof("agribot --version", expect=["another program"]), "the output lacks"),
        (_proof("agribot world check lines.txt"), "status 2"),
        (
            _proof("agribot describe --json", values=["implement.nozzle_count == 9"]),
            "is 27, not ==",
        ),
        (
            _proof("agribot describe --json", values=["implement.wings > 0"]),
            "is None, not a number",
        ),
    ],
)
def test_a_command_that_shows_something_else_fails(proof: PartProof, reason: str) -> None:
    state, said = _end_of(proof)
    assert state == "fail"
    assert reason in said


def test_tests_that_are_skipped_or_not_there_are_no_proof() -> None:
    proof = _proof("pytest tests/lab/test_original.py -k no_test_has_this_name")
    assert _end_of(proof)[0] == "not run"


def test_the_doctor_names_the_row_that_fails(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    good = _proof("agribot --version", is_quick=True)
    bad = _proof("agribot world check no.world", id="B1", is_quick=True)
    dear = _proof("agribot run farm", id="C1")
    table = PartTable(groups=TABLE.groups, proofs=[good, bad, dear])
    monkeypatch.setattr(original, "load_table", lambda: table)
    assert main(["doctor", "--original", "--json"]) == 1
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert [(row["id"], row["result"]) for row in result["rows"]] == [
        ("A1", "pass"),
        ("B1", "fail"),
    ]
