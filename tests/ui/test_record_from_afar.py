"""`agribot record start|stop|mark` on a running robot."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import msgspec
import pytest

from agribot.cli.main import main
from agribot.core.errors import PlatformError
from agribot.ui import wire
from agribot.ui.address import read_door
from agribot.ui.hand import remote
from agribot.ui.hand.remote import Remote
from tests.ui.client import Browser
from tests.ui.conftest import Robot
from tests.ui.messages import make_state


def answering(robot: Robot, action: str, recording: str) -> threading.Thread:
    """The robot's end: reports the recording once it was requested."""

    def run() -> None:
        robot.wait_for_request(action)
        robot.say(msgspec.structs.replace(make_state(1), recording=recording))

    thread = threading.Thread(target=run)
    thread.start()
    return thread


@pytest.mark.parametrize(
    ("words", "action", "recording"),
    [
        (["start"], "start_recording", "run-2"),
        (["stop"], "stop_recording", ""),
        (["mark", "a stone"], "mark", "run"),
    ],
)
def test_a_recording_is_begun_ended_and_marked_from_a_terminal(
    robot: Robot,
    words: list[str],
    action: str,
    recording: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(remote, "ANSWER_S", 60.0)
    thread = answering(robot, action, recording)
    assert main(["record", *words, "--port", str(robot.port), "--json"]) == 0
    thread.join()
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told == {"ok": True, "recording": recording or None}
    order = robot.wait_for_request(action)
    assert order.who == wire.Who("agribot record")
    if isinstance(order.request, wire.MarkMoment):
        assert order.request.text == (words[1] if len(words) > 1 else "")


def test_without_a_robot_it_says_how_to_start_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["record", "start", "--port", "1"]) == 2
    assert "agribot run --ui" in capsys.readouterr().err


@pytest.mark.parametrize(
    "url", ["http://robot:8080", "robot:8080", "ws://robot:port/ws/v1", "ws://", "ws://[::1"]
)
def test_an_address_that_is_none_is_refused_before_anybody_is_called(
    url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["record", "start", "--url", url, "--token", "x"]) == 2
    assert (
        f"--url {url}: not a robot's address; give ws://HOST:PORT/ws/v1" in capsys.readouterr().err
    )


def test_a_certificate_that_is_none_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["record", "start", "--url", "wss://127.0.0.1:1/ws/v1", "--token", "x", "--cert"]
    file = tmp_path / "robot.crt"
    assert main([*words, str(file)]) == 2
    assert f"{file}: no such file" in capsys.readouterr().err
    file.write_text("not a certificate")
    assert main([*words, str(file)]) == 2
    assert f"{file} is no certificate" in capsys.readouterr().err


def test_a_line_that_is_cut_is_said_so_at_once(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    robot.start()
    try:
        with Remote(read_door(robot.port), "a program") as program:
            program.take_seat(force=True)
            robot.server.process.kill()
            robot.server.process.join()
            with pytest.raises(PlatformError, match="the line to the robot is cut"):
                program.until(lambda _: False)
            with pytest.raises(PlatformError, match="the line to the robot is cut"):
                program.drive(0.1, 0.0)
    finally:
        robot.server.close()


def test_programs_begin_and_end_recordings_over_http(robot: Robot) -> None:
    browser = Browser(robot.port)
    for what in ("start", "stop"):
        assert browser.ask("POST", f"/api/v1/recordings/{what}")[0] == 204
        robot.wait_for_request(f"{what}_recording")
    assert browser.ask("POST", "/api/v1/recordings/mark", {"text": "wet"})[0] == 204
    robot.wait_for_request("mark", lambda order: order.text == "wet")
