"""The robot that is made for the tests speaks as the real one does."""

from __future__ import annotations

from typing import Any, get_args

import pytest

from agribot.app.simulated_run import simulate
from agribot.core import config
from agribot.core.messages import MissionState
from agribot.ui.view import RunView
from tests.ui.page.fake_robot import MISSION_STATES, FakeRobot

ADDED_ON_THE_WAY = {"e", "mono_ms", "wall_ms", "rtf", "weeds", "recording"}


@pytest.fixture(scope="module")
def real_state(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    settings = config.load("farm", ["perception.enabled=false", "duration_s=4"])
    with simulate(settings, tmp_path_factory.mktemp("runs") / "run") as session:
        view = RunView(settings)
        session.add_tap(view)
        for _ in session.ticks():
            pass
        state = view.state()
    assert state is not None
    return state


def test_its_state_has_the_fields_of_a_real_one(real_state: dict[str, Any]) -> None:
    made = FakeRobot(weeds=1).state(0.0)
    assert set(made) == set(real_state) | ADDED_ON_THE_WAY
    for part in ("mission", "gnss", "battery"):
        assert set(made[part]) == set(real_state[part])


def test_the_tilt_of_a_robot_on_the_flat_farm_is_small(real_state: dict[str, Any]) -> None:
    assert max(abs(angle_rad) for angle_rad in real_state["att"]) < 0.06


def test_its_mission_has_states_that_a_mission_can_have() -> None:
    assert set(MISSION_STATES.values()) <= set(get_args(MissionState))
