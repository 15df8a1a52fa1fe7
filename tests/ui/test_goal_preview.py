"""The way to a place, before anybody sends the robot there."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from agribot.app.simulated_run import simulate
from agribot.app.tasks import choose_task
from agribot.autonomy.plan.task import Task
from agribot.core import config
from agribot.core.messages import OperatorEvent
from agribot.description.loader import load_robot
from agribot.ui.address import Address
from agribot.ui.goal_preview import preview_goal
from agribot.ui.operator_page import OperatorPage
from tests.autonomy.plan.planting import at
from tests.ui.client import Browser
from tests.ui.conftest import Robot

SPEED_MPS = 0.8


@pytest.fixture(scope="module")
def task() -> Task:
    return choose_task(config.load("farm"), load_robot("agribot"), (), None)


def beside(task: Task, off_m: float) -> tuple[float, float]:
    """A place before the beginning of the first row."""
    (x0, y0), (x1, y1) = task.rows[0].start_map_m, task.rows[0].end_map_m
    length_m = math.hypot(x1 - x0, y1 - y0)
    return x0 - off_m * (x1 - x0) / length_m, y0 - off_m * (y1 - y0) / length_m


def test_a_place_that_can_be_reached_has_a_way_its_length_and_its_time(task: Task) -> None:
    here, goal = beside(task, 3.0), beside(task, 1.5)
    shown = preview_goal(task, at(*here, 0.0), SPEED_MPS, goal)
    assert shown["xy"][0] == pytest.approx(here, abs=0.05)
    assert shown["xy"][-1] == pytest.approx(goal, abs=0.05)
    assert shown["length_m"] >= 1.5 - 0.05
    assert shown["time_s"] == pytest.approx(shown["length_m"] / SPEED_MPS, abs=0.1)


def test_a_place_that_cannot_be_reached_says_why(task: Task) -> None:
    here = at(*beside(task, 3.0), 0.0)
    refusal = preview_goal(task, here, SPEED_MPS, (500.0, 500.0))["refusal"]
    assert "500" in refusal or "fence" in refusal
    lost = at(0.0, 0.0, 0.0, ok=False)
    assert "where it is" in preview_goal(task, lost, SPEED_MPS, (0.0, 0.0))["refusal"]


def test_the_time_is_that_of_the_speed_that_the_mission_drives_at_now(tmp_path: Path) -> None:
    settings = config.load("farm", ["perception.enabled=false", "record.enabled=false", "seed=1"])
    with (
        simulate(settings, tmp_path / "run") as session,
        OperatorPage(session, Address(port=0)) as page,
    ):
        ticks = session.ticks()
        while session.stack.mission.path is None:
            here = next(ticks).estimate
        browser = Browser(page.server.port)
        ahead = {"x": here.x_map_m + math.cos(here.yaw_map_rad), "yaw": None}
        place = {**ahead, "y": here.y_map_m + math.sin(here.yaw_map_rad)}
        for speed_mps in (settings.mission.speed_mps, 0.2):
            change = OperatorEvent(
                t_s=0.0, action="set", source="test", text="mission.speed_mps", value=speed_mps
            )
            session.inbox.post(change)
            next(ticks)
            status, shown = browser.ask("POST", "/api/v1/goal/preview", place)
            assert status == 200, shown
            assert shown["time_s"] == pytest.approx(shown["length_m"] / speed_mps, abs=0.1)


def test_the_page_asks_the_robot_and_nothing_moves(robot: Robot) -> None:
    browser = Browser(robot.port)
    answer: dict[str, Any] = {"xy": [[0.0, 0.0], [1.0, 0.0]], "length_m": 1.0, "time_s": 1.2}
    robot.answers["preview_goal"] = answer
    place = {"x": 1.0, "y": 0.0, "yaw": None}
    assert browser.ask("POST", "/api/v1/goal/preview", place) == (200, answer)
    robot.answers["preview_goal"] = {"refusal": "there is crop"}
    assert browser.ask("POST", "/api/v1/goal/preview", place)[0] == 409
    for wrong in ("north", 10**400):
        assert browser.ask("POST", "/api/v1/goal/preview", {"x": 1.0, "y": wrong})[0] == 400
    assert [order["values"] for order in robot.of_kind("ask")] == [[1.0, 0.0]] * 2
    assert not robot.of_kind("drive") and not robot.of_kind("event")
