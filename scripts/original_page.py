"""Print docs/original.md: each part of the original, the command that proves it, and its result.

The rows are those of `agribot.lab.original`, the results those of tests/original-results.csv.
`make pages` writes all such pages.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from agribot.lab.original import PartProof, PartTable, load_table  # noqa: E402
from tests import original_results  # noqa: E402

HEAD = """# Every part of the original

Written by `make pages`. Each row is a part of the original AGRIBOT, or a promise of its pages; its
commands show that it works here. `agribot doctor --original` runs those marked *quick* on any
machine; `python scripts/prove_original.py`, in the repository, runs all of them and keeps the
results below. [Coming from the original](coming-from-the-original.md) says what each package, node
and launch file is called here.

"""
Results = dict[str, dict[str, str]]


def page() -> str:
    """Write the page from the table and the results."""
    table = load_table()
    results = original_results.read(ROOT)
    parts = [HEAD, _sum_up(table, results)]
    for group in table.groups:
        parts.append(f"\n## {group.letter}: {group.title}\n\n")
        parts.append("| row | part of the original | commands | what they show | result |\n")
        parts.append("|---|---|---|---|---|\n")
        parts += [_row(proof, results) for proof in table.proofs if proof.id[0] == group.letter]
    return "".join(parts)


def _sum_up(table: PartTable, results: Results) -> str:
    count = Counter(results.get(p.id, {}).get("result", "not run") for p in table.proofs)
    partly = sum(bool(proof.left) for proof in table.proofs)
    line = f"{len(table.proofs)} rows: {count['pass']} passed, {count['fail']} failed, "
    line += f"{count['not run']} not run"
    return line + (f"; {partly} of them are not whole yet.\n" if partly else ".\n")


def _row(proof: PartProof, results: Results) -> str:
    commands = "<br>".join(f"`{command}`" for command in proof.commands).replace("|", "\\|")
    quick = " *quick*" if proof.is_quick else ""
    shows = proof.shows + (f"; **not yet**: {proof.left}" if proof.left else "")
    result = results.get(proof.id)
    said = f"{result['result']}, {result['date']}, {result['commit']}" if result else "not run"
    # Anchors let other pages link to one row.
    name = f'<a id="{proof.id.lower()}"></a>{proof.id}{quick}'
    return f"| {name} | {proof.part} | {commands} | {shows} | {said} |\n"


if __name__ == "__main__":
    sys.stdout.write(page())
