"""Proofs that each part of the original AGRIBOT works here: `original.toml`, run and judged.

A proof is a list of commands, run one after the other in a folder of its own, and what their
output must show. `agribot doctor --original` runs those that an installed program answers within
seconds; `python scripts/prove_original.py` runs all and records the results for docs/original.md.
"""

from __future__ import annotations

import json
import operator
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import msgspec

TIMEOUT_S = 900.0
# Status of pytest for a session in which nothing was selected.
_NO_TESTS = 5
_COMPARE: dict[str, Callable[[float, float], bool]] = {
    "==": operator.eq,
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
}
_EVERY_TEST = ("-q", "-p", "no:cacheprovider", "-m", "nightly or not nightly")
_SKIPPED = re.compile(r"(\d+) skipped")

State = Literal["pass", "fail", "not run"]


class PartGroup(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A package of the original: the letter that its rows begin with, and its title."""

    letter: str
    title: str


class PartProof(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One row of the table; the fields are described at the head of `original.toml`."""

    id: str
    part: str
    commands: list[str]
    shows: str
    expect: list[str] = []
    values: list[str] = []
    is_quick: bool = False
    left: str = ""


class PartTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All rows, and the text files that their commands find in their folder."""

    groups: list[PartGroup]
    proofs: list[PartProof]
    files: dict[str, str] = {}


class ProofOutcome(msgspec.Struct, frozen=True):
    """End of a proof; `reason` is empty where it passed."""

    id: str
    state: State
    reason: str = ""


class _Output(msgspec.Struct, frozen=True):
    text: str
    status: int


def load_table() -> PartTable:
    """Load the table that comes with the program."""
    text = (files("agribot.lab") / "original.toml").read_text(encoding="utf-8")
    return msgspec.toml.decode(text, type=PartTable)


def choose(proofs: Iterable[PartProof], ids: str = "") -> list[PartProof]:
    """Choose the rows whose ids begin with one of a comma-separated list; all where it is empty."""
    starts = tuple(name for name in ids.split(",") if name)
    return [proof for proof in proofs if not starts or proof.id.startswith(starts)]


def prove(
    proofs: Iterable[PartProof], root: Path | None = None, given: dict[str, str] | None = None
) -> Iterator[ProofOutcome]:
    """Run each proof and judge it.

    Args:
        proofs: rows of the table.
        root: the repository, for rows that run tests; None where only the program is there.
        given: text files that each folder holds, name -> text.
    """
    ran: dict[tuple[str, ...], _Output] = {}
    for proof in proofs:
        commands = tuple(proof.commands)
        if commands not in ran:
            ran[commands] = _run_all(commands, root, given or {})
        yield _judge(proof, ran[commands])


def _run_all(commands: tuple[str, ...], root: Path | None, given: dict[str, str]) -> _Output:
    """Run commands in one folder until one fails; the output of all, the status of the last."""
    said: list[str] = []
    status = 0
    folder = Path(tempfile.mkdtemp(prefix="agribot-proof-"))
    try:
        for name, text in given.items():
            (folder / name).write_text(text, encoding="utf-8")
        for command in commands:
            output = _run(command, folder, root)
            said.append(output.text)
            status = output.status
            if status:
                break
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return _Output("\n".join(said), status)


def _run(command: str, folder: Path, root: Path | None) -> _Output:
    program, *words = shlex.split(command)
    if program == "pytest":
        if root is None:
            return _Output("tests need the repository", _NO_TESTS)
        argv, folder = [sys.executable, "-m", "pytest", *_EVERY_TEST, *words], root
    else:
        argv = [sys.executable, "-m", program, *words]
    try:
        done = subprocess.run(
            argv,
            cwd=folder,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return _Output(f"`{command}` ran for more than {TIMEOUT_S:.0f} s", 1)
    return _Output(done.stdout.decode("utf-8", "replace"), done.returncode)


def _judge(proof: PartProof, output: _Output) -> ProofOutcome:
    if proof.commands[-1].startswith("pytest "):
        skipped = _SKIPPED.search(output.text)
        if output.status == _NO_TESTS or (not output.status and skipped):
            return ProofOutcome(proof.id, "not run", _say_last(output.text))
    if output.status:
        return ProofOutcome(proof.id, "fail", f"status {output.status}: {_say_last(output.text)}")
    for pattern in proof.expect:
        if not re.search(pattern, output.text, re.MULTILINE):
            return ProofOutcome(proof.id, "fail", f"the output lacks {pattern!r}")
    for value in proof.values:
        fault = _check_value(value, output.text)
        if fault:
            return ProofOutcome(proof.id, "fail", fault)
    return ProofOutcome(proof.id, "pass")


def _check_value(rule: str, text: str) -> str:
    """Return what contradicts "PATH OP NUMBER" in the last JSON object of a text, or ""."""
    path, sign, limit = rule.split()
    found: Any = _find_last_object(text)
    for key in path.split("."):
        if isinstance(found, list) and key.isdecimal() and int(key) < len(found):
            found = found[int(key)]
        else:
            found = found.get(key) if isinstance(found, dict) else None
    if not isinstance(found, int | float):
        return f"{path} is {found}, not a number"
    return "" if _COMPARE[sign](found, float(limit)) else f"{path} is {found:g}, not {sign} {limit}"


def _find_last_object(text: str) -> Any:
    for line in reversed(text.splitlines()):
        if line.startswith("{"):
            try:
                return json.loads(line)
            except ValueError:
                continue
    return None


def _say_last(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:200] if lines else "no output"
