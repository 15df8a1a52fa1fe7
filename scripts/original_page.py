"""Print docs/original.md: how many parts of the original are proved, and those that are not.

docs/results/original.csv has each part with its commands and their result. The rows are those of
`agribot.lab.original`, the results those of tests/original-results.csv. `make pages` writes both.
"""

from __future__ import annotations

import csv
import io
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from agribot.lab.original import PartProof, PartTable, load_table  # noqa: E402
from tests import original_results  # noqa: E402

HEAD = """# Every part of the original

Written by `make pages`. [A table](results/original.csv) has a row for each part of the original
AGRIBOT, and for each promise of its pages: the commands that show that it works here, what they
show, and their last result with date and commit. `agribot doctor --original` runs the quick ones on
any machine; `python scripts/prove_original.py`, in the repository, runs all of them and keeps the
results. [Coming from the original](coming-from-the-original.md) says what each package, node and
launch file is called here.

"""
COLUMNS = ("row", "group", "part of the original", "commands", "what they show", "not yet", "quick",
           "result", "date", "commit")  # fmt: skip
Results = dict[str, dict[str, str]]


def page() -> str:
    """Write the page from the table and the results."""
    table = load_table()
    results = original_results.read(ROOT)
    parts = [
        HEAD,
        _sum_up(table, results),
        "\n| group | rows | passed | quick |\n|---|---|---|---|\n",
    ]
    for group in table.groups:
        proofs = [proof for proof in table.proofs if proof.id[0] == group.letter]
        passed = sum(_find_result(proof, results) == "pass" for proof in proofs)
        quick = sum(proof.is_quick for proof in proofs)
        parts.append(f"| {group.letter}: {group.title} | {len(proofs)} | {passed} | {quick} |\n")
    return "".join(parts) + _list_left(table, results)


def rows() -> str:
    """Write the CSV text: each part with its commands and their result."""
    table = load_table()
    results = original_results.read(ROOT)
    titles = {group.letter: group.title for group in table.groups}
    target = io.StringIO()
    writer = csv.writer(target, lineterminator="\n")
    writer.writerow(COLUMNS)
    for proof in table.proofs:
        result = results.get(proof.id, {})
        writer.writerow((
            proof.id, titles[proof.id[0]], proof.part, "; ".join(proof.commands), proof.shows,
            proof.left, "quick" if proof.is_quick else "", _find_result(proof, results),
            result.get("date", ""), result.get("commit", ""),
        ))  # fmt: skip
    return target.getvalue()


def _find_result(proof: PartProof, results: Results) -> str:
    return results.get(proof.id, {}).get("result", "not run")


def _sum_up(table: PartTable, results: Results) -> str:
    count = Counter(_find_result(proof, results) for proof in table.proofs)
    line = f"{len(table.proofs)} rows: {count['pass']} passed, {count['fail']} failed, "
    return line + f"{count['not run']} not run.\n"


def _list_left(table: PartTable, results: Results) -> str:
    """List the rows that did not pass, and those that are not whole yet."""
    lines = [
        f"- {proof.id}, {proof.part}: {_find_result(proof, results)}"
        + (f"; not yet: {proof.left}" if proof.left else "")
        + "\n"
        for proof in table.proofs
        if proof.left or _find_result(proof, results) != "pass"
    ]
    return "\n".join(["\n## What is left\n", "".join(lines)]) if lines else ""


if __name__ == "__main__":
    sys.stdout.write(page())
