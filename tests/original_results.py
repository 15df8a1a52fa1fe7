"""The last result of each proof of the original's parts: `tests/original-results.csv`."""

from __future__ import annotations

import csv
from datetime import date
from pathlib import Path

from agribot.lab.original import ProofOutcome, load_table
from tests.nightly_results import ask_git

COLUMNS = ("id", "result", "date", "commit", "reason")
Row = dict[str, str]


def read(root: Path) -> dict[str, Row]:
    """Read the rows of the file, id -> row; none where there is no file."""
    path = _path(root)
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        return {row["id"]: row for row in csv.DictReader(file)}


def keep(root: Path, outcome: ProofOutcome) -> None:
    """Write one outcome beside those that are kept, in the order of the table."""
    rows = read(root) | {outcome.id: _describe(root, outcome)}
    known = [proof.id for proof in load_table().proofs if proof.id in rows]
    with _path(root).open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows[name] for name in known)


def _describe(root: Path, outcome: ProofOutcome) -> Row:
    return {
        "id": outcome.id,
        "result": outcome.state,
        "date": date.today().isoformat(),
        "commit": ask_git(root, "rev-parse", "--short", "HEAD") or "unknown",
        "reason": outcome.reason,
    }


def _path(root: Path) -> Path:
    return root / "tests" / "original-results.csv"
