"""Ports, processes and patience for tests that talk to other programs."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

PATIENCE_S = 20.0
ROOT = Path(__file__).parents[2]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def until(condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
    """Wait for something another process does; only its absence fails, never its slowness."""
    end_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end_s, f"waited {patience_s:g} s in vain for {what}"
        time.sleep(0.02)


class Talk:
    """A line in, a line out."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def __call__(self, *command: Any) -> Any:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(command) + "\n")
        self.process.stdin.flush()
        return self.read()

    def read(self) -> Any:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, f"the peer ended with status {self.process.wait(5)}"
        return json.loads(line)


@contextmanager
def zenoh_peer(locator: str, *latched_keys: str) -> Iterator[Talk]:
    script = str(ROOT / "tests" / "bridge" / "zenoh_peer.py")
    with subprocess.Popen(
        [sys.executable, script, locator, *latched_keys],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        talk = Talk(process)
        try:
            assert talk.read() == "ready"
            yield talk
        finally:
            process.kill()
