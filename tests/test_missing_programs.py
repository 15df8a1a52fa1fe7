"""A bare machine: what it lacks is skipped in words, counted, and fails where nothing may lack."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests import machine

ROOT = Path(__file__).parents[1]
PAGE_TESTS = "tests/ui/page"


def run_tests(folder: Path, tests: str, *, require_all: bool) -> tuple[int, str]:
    """Run tests of the page on a machine without any of the programs that tests ask for."""
    machine.link_what_every_machine_has(folder)
    environment = {**os.environ, "PATH": str(folder)}
    environment.pop("AGRIBOT_REQUIRE_ALL", None)
    if require_all:
        environment["AGRIBOT_REQUIRE_ALL"] = "1"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", tests],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout


def test_without_a_browser_its_tests_are_skipped_with_the_line_that_installs_it(
    tmp_path: Path,
) -> None:
    status, said = run_tests(tmp_path, PAGE_TESTS, require_all=False)
    assert status == 0, said
    why = r"chromium is missing \(apt-get install chromium\)$"
    (counted,) = re.findall(rf"^(\d+) tests? skipped: {why}", said, re.M)
    listed = re.findall(rf"^SKIPPED \[(\d+)\] .*: {why}", said, re.M)
    assert int(counted) == sum(map(int, listed)) > 100
    assert "error" not in said.splitlines()[-1]


def test_where_everything_is_required_a_missing_browser_fails(tmp_path: Path) -> None:
    status, said = run_tests(tmp_path, f"{PAGE_TESTS}/test_mapviz.py", require_all=True)
    assert status == 1
    assert "chromium is missing (apt-get install chromium)" in said


@pytest.mark.parametrize("program", machine.PACKAGES)
def test_every_program_comes_with_packages_that_ci_installs(program: str) -> None:
    listed = (ROOT / "apt-packages.txt").read_text("utf-8").split()
    assert set(machine.PACKAGES[program].split()) <= set(listed)
