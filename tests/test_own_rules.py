"""The suite's own rules: what waits for the night, what a band is, whom CPU time is charged to."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from tests import nightly_results
from tests.nightly import mean_square_band
from tests.processes import find_descendants
from tests.time_limit import limited
from tests.waiting import wait_for

ROOT = Path(__file__).parents[1]
IN_PART = "tests/autonomy/estimate/test_start_mark.py"
SPENT_S = 0.3
SPENDER = f"""
import subprocess, sys
SPEND = "import time\\nwhile time.process_time() < {SPENT_S}: pass"
def test_that_lets_a_child_work():
    subprocess.run([sys.executable, "-c", SPEND], check=True)
def test_that_does_nothing():
    pass
"""


def run_pytest(*words: str) -> str:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_by_day_a_test_takes_few_seeds_and_by_night_the_same_test_takes_all() -> None:
    by_day = run_pytest("--collect-only", IN_PART)
    assert "[3 seeds]" in by_day and "[20 seeds]" not in by_day
    by_night = run_pytest("--collect-only", "-m", "nightly", IN_PART)
    assert "[20 seeds]" in by_night and "[3 seeds]" not in by_night


def test_each_test_that_is_left_to_the_night_names_tests_that_prove_it_by_day() -> None:
    listed = runpy.run_path(str(ROOT / "scripts" / "nightly_tests.py"))
    nightly = {
        str(path.relative_to(ROOT)): listed["list_by_day"](tree)
        for path, tree in listed["read_files"]().items()
    }
    named = {
        (file, test, day if "::" in day else f"{file}::{day}")
        for file, tests in nightly.items()
        for test, days in tests.items()
        for day in days or [""]
    }

    def runs_by_day(test: str) -> bool:
        file, name = test.split("::")
        left = nightly.get(file, {})
        is_there = f"\ndef {name}(" in (ROOT / file).read_text("utf-8")
        return is_there and name not in left and "*" not in left

    assert [entry for entry in sorted(named) if not runs_by_day(entry[2])] == []


def test_shards_that_run_alone_keep_each_others_results_and_name_what_did_not_run_lately(
    tmp_path: Path,
) -> None:
    text = "import pytest\n@pytest.mark.nightly\ndef test_it(): pass\n"
    for name in ("test_old.py", "test_new.py"):
        (tmp_path / name).write_text(text)
    results = tmp_path / "results.csv"
    old, gone = (f"test_{name}.py,3,0,0,12,2020-01-01,abc,a machine" for name in ("old", "gone"))
    results.write_text(f"{','.join(nightly_results.COLUMNS)}\n{old}\n{gone}\n")
    said = run_pytest(
        "-p", "tests.nightly_results", "-m", "nightly", "-W", "ignore", "--rootdir", str(tmp_path),
        "--nightly-results", str(results), str(tmp_path / "test_new.py"),
    )  # fmt: skip
    rows = nightly_results.read_rows(results)
    assert {name: row["passed"] for name, row in rows.items()} == {
        "test_new.py": "1", "test_old.py": "3",
    }  # fmt: skip
    assert "nightly: test_old.py last ran on 2020-01-01" in said


@pytest.mark.parametrize(("count", "freedom"), [(1, 3), (12, 2), (50, 1)])
def test_ideal_errors_are_within_the_band_of_their_count_as_often_as_it_says(
    count: int, freedom: int
) -> None:
    errors = np.random.default_rng(1).standard_normal((20_000, count, freedom))
    means = (errors**2).sum(axis=2).mean(axis=1)
    low, high = mean_square_band(count, freedom)
    assert np.mean((low < means) & (means < high)) == pytest.approx(0.95, abs=0.005)


def test_a_test_that_waits_without_end_fails_at_its_limit() -> None:
    with pytest.raises(pytest.fail.Exception, match=r"not over after 0\.05 s"), limited(0.05):
        threading.Event().wait()


def test_the_work_of_a_process_is_charged_to_the_test_that_started_it(tmp_path: Path) -> None:
    file = tmp_path / "test_spending.py"
    file.write_text(SPENDER)
    said = run_pytest("-p", "tests.cpu_times", "--cpu-times", "0", str(file))
    spent_s = {name: float(s) for s, name in re.findall(r"([\d.]+) s call .*::(\w+)", said)}
    # The kernel charges in ticks and may miss some of a busy machine's.
    assert spent_s["test_that_lets_a_child_work"] > SPENT_S / 2
    assert spent_s["test_that_does_nothing"] < SPENT_S / 2


def test_a_process_of_a_thread_is_found_below_this_one_with_what_it_started() -> None:
    before = set(find_descendants(os.getpid()))
    with ThreadPoolExecutor(1) as threads:
        words = ["sh", "-c", "cat; true"]
        shell = threads.submit(subprocess.Popen, words, stdin=subprocess.PIPE).result()
        wait_for(lambda: len(set(find_descendants(os.getpid())) - before) == 2, "both processes")
        (cat,) = find_descendants(shell.pid)
        assert find_descendants(os.getpid())[cat][1] == str(shell.pid)
        shell.communicate()
    assert set(find_descendants(os.getpid())) == before
