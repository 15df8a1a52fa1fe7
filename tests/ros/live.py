"""Ports, processes and patience for tests that talk to other programs."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from tests.waiting import PATIENCE_S, wait_for

T = TypeVar("T")
ROOT = Path(__file__).parents[2]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def first(take: Callable[[], Sequence[T]], what: str, patience_s: float = PATIENCE_S) -> T:
    """The first thing that `take` gives, however often it has to be asked."""
    return wait_for(take, what, patience_s)[0]


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
        limit = threading.Timer(PATIENCE_S, self.process.kill)
        limit.start()
        line = self.process.stdout.readline()
        limit.cancel()
        status = "" if line else self.process.wait(5)
        assert line, f"the peer ended with status {status}, or said nothing for {PATIENCE_S:g} s"
        return json.loads(line)


@contextmanager
def zenoh_peer(locator: str, *latched_keys: str) -> Iterator[Talk]:
    with peer("zenoh_peer.py", locator, *latched_keys) as talk:
        yield talk


@contextmanager
def peer(script: str, *arguments: str) -> Iterator[Talk]:
    """A script of this folder in a process of its own, from its "ready" on."""
    with program(sys.executable, str(ROOT / "tests" / "ros" / script), *arguments) as talk:
        yield talk


@contextmanager
def program(*command: str) -> Iterator[Talk]:
    """A process that says "ready" and then answers line by line."""
    with subprocess.Popen(
        command,
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
