"""The last result of every nightly file: `pytest -m nightly --nightly-results FILE.csv`.

A session writes a row for each file that it ran whole, so that shards that are run alone keep each
other's rows, and lists at its end what did not run for two weeks. `make nightly` keeps them in
`tests/nightly-results.csv`.
"""

from __future__ import annotations

import csv
import os
import platform
import subprocess
from collections import Counter, defaultdict
from datetime import date, timedelta
from pathlib import Path

import pytest
from _pytest.terminal import TerminalReporter

COLUMNS = ("file", "passed", "failed", "skipped", "busy_s", "date", "commit", "machine")
LATELY = timedelta(days=14)
Row = dict[str, str]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--nightly-results", type=Path, metavar="CSV", help="keep the results of nightly files here"
    )


def pytest_terminal_summary(terminalreporter: TerminalReporter, config: pytest.Config) -> None:
    path = config.getoption("--nightly-results")
    is_part = config.getoption("keyword") or any("::" in word for word in config.args)
    if path is None or is_part:
        return
    rows = read_rows(path) | count_by_file(terminalreporter, describe_run(config.rootpath))
    rows = {file: row for file, row in rows.items() if (config.rootpath / file).is_file()}
    write_rows(path, rows)
    limit = (date.today() - LATELY).isoformat()
    late = [file for file, row in sorted(rows.items()) if row["date"] < limit]
    for file in late:
        terminalreporter.write_line(f"nightly: {file} last ran on {rows[file]['date']}")


def count_by_file(reporter: TerminalReporter, run: Row) -> dict[str, Row]:
    """Count the outcomes of this session's tests by their file; `busy_s` sums their wall times."""
    outcomes: dict[str, Counter[str]] = {}
    busy_s: defaultdict[str, float] = defaultdict(float)
    for kind, reports in reporter.stats.items():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                file = report.nodeid.partition("::")[0]
                busy_s[file] += report.duration
                if kind:  # set-up and tear-down that went well have none
                    outcomes.setdefault(file, Counter())[kind] += 1
    return {
        file: run
        | {
            "file": file,
            "passed": str(count["passed"] + count["xfailed"] + count["flaky"]),
            "failed": str(count["failed"] + count["error"]),
            "skipped": str(count["skipped"]),
            "busy_s": f"{busy_s[file]:.0f}",
        }
        for file, count in outcomes.items()
    }


def describe_run(root: Path) -> Row:
    """Describe when, where and what runs; "+" after the commit for files that are changed."""
    changed = ask_git(root, "status", "--porcelain", "--", ".", ":!tests/nightly-results.csv")
    commit = ask_git(root, "rev-parse", "--short", "HEAD") or "unknown"
    return {
        "date": date.today().isoformat(),
        "commit": f"{commit}{'+' * bool(changed)}",
        "machine": f"{platform.machine()} with {os.cpu_count()} cores",
    }


def ask_git(root: Path, *words: str) -> str:
    """Return what git says; nothing where there is no repository."""
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)
    return done.stdout.strip()


def read_rows(path: Path) -> dict[str, Row]:
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {row["file"]: row for row in csv.DictReader(file)}


def write_rows(path: Path, rows: dict[str, Row]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows(rows[name] for name in sorted(rows))
