"""The way to a place, before anybody sends the robot there."""

from __future__ import annotations

import math
from pathlib import Path
from unittest.mock import ANY

import msgspec
import pytest

from agribot.app.simulated_run import simulate
from agribot.app.tasks import choose_task
from agribot.autonomy.plan.mission.task import Task
from agribot.core import config
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import BeyondFence, PositionLost, TooFarAway
from agribot.core.messages import ChangeSetting
from agribot.description.loader import load_robot
from agribot.ui import wire
from agribot.ui.address import Address
from agribot.ui.robot_side.goal_preview import preview_goal
from agribot.ui.robot_side.operator_page import OperatorPage
from tests.asking import go_to
from tests.autonomy.plan.planting import at
from tests.finding import is_like
from tests.ui.client import Browser
from tests.ui.conftest import Robot

CONFIG = MissionConfig(speed_mps=0.8)


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
    shown = preview_goal(task, at(*here, 0.0), CONFIG, go_to(goal))
    assert shown.points_map_m[0] == pytest.approx(here, abs=0.05)
    assert shown.points_map_m[-1] == pytest.approx(goal, abs=0.05)
    assert shown.length_m >= 1.5 - 0.05
    assert shown.time_s == pytest.approx(shown.length_m / CONFIG.speed_mps, abs=0.1)


def test_a_place_that_cannot_be_reached_says_why(task: Task) -> None:
    here = at(*beside(task, 3.0), 0.0)
    with pytest.raises(MissionError) as refused:
        preview_goal(task, here, CONFIG, go_to((500.0, 500.0)))
    assert is_like(refused.value.fact, BeyondFence(500.0, 500.0, ANY))
    lost = at(0.0, 0.0, 0.0, ok=False)
    with pytest.raises(MissionError) as refused:
        preview_goal(task, lost, CONFIG, go_to((0.0, 0.0)))
    assert isinstance(refused.value.fact, PositionLost)


def test_a_place_too_far_from_the_robot_is_refused_before_a_way_is_planned(task: Task) -> None:
    far = at(5.3e6, 0.0, 0.0)
    with pytest.raises(MissionError) as refused:
        preview_goal(task, far, CONFIG, go_to((1.0, 0.0)))
    assert is_like(refused.value.fact, TooFarAway(5_299_999.0, 1000.0), within=0.5)


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
        place = {
            "x_map_m": here.x_map_m + math.cos(here.yaw_map_rad),
            "y_map_m": here.y_map_m + math.sin(here.yaw_map_rad),
        }
        for speed_mps in (settings.mission.speed_mps, 0.2):
            session.inbox.post(ChangeSetting(setting="mission.speed_mps", value=speed_mps))
            next(ticks)
            status, shown = browser.ask("POST", "/api/v1/goal/preview", place)
            assert status == 200, shown
            assert shown["time_s"] == pytest.approx(shown["length_m"] / speed_mps, abs=0.1)


def test_the_page_asks_the_robot_and_nothing_moves(robot: Robot) -> None:
    browser = Browser(robot.port)
    way = wire.GoalPreview(points_map_m=[(0.0, 0.0), (1.0, 0.0)], length_m=1.0, time_s=1.2)
    robot.answers[wire.PreviewGoal] = way
    place = {"x_map_m": 1.0, "y_map_m": 0.0, "yaw_map_rad": None}
    status, answer = browser.ask("POST", "/api/v1/goal/preview", place)
    assert (status, msgspec.convert(answer, wire.GoalPreview)) == (200, way)
    robot.refusals[wire.PreviewGoal] = "there is crop"
    assert browser.ask("POST", "/api/v1/goal/preview", place)[0] == 409
    for wrong in ("north", 10**400):
        assert (
            browser.ask("POST", "/api/v1/goal/preview", {"x_map_m": 1.0, "y_map_m": wrong})[0]
            == 400
        )
    asked = [order.question for order in robot.of_kind(wire.Ask)]
    assert asked == [wire.PreviewGoal(goal=go_to((1.0, 0.0)))] * 2
    assert not robot.of_kind(wire.DriveOrder) and not robot.of_kind(wire.RequestOrder)
