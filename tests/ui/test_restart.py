"""The page's server dies under a robot that goes on, and comes back with all that it showed."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from websockets.exceptions import ConnectionClosed

from agribot.app.simulated_run import simulate
from agribot.core import config
from agribot.core.errors import RecordingError
from agribot.core.facts import RobotEnded
from agribot.ui import wire
from agribot.ui.address import Address, read_door
from agribot.ui.robot_side import server_process
from agribot.ui.robot_side.operator_page import OperatorPage
from agribot.ui.robot_side.server_process import how_it_ended
from agribot.ui.server import serve as server
from agribot.ui.server.commands import Commands
from agribot.ui.server.hub import Hub
from tests.ui.client import Browser, Never, Page
from tests.ui.conftest import Robot
from tests.waiting import PATIENCE_S, wait_for


def kill(robot: Robot, signal_number: int = signal.SIGKILL) -> None:
    """And wait until the next one is ready."""
    robot.orders.clear()
    pid = robot.server.process.pid
    assert pid is not None
    os.kill(pid, signal_number)
    robot.wait_for(wire.Ready)
    assert robot.server.process.pid != pid


@pytest.fixture
def own_robot(tmp_path: Path) -> Iterator[Robot]:
    robot = Robot(tmp_path, Address(host="0.0.0.0", port=0))
    robot.start()
    yield robot
    robot.server.close()


def test_a_killed_server_comes_back_at_its_port_with_its_tokens_and_sessions(
    own_robot: Robot, capfd: pytest.CaptureFixture[str]
) -> None:
    door = read_door(own_robot.port)
    token = own_robot.address.operator_token
    cookie = logged_in(own_robot.port, token)
    headers: dict[str, Any] = {"additional_headers": {"Cookie": cookie}}
    with Page(own_robot.port, **headers) as page:
        page.take_seat()
        kill(own_robot)
        with pytest.raises(ConnectionClosed):
            page.receive(Never)
    assert read_door(own_robot.port) == door
    with Page(own_robot.port, **headers) as page:
        assert page.receive(wire.Hello).role == "operator", "without a login"
        page.take_seat()
        assert page.ask(wire.PressStop()).ok
        own_robot.wait_for_request("stop")
    told = capfd.readouterr().err
    assert "its server was killed by SIGKILL; it is started again" in told
    own_robot.server.close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", own_robot.port), timeout=PATIENCE_S)


def shown(robot: Robot) -> tuple[int, int]:
    """The numbers of the run and of what a page is shown of it."""
    cookie = logged_in(robot.port, robot.address.operator_token)
    with Page(robot.port, additional_headers={"Cookie": cookie}) as page:
        return page.receive(wire.Hello).run, page.receive(wire.Snapshot).epoch


def test_pages_know_the_run_again_behind_another_server_and_another_run_from_it(
    own_robot: Robot, tmp_path: Path
) -> None:
    run, epoch = shown(own_robot)
    kill(own_robot)
    assert shown(own_robot) == (run, epoch)
    own_robot.server.close()
    address = Address(host="0.0.0.0", port=own_robot.port)
    keys = {name: getattr(own_robot.address, name) for name in ("operator_token", "session_key")}
    next_robot = Robot(tmp_path, msgspec.structs.replace(address, **keys))
    next_robot.start()
    try:
        next_run, next_epoch = shown(next_robot)
        assert next_run != run and next_epoch != epoch
    finally:
        next_robot.server.close()


def logged_in(port: int, token: str) -> str:
    """The cookie that the link with the token gives."""
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as line:
        head = f"GET /?token={token} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close"
        line.sendall(f"{head}\r\n\r\n".encode())
        answer = b""
        while chunk := line.recv(65536):
            answer += chunk
    fields = dict(row.split(": ", 1) for row in answer.decode().split("\r\n")[1:] if ": " in row)
    return fields["set-cookie"].split(";")[0]


def test_a_server_that_hangs_is_ended_and_started_again(
    own_robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    own_robot.wait_for(wire.Alive)
    monkeypatch.setattr(server_process, "HANG_S", 2.0)
    pid = own_robot.server.process.pid
    assert pid is not None
    own_robot.orders.clear()
    os.kill(pid, signal.SIGSTOP)
    wait_for(lambda: own_robot.server.process.pid != pid, "another process")
    monkeypatch.undo()
    own_robot.wait_for(wire.Ready)


BAD = b"no recording"


def serve_what_loads_slowly(*line: Any) -> None:
    """The server as a process of its own; it loads for as long as its recording is not there."""

    def load(path: Path, _name: str) -> SimpleNamespace:
        wait_for(path.exists, "the recording")
        if path.read_bytes() == BAD:
            raise RecordingError("holds no ticks")
        return SimpleNamespace(clients=())

    setattr(server, "Replay", SimpleNamespace(load=load))  # noqa: B010  (a class, for mypy)
    server.main(*line)


@pytest.fixture
def loading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Robot, Path]]:
    """A server that is loading, and the recording that it waits for."""
    robot, recording = Robot(tmp_path), tmp_path / "run.mcap"
    about = robot.server._about
    shown = {"recording": str(recording)}
    robot.server._about = lambda port: msgspec.structs.replace(about(port), **shown)
    with monkeypatch.context() as patch:
        patch.setattr(server, "main", serve_what_loads_slowly)
        robot.server.start()
    robot.server.listen(robot._hear, lambda: None, 0.2)
    wait_for(lambda: len(robot.of_kind(wire.Alive)) >= 3, "signs of life")
    assert not robot.of_kind(wire.Ready)
    yield robot, recording
    robot.server.close()


def test_a_server_that_loads_a_long_recording_says_meanwhile_that_it_does_not_hang(
    loading: tuple[Robot, Path],
) -> None:
    robot, recording = loading
    recording.touch()
    robot.wait_for(wire.Ready)


def test_a_server_that_cannot_load_its_recording_is_not_started_again(
    loading: tuple[Robot, Path],
) -> None:
    robot, recording = loading
    process = robot.server.process
    write_whole(recording, BAD)
    wait_for(robot.server.has_ended.is_set, "the end")
    assert robot.server.process is process


def write_whole(path: Path, data: bytes) -> None:
    """Write so that no reader finds it half written."""
    beside = path.with_suffix(".part")
    beside.write_bytes(data)
    beside.rename(path)


def test_nobody_else_gets_the_port_while_the_server_is_away(
    own_robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_process, "PAUSES_S", (PATIENCE_S,))
    pid = own_robot.server.process.pid
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    wait_for(lambda: not own_robot.server.process.is_alive(), "the end of the server")
    with socket.socket() as other, pytest.raises(OSError, match="in use"):
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("0.0.0.0", own_robot.port))
        other.listen()


def test_a_page_that_comes_back_sees_the_whole_run(tmp_path: Path) -> None:
    settings = config.load("farm", ["perception.enabled=false", "record.enabled=false", "seed=1"])
    with (
        simulate(settings, tmp_path / "run") as session,
        OperatorPage(session, Address(port=0)) as page,
    ):
        ticks = session.ticks()

        def drive(seconds: float) -> None:
            end_s = (session.last.batch.t_s if session.last else 0.0) + seconds
            while next(ticks).batch.t_s < end_s:
                pass

        browser = Browser(page.server.port)
        headers: dict[str, Any] = {"additional_headers": {"Cookie": browser.cookie}}
        drive(8.0)
        with Page(page.server.port, **headers) as operator:
            operator.take_seat()
            change = {"mission.speed_mps": 0.35}
            assert browser.ask("PATCH", "/api/v1/settings", change)[1]["applied"] == change
            drive(0.2)
        pid = page.server.process.pid
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        wait_for(lambda: page.server.process.pid != pid, "another process")
        with Page(page.server.port, **headers) as again:
            again.receive(wire.Hello)
            end_s = time.monotonic() + PATIENCE_S
            snapshot = again.receive(wire.Snapshot)
            trace, events = snapshot.trace.points_map_m, snapshot.events.events
            while len(trace) < 20 or "serves again" not in str(events):
                assert time.monotonic() < end_s, (len(trace), events)
                drive(0.1)
                message = next_change(again)
                if isinstance(message, wire.TracePiece):
                    trace = trace[: message.first] + message.points_map_m
                elif isinstance(message, wire.NewEvents):
                    events = [*events, *message.events]
            groups = browser.ask("GET", "/api/v1/settings")[1]["groups"]
        values = {key["key"]: key["value"] for group in groups for key in group["keys"]}
        assert values["mission.speed_mps"] == 0.35
        assert trace[0] == pytest.approx(page._view.trace_map_m[0])
        told = "; ".join(event.text for event in events)
        for words in ("operator lost", "was killed by SIGKILL; it is started again"):
            assert words in told


def next_change(page: Page) -> wire.ServerMessage:
    """The next message that is part of the run until now, or a state."""
    while True:
        message = page.receive_any()
        if isinstance(message, wire.TracePiece | wire.NewEvents | wire.State):
            return message


def test_the_end_of_a_process_is_told_in_words() -> None:
    assert how_it_ended(3) == "ended with status 3"
    assert how_it_ended(-signal.SIGSEGV) == "was killed by SIGSEGV"
    assert how_it_ended(-200) == "was killed by signal 200"


class _Looking:
    """A page that keeps what it receives."""

    session, name, who = "ann", "Ann", wire.Who("Ann")

    def __init__(self, hub: Hub) -> None:
        self.role: str | None = "operator"
        self.channel = hub.live
        self.sent: list[wire.ServerMessage] = []

    def send(self, message: wire.ServerMessage) -> None:
        self.sent.append(message)

    def acknowledge(self, count: int) -> None: ...


def test_a_stop_is_not_confirmed_by_the_server_of_a_program_that_has_ended(tmp_path: Path) -> None:
    robot, orders = Robot(tmp_path), list[wire.RobotOrder]()
    hub = Hub(robot._about(robot.port), orders.append)
    robot.server.close()
    page = _Looking(hub)
    for is_gone in (False, True):
        hub.is_robot_gone = is_gone
        hub.stops.clear()
        Commands(hub, page).obey(wire.PressStop(id="stop"))
    assert [isinstance(o, wire.RequestOrder) and o.request.word for o in orders] == ["stop"]
    heard, lost = (verdict for verdict in page.sent if isinstance(verdict, wire.Verdict))
    assert heard.ok
    assert not lost.ok
    assert lost.reason_fact == RobotEnded()
