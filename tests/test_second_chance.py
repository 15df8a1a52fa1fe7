"""What a second chance does with a broken test, a flaky one, one known as flaky, and too many."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from tests import nightly
from tests.second_chance import KNOWN, MOST_FLAKY, read_known

ROOT = Path(__file__).parents[1]
EVERY_SECOND_TIME = """
import pathlib, pytest
@pytest.mark.parametrize("number", range({count}))
def test_that_fails_every_second_time(number):
    seen = pathlib.Path(__file__).with_name(f"seen{{number}}")
    if seen.exists():
        seen.unlink()
    else:
        seen.touch()
        assert False, "the first failure"
"""
BROKEN = "def test_that_is_broken(): assert False, 'broken for good'\n"
SOUND = "def test_that_passes(): pass\n"


def run_tests(folder: Path, *words: str) -> tuple[int, str]:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    # Its own root: in a repository below the folder of temporary files it would be that folder.
    command += ["-p", "tests.second_chance", "--second-chance", "--rootdir", str(folder)]
    command += [*words, str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout


@nightly.one_by_one("workers", ["2", "0"], in_suite=1)
def test_a_test_that_passes_when_repeated_alone_is_reported_and_does_not_fail_the_run(
    workers: str, tmp_path: Path
) -> None:
    (tmp_path / "test_it.py").write_text(EVERY_SECOND_TIME.format(count=1) + SOUND)
    status, said = run_tests(tmp_path, "-n", workers)
    assert status == 0, said
    assert "\nflaky: 1\n" in said
    assert "the first failure" in said
    assert re.search(r"^1 passed, 1 flaky in", said, re.M), said
    (printed,) = re.findall(r"^\[\[flaky\]\]\n(?:.+ = .+\n)+", said, re.M)
    known = tmp_path / "flaky.toml"
    known.write_text(printed)
    assert "test_it.py::test_that_fails_every_second_time[0]" in read_known(known)


def test_a_test_that_fails_twice_fails_the_run_beside_one_that_is_flaky(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(EVERY_SECOND_TIME.format(count=1) + BROKEN)
    status, said = run_tests(tmp_path)
    assert status == 1
    assert re.search(r"^1 failed, 1 flaky in", said, re.M), said
    assert "broken for good" in said


def test_more_flaky_tests_than_the_limit_fail_the_run(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(EVERY_SECOND_TIME.format(count=MOST_FLAKY + 1))
    status, said = run_tests(tmp_path)
    assert status == 1
    assert f"{MOST_FLAKY + 1} flaky tests; the limit is {MOST_FLAKY}" in said


def test_a_flaky_test_that_is_known_fails_the_run(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(EVERY_SECOND_TIME.format(count=1) + SOUND)
    known = tmp_path / "flaky.toml"
    known.write_text(
        '[[flaky]]\ntest = "test_it.py::test_that_fails_every_second_time[0]"\n'
        'date = 2026-11-28\ncause = "not known yet"\n'
    )
    status, said = run_tests(tmp_path, "--flaky-file", str(known))
    assert status == 1
    assert re.search(r"was flaky before \(\d{4}-\d\d-\d\d: not known yet\); fix it", said), said


def test_the_list_of_known_flaky_tests_names_tests_that_exist() -> None:
    for test in read_known(KNOWN):
        path, name = test.split("::", 1)
        assert name.split("[")[0].split("::")[-1] in (ROOT / path).read_text("utf-8")
