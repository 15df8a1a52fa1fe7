"""`agribot record start|stop|mark` on a running robot."""

from __future__ import annotations

import json
import threading

import pytest

from agribot.cli import main
from agribot.ui import remote
from tests.ui.client import Browser
from tests.ui.conftest import Robot


def answering(robot: Robot, action: str, recording: str) -> threading.Thread:
    """The robot's end: tells of the recording once it was asked for."""

    def run() -> None:
        robot.wait_for(lambda order: order.get("action") == action, 60.0)
        state = {"k": "s", "n": 1, "t": 1.0, "mode": "mission", "recording": recording}
        robot.say(state)

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
    order = robot.wait_for(lambda order: order.get("action") == action)
    assert order["source"] == "agribot record"
    assert order["text"] == (words[1] if len(words) > 1 else "")


def test_without_a_robot_it_says_how_to_start_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["record", "start", "--port", "1"]) == 2
    assert "agribot run --ui" in capsys.readouterr().err


def test_programs_begin_and_end_recordings_over_http(robot: Robot) -> None:
    browser = Browser(robot.port)
    for what in ("start", "stop"):
        assert browser.ask("POST", f"/api/v1/recordings/{what}")[0] == 204
        robot.wait_for(lambda order: order.get("action") == f"{what}_recording")  # noqa: B023
    assert browser.ask("POST", "/api/v1/recordings/mark", {"text": "wet"})[0] == 204
    robot.wait_for(lambda order: order.get("action") == "mark" and order["text"] == "wet")
