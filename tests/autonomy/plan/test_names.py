"""Who asks for something is shown to people, and decides nothing."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.autonomy.plan.mission.errand import (
    BATTERY,
    LOST,
    MISSION,
    STUCK,
    restore_errand,
    save_errand,
)
from agribot.autonomy.plan.mission.errand_kind import ErrandKind
from agribot.core.messages import Goal, RequestWord
from tests import nightly
from tests.asking import BY_WORD, ask, go_to
from tests.autonomy.plan.planting import point_at
from tests.autonomy.plan.test_mission_errands import HEADLAND, Drive

# What the program itself shows as who asked, the kinds of errands, and what names hide in texts.
QUOTED = "the 'row'\n\"lost\"\r\0\t"
LONG = "the lost row " * 800
NAMES = (
    LOST, STUCK, "sensors", QUOTED, "\N{RIGHT-TO-LEFT OVERRIDE}adA", LONG, "{by}",
    "Ada; resume goes on", BATTERY, MISSION, "", *ErrandKind, "operator", "start-up", "session",
    " ", "stopped", "\N{FLEXED BICEPS}", "0.5 m",
)  # fmt: skip
each_name = nightly.one_by_one("name", NAMES, in_suite=6)


def follow(action: RequestWord, name: str, *numbers: float) -> list[Goal]:
    """Ask for something in a row: what the mission does until the robot stands again."""
    drive = Drive()
    where = drive.into_row(1)
    request = go_to(numbers) if action == "goto" else BY_WORD[action]
    goals = [drive.ask(*where, ask(request, name))]
    path = drive.mission.path
    assert path is not None
    for s_m in np.arange(0.0, float(path.s_m[-1]) + 0.04, 0.02):
        if goals[-1].status.state != "running":
            break
        goals.append(drive.be_at(*point_at(path, float(s_m))))
    return goals


def describe(goals: list[Goal]) -> list[tuple[object, ...]]:
    return [(g.status.state, g.status.leg, g.max_speed_mps, g.frees_itself, g.s_m) for g in goals]


@pytest.mark.parametrize("action", ["goto", "return_home", "pause", "cancel", "stop"])
@each_name
def test_a_request_by_any_name_ends_as_one_by_ada(action: RequestWord, name: str) -> None:
    numbers = HEADLAND if action == "goto" else ()
    asked, by_ada = follow(action, name, *numbers), follow(action, "Ada", *numbers)
    assert describe(asked) == describe(by_ada)
    assert asked[-1].status.reason == by_ada[-1].status.reason.replace("Ada", name)


@each_name
def test_a_goal_of_any_name_is_kept_as_a_goal_by_a_run_that_is_cut_off(name: str) -> None:
    drive = Drive()
    drive.ask(
        *drive.into_row(1),
        ask(go_to(HEADLAND), name),
    )
    saved = drive.mission.snapshot()
    assert saved is not None
    assert saved.errand is not None
    assert (saved.errand.to, saved.errand.source) == (ErrandKind.GOAL, name)
    again = restore_errand(saved.errand, drive.mission.task, None)
    assert save_errand(again) == saved.errand
