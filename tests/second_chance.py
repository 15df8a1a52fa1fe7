"""A second chance, in the open: `pytest --second-chance` repeats what failed, once and alone.

Each test that failed runs again in a process of its own after all others have ended. One that
passes then is flaky: it is listed with its first failure and does not fail the run. A run fails
with more than three of them, and with one that `tests/flaky.toml` already lists: a flaky test is a
defect of the test or of the product, and its cause is fixed in the next change.
"""

from __future__ import annotations

import subprocess
import sys
import tomllib
from datetime import date
from pathlib import Path

import pytest
from _pytest.reports import BaseReport
from _pytest.terminal import TerminalReporter

KNOWN = Path(__file__).with_name("flaky.toml")
MOST_FLAKY = 3  # tests of one run
MOST_REPEATED = 20  # tests of one run; with more failures the run is broken anyway
LIMIT_S = 900.0  # wall time of one repetition
FAILURES = ("failed", "error")  # the reporter's words for a failed call, and a failed set-up


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--second-chance", action="store_true", help="repeat what failed once, alone")
    parser.addoption(
        "--flaky-file", type=Path, default=KNOWN, help="the flaky tests that are known"
    )


def pytest_configure(config: pytest.Config) -> None:
    is_worker = hasattr(config, "workerinput")
    if config.getoption("--second-chance") and not is_worker:
        config.pluginmanager.register(SecondChance(config))


class SecondChance:
    """Repeats the failed tests of a session and decides anew whether the session has failed."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._known = read_known(config.getoption("--flaky-file"))
        self._flaky: dict[str, list[BaseReport]] = {}

    @pytest.hookimpl(trylast=True)  # the workers of pytest-xdist have ended
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        reporter = self._config.pluginmanager.get_plugin("terminalreporter")
        if session.exitstatus != pytest.ExitCode.TESTS_FAILED or reporter is None:
            return
        failures = list_failures(reporter)
        reporter.write_line("")
        if len(failures) > MOST_REPEATED:
            reporter.write_line(
                f"second chance: {len(failures)} tests failed, more than {MOST_REPEATED}: "
                "none is repeated"
            )
            return
        for number, test in enumerate(failures, 1):
            reporter.write_line(f"second chance: {number} of {len(failures)}: {test}")
            if self._passes_alone(test):
                self._flaky[test] = failures[test]
        take_out(reporter, self._flaky)
        if set(failures) == set(self._flaky) and not self._objection():
            session.exitstatus = pytest.ExitCode.OK

    def pytest_terminal_summary(self, terminalreporter: TerminalReporter) -> None:
        if not self._flaky:
            return
        terminalreporter.section(f"flaky: {len(self._flaky)}")
        for test, reports in self._flaky.items():
            terminalreporter.write_sep("_", test)
            for report in reports:
                report.toterminal(terminalreporter._tw)
            terminalreporter.write_line(
                f'[[flaky]]\ntest = "{test}"\ndate = {date.today()}\ncause = "not known yet"'
            )
        terminalreporter.write_line(f"flaky: {len(self._flaky)}")
        if objection := self._objection():
            terminalreporter.write_line(objection)

    def _passes_alone(self, test: str) -> bool:
        root = self._config.rootpath  # node ids are relative to it
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(root / test)]
        if expression := self._config.getoption("markexpr"):
            command += ["-m", expression]
        try:
            done = subprocess.run(
                command, cwd=root, check=False, timeout=LIMIT_S,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return False
        return done.returncode == 0

    def _objection(self) -> str:
        """Why flaky tests fail the run; empty where they do not."""
        again = [test for test in self._flaky if test in self._known]
        if again:
            return f"second chance: {again[0]} was flaky before ({self._known[again[0]]}); fix it"
        if len(self._flaky) > MOST_FLAKY:
            return f"second chance: {len(self._flaky)} flaky tests; the limit is {MOST_FLAKY}"
        return ""


def read_known(path: Path) -> dict[str, str]:
    """Read the known flaky tests: node id -> date and cause."""
    entries = tomllib.loads(path.read_text("utf-8")).get("flaky", [])
    return {entry["test"]: f"{entry['date']}: {entry['cause']}" for entry in entries}


def list_failures(reporter: TerminalReporter) -> dict[str, list[BaseReport]]:
    found: dict[str, list[BaseReport]] = {}
    for kind in FAILURES:
        for report in reporter.stats.get(kind, ()):
            found.setdefault(report.nodeid, []).append(report)
    return found


def take_out(reporter: TerminalReporter, flaky: dict[str, list[BaseReport]]) -> None:
    """Count flaky tests by this name instead of among the failures."""
    for kind in FAILURES:
        kept = [report for report in reporter.stats.pop(kind, []) if report.nodeid not in flaky]
        if kept:
            reporter.stats[kind] = kept
    if flaky:
        reporter.stats["flaky"] = [reports[0] for reports in flaky.values()]
