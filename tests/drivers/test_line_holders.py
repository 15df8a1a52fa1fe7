"""A device that another program has is named with that program, and not opened."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from agribot.drivers.line.line_holders import find_holders
from tests.drivers.device_tree import put

HOLD = "import sys; f = open(sys.argv[1], 'rb', 0); print('has it', flush=True); sys.stdin.read()"


@contextmanager
def held(path: Path) -> Iterator[int]:
    """Let another program hold a device; gives its number."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == b"has it\n"
        yield program.pid
        program.kill()


def test_the_program_that_has_a_line_open_is_named_until_it_ends(tmp_path: Path) -> None:
    device = put(tmp_path, "dev/pts/3")
    (tmp_path / "dev/ttyUSB0").symlink_to(device)
    assert find_holders("/dev/ttyUSB0", tmp_path) == set()
    with held(device) as process:
        (holder,) = find_holders("/dev/ttyUSB0", tmp_path)
        assert holder.process == process and str(process) in str(holder)
        assert holder.program.startswith("python")
    assert find_holders("/dev/ttyUSB0", tmp_path) == set()


def test_what_this_program_has_open_is_held_by_no_other(tmp_path: Path) -> None:
    with put(tmp_path, "dev/ttyUSB0").open("rb"):
        assert find_holders("/dev/ttyUSB0", tmp_path) == set()


def test_a_lock_file_counts_as_long_as_its_program_lives(tmp_path: Path) -> None:
    put(tmp_path, "dev/ttyUSB0")
    processes = tmp_path / "proc"
    put(tmp_path, "proc/4242/comm", "minicom\n")
    lock = put(tmp_path, "run/lock/LCK..ttyUSB0", "      4242 minicom root\n")
    (holder,) = find_holders("/dev/ttyUSB0", tmp_path, processes)
    assert str(holder) == "minicom (process 4242)"
    lock.write_text("4243\n")
    assert find_holders("/dev/ttyUSB0", tmp_path, processes) == set()
    lock.write_text("no number")
    assert find_holders("/dev/ttyUSB0", tmp_path, processes) == set()
    assert os.path.exists(lock)
