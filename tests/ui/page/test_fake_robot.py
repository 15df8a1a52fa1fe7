"""The robot that is made for the tests speaks as the real one does."""

from __future__ import annotations

from typing import get_args

import pytest

from agribot.app.simulated_run import simulate
from agribot.core import config
from agribot.core.messages import MissionState
from agribot.ui import wire
from agribot.ui.view import RunView
from tests.ui.page.fake_robot import MISSION_STATES, FakeRobot

SET_ON_THE_WAY = {"epoch", "mono_ms", "pace_ratio", "weed_count", "recording"}


@pytest.fixture(scope="module")
def real_state(tmp_path_factory: pytest.TempPathFactory) -> wire.State:
    settings = config.load("farm", ["perception.enabled=false", "duration_s=4"])
    with simulate(settings, tmp_path_factory.mktemp("runs") / "run") as session:
        view = RunView(settings)
        session.add_tap(view)
        for _ in session.ticks():
            pass
        state = view.state()
    assert state is not None
    return state


def test_its_state_tells_all_that_a_real_one_does(real_state: wire.State) -> None:
    made = FakeRobot(weeds=1).state(1.0)
    for name in made.__struct_fields__:
        is_told, is_really_told = (getattr(s, name) is not None for s in (made, real_state))
        assert is_told == is_really_told or name in SET_ON_THE_WAY, name


def test_the_tilt_of_a_robot_on_the_flat_farm_is_small(real_state: wire.State) -> None:
    assert real_state.tilt_rad is not None
    assert max(map(abs, real_state.tilt_rad)) < 0.06


def test_its_mission_has_states_that_a_mission_can_have() -> None:
    assert set(MISSION_STATES.values()) <= set(get_args(MissionState))


def test_what_it_says_can_be_read_as_a_page_reads_it() -> None:
    robot = FakeRobot(weeds=3)
    for _ in range(40):
        robot.step(0.1)
    for message in (robot.snapshot(), robot.state(1.0)):
        assert wire.read_server_message(wire.encode(message)) == message
