"""A robot with its page, as a user starts it: a process of its own."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import msgspec

from tests.waiting import PATIENCE_S


class Robot(msgspec.Struct, kw_only=True):
    process: subprocess.Popen[str]
    address: str
    out_dir: Path

    def end(self) -> int:
        """Interrupt it as Ctrl-C does; its exit status."""
        self.process.send_signal(signal.SIGINT)
        self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode


def robot_with_page(
    what: str, out_dir: Path, words: Sequence[str] = (), pace: float = 1.0
) -> AbstractContextManager[Robot]:
    """`what` is a profile, or a recording to be shown; `pace` is simulated over real time."""
    command = ["ui", what] if pace == 1.0 else ["run", what, "--ui", "--stay", f"--speed={pace}"]
    return _serving([*command, "--out", str(out_dir), *words], out_dir)


def resumed_with_page(
    folder: Path, out_dir: Path, words: Sequence[str] = ()
) -> AbstractContextManager[Robot]:
    """A run that goes on where that of `folder` was cut off."""
    command = ["run", "--resume", str(folder), "--ui", "--out", str(out_dir)]
    return _serving([*command, *words], out_dir)


def described(file: Path) -> AbstractContextManager[Robot]:
    """A description alone: `end` ends its page."""
    return _serving(["describe", "--robot", str(file), "--ui"], file.parent)


@contextmanager
def _serving(words: Sequence[str], out_dir: Path) -> Iterator[Robot]:
    process = subprocess.Popen(
        [sys.executable, "-m", "agribot.cli", *words, "--port", "0"],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield Robot(process=process, address=_address(process), out_dir=out_dir)
    finally:
        process.kill()
        process.communicate()


def _address(process: subprocess.Popen[str]) -> str:
    assert process.stderr is not None
    said = []
    for line in process.stderr:
        said.append(line)
        found = re.match(r"page: (http://127\.0\.0\.1:\d+)/", line)
        if found:
            return found[1]
    raise AssertionError(f"no page: {''.join(said)}")
