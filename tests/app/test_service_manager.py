"""systemd gets a message when the robot drives and while its loop runs, none while it hangs."""

from __future__ import annotations

import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest

from agribot.app.service_manager import QUIET_LIMIT_S, ServiceManager
from agribot.cli.main import main


class Manager:
    """A socket that hears what a service says, as systemd's does."""

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(address.replace("@", "\0"))
        self.environment = {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "2000000"}

    def take(self) -> list[str]:
        said = []
        try:
            while True:
                said += self._socket.recv(4096).decode().split("\n")
        except BlockingIOError:
            return said

    def close(self) -> None:
        self._socket.close()


@pytest.fixture(params=["file", "abstract"])
def manager(request: pytest.FixtureRequest) -> Iterator[Manager]:
    with tempfile.TemporaryDirectory() as folder:
        name = Path(folder, "notify")
        made = Manager(str(name) if request.param == "file" else f"@agribot-{os.getpid()}")
        yield made
        made.close()


@pytest.fixture
def services() -> Iterator[ExitStack]:
    """Ends all services of a test, after it."""
    with ExitStack() as opened:
        yield opened


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


class Status(NamedTuple):
    state: str = "driving"
    leg: str = "row 2"
    stopped: str = ""
    held: str = ""


class Record(NamedTuple):
    status: Status = Status()


def tick(service: ServiceManager, record: Record | None = None) -> None:
    service(record or Record())  # type: ignore[arg-type]  # of a tick it reads the status alone


def test_the_first_tick_says_ready_and_each_half_second_is_a_sign_of_life(
    manager: Manager, services: ExitStack
) -> None:
    clock = Clock()
    service = services.enter_context(ServiceManager(manager.environment, clock))
    assert manager.take() == []
    tick(service)
    assert manager.take() == ["READY=1", "WATCHDOG=1", "STATUS=driving, row 2"]
    for _ in range(100):
        clock.now_s += 0.02
        tick(service)
    said = manager.take()
    assert said == ["WATCHDOG=1"] * len(said)
    assert 3 <= len(said) <= 4


def test_a_loop_that_stands_says_nothing(manager: Manager, services: ExitStack) -> None:
    clock = Clock()
    service = services.enter_context(ServiceManager(manager.environment, clock))
    tick(service)
    manager.take()
    clock.now_s += 3600.0
    assert manager.take() == []


def test_the_status_tells_why_the_robot_stands_on_one_line(
    manager: Manager, services: ExitStack
) -> None:
    clock = Clock()
    service = services.enter_context(ServiceManager(manager.environment, clock))
    tick(service)
    manager.take()
    clock.now_s += 1.5
    tick(service, Record(Status(state="paused", leg="", stopped="bumper\npressed")))
    assert "STATUS=paused: bumper pressed" in manager.take()


def test_files_at_the_end_may_take_longer_than_a_tick(
    manager: Manager, services: ExitStack
) -> None:
    service = services.enter_context(ServiceManager(manager.environment, Clock()))
    with service.allow_quiet():
        assert f"WATCHDOG_USEC={QUIET_LIMIT_S * 1e6:.0f}" in manager.take()
    assert "WATCHDOG_USEC=2000000" in manager.take()
    services.close()
    assert manager.take()[0] == "STOPPING=1"


def test_without_a_manager_or_with_one_that_has_gone_the_robot_drives_on(
    manager: Manager, services: ExitStack
) -> None:
    for environment in ({}, {"NOTIFY_SOCKET": "vsock:2:1"}, {"NOTIFY_SOCKET": "/no/such/socket"}):
        with ServiceManager(environment) as service, service.allow_quiet():
            tick(service)
    service = services.enter_context(ServiceManager(manager.environment))
    manager.close()
    tick(service)


def test_the_watchdog_of_another_process_is_not_answered(
    manager: Manager, services: ExitStack
) -> None:
    environment = {**manager.environment, "WATCHDOG_PID": str(os.getpid() + 1)}
    service = services.enter_context(ServiceManager(environment, Clock()))
    tick(service)
    assert "WATCHDOG=1" not in manager.take()


def test_a_manager_that_reads_nothing_does_not_hold_up_the_loop(
    manager: Manager, services: ExitStack
) -> None:
    clock = Clock()
    service = services.enter_context(ServiceManager(manager.environment, clock))
    for _ in range(2000):  # more than a socket's buffer takes
        clock.now_s += 1.0
        tick(service)
    assert manager.take()[0] == "READY=1"


def test_a_run_is_ready_once_its_loop_turns_and_says_when_it_ends(
    manager: Manager, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in manager.environment.items():
        monkeypatch.setenv(name, value)
    options = ["--set", "perception.enabled=false", "--for", "0.4", "--out", str(tmp_path / "run")]
    main(["run", "farm", *options])
    said = manager.take()
    assert said[0] == "READY=1"
    assert said.index("STOPPING=1") > said.index(f"WATCHDOG_USEC={QUIET_LIMIT_S * 1e6:.0f}")
