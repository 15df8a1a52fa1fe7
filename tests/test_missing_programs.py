"""A bare machine: what it lacks is skipped in words, counted, and fails where nothing may lack.

Only tests that ask for a program can end otherwise there: those are found, none is forgotten.
"""

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
FOLDER_OF_TESTS = {
    "conftest.py": """
import pytest
from tests import machine

@pytest.fixture
def program():
    return machine.find("openssl")
""",
    "test_of_its_own.py": """
from tests.machine import needs
def test_in_a_file_that_asks(): pass
""",
    "test_with_help.py": """
from tests.drivers import gpsd_daemon
def test_whose_helper_asks(): pass
""",
    "test_given.py": """
def test_whose_fixture_asks(program): pass
def test_without_it(): pass
""",
    "test_apart.py": """
def test_that_needs_nothing(): pass
""",
}
STARTED_UNASKED = """
import subprocess
def test_that_starts_it():
    try:
        subprocess.run(["openssl", "version"], check=True)
    except FileNotFoundError:
        pass
"""
ASKED_UNSEEN = """
def test_that_finds_its_fixture_while_it_runs(request):
    request.getfixturevalue("program")
"""


def run_tests(folder: Path, tests: str, *, require_all: bool) -> tuple[int, str]:
    """Run tests of the page on a machine without any of the programs that tests ask for."""
    machine.link_bare_programs(folder)
    environment = {**os.environ, "PATH": str(folder)}
    environment.pop("AGRIBOT_REQUIRE_ALL", None)
    if require_all:
        environment["AGRIBOT_REQUIRE_ALL"] = "1"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-rs", "--askers", tests],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout


@pytest.mark.parametrize(
    ("tests", "least"),
    [
        (f"{PAGE_TESTS}/test_places.py", 1),
        pytest.param(PAGE_TESTS, 100, marks=pytest.mark.nightly),
    ],
    ids=["a file", "all"],
)
def test_without_a_browser_its_tests_are_skipped_with_the_line_that_installs_it(
    tests: str, least: int, tmp_path: Path
) -> None:
    status, said = run_tests(tmp_path, tests, require_all=False)
    assert status == 0, said
    why = r"chromium-headless-shell is missing \(apt-get install chromium-headless-shell\)$"
    (counted,) = re.findall(rf"^(\d+) tests? skipped: {why}", said, re.M)
    listed = re.findall(rf"^SKIPPED \[(\d+)\] .*: {why}", said, re.M)
    assert int(counted) == sum(map(int, listed)) >= least
    assert "error" not in said.splitlines()[-1]


def test_where_everything_is_required_a_missing_browser_fails(tmp_path: Path) -> None:
    status, said = run_tests(tmp_path, f"{PAGE_TESTS}/test_places.py", require_all=True)
    assert status == 1
    assert "chromium-headless-shell is missing (apt-get install chromium-headless-shell)" in said


def run_folder(folder: Path, *words: str) -> str:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "tests.askers"]
    done = subprocess.run(
        [*command, *words, str(folder)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return done.stdout


def test_tests_that_ask_are_found_by_their_file_what_it_imports_and_their_fixtures(
    tmp_path: Path,
) -> None:
    for name, text in FOLDER_OF_TESTS.items():
        (tmp_path / name).write_text(text)
    said = run_folder(tmp_path, "--collect-only", "--askers")
    assert re.findall(r"::(\w+)", said) == [
        "test_whose_fixture_asks", "test_in_a_file_that_asks", "test_whose_helper_asks",
    ]  # fmt: skip
    assert "3/5 tests collected (2 deselected)" in said


@pytest.mark.parametrize("text", [STARTED_UNASKED, ASKED_UNSEEN], ids=["starts", "finds"])
def test_a_test_that_needs_a_program_and_is_not_found_to_ask_for_it_fails(
    text: str, tmp_path: Path
) -> None:
    (tmp_path / "conftest.py").write_text(FOLDER_OF_TESTS["conftest.py"])
    (tmp_path / "test_unasked.py").write_text(text)
    said = run_folder(tmp_path)
    assert "needs openssl and is not found to ask for it" in said
    assert said.splitlines()[-1].startswith("1 failed")


@pytest.mark.parametrize("program", machine.PACKAGES)
def test_every_program_comes_with_packages_that_ci_installs(program: str) -> None:
    listed = (ROOT / "apt-packages.txt").read_text("utf-8").split()
    assert set(machine.PACKAGES[program].split()) <= set(listed)
