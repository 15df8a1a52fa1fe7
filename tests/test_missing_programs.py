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
PAGE_TEST = "tests/ui/page/test_mapviz.py"


def run_tests(folder: Path, *, require_all: bool) -> tuple[int, str]:
    """Tests of the page, on a machine whose PATH holds no program at all."""
    environment = {**os.environ, "PATH": str(folder)}
    environment.pop("AGRIBOT_REQUIRE_ALL", None)
    if require_all:
        environment["AGRIBOT_REQUIRE_ALL"] = "1"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", PAGE_TEST],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout


def test_without_a_browser_its_tests_are_skipped_with_the_line_that_installs_it(
    tmp_path: Path,
) -> None:
    status, said = run_tests(tmp_path, require_all=False)
    assert status == 0, said
    assert re.search(
        r"^\d+ tests? skipped: chromium is missing \(apt-get install chromium\)$", said, re.M
    )
    assert "error" not in said.splitlines()[-1]


def test_where_everything_is_required_a_missing_browser_fails(tmp_path: Path) -> None:
    status, said = run_tests(tmp_path, require_all=True)
    assert status == 1
    assert "chromium is missing (apt-get install chromium)" in said


@pytest.mark.parametrize("program", machine.PACKAGES)
def test_every_program_comes_with_packages_that_ci_installs(program: str) -> None:
    listed = (ROOT / "apt-packages.txt").read_text("utf-8").split()
    assert set(machine.PACKAGES[program].split()) <= set(listed)
