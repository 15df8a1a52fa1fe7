"""Run the proofs of the original's parts and keep the results of docs/original.md.

    python scripts/prove_original.py              # all rows, about an hour
    python scripts/prove_original.py --rows A,F1  # ids that begin so
    python scripts/prove_original.py --due        # those that failed or never ran

Ends with 1 where a row failed. Results stand in tests/original-results.csv; `make pages` writes the
page from them.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from agribot.lab import original  # noqa: E402
from tests import original_results  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--rows", default="", metavar="A1,F", help="only ids that begin so")
    parser.add_argument(
        "--quick", action="store_true", help="only those of agribot doctor --original"
    )
    parser.add_argument("--due", action="store_true", help="only those that failed or never ran")
    options = parser.parse_args()
    table = original.load_table()
    results = original_results.read(ROOT)
    proofs = [
        proof
        for proof in original.choose(table.proofs, options.rows)
        if (proof.is_quick or not options.quick)
        and not (options.due and results.get(proof.id, {}).get("result") == "pass")
    ]
    failed = 0
    for outcome in original.prove(proofs, ROOT, table.files):
        sys.stdout.write(f"{outcome.id:4} {outcome.state:8} {outcome.reason}\n")
        sys.stdout.flush()
        failed += outcome.state == "fail"
        original_results.keep(ROOT, outcome)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
