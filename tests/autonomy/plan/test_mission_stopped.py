"""A stop and a pause outlive the program: the next run stands until a person lets it go."""

from __future__ import annotations

import msgspec
import pytest

from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.core.fact_text import render
from agribot.core.facts import (
    CameraAndGnssDisagree,
    CutOff,
    PausedBy,
    ResumeAwaited,
    Said,
    StoppedBy,
    StopToResume,
)
from agribot.core.latch import Latch
from agribot.core.messages import Goal
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import MISSION, at
from tests.autonomy.plan.test_mission_resume import ROWS, home, plan, ride, row_at_m
from tests.autonomy.plan.test_mission_states import Ride

STANDING_TICKS = 100


def cut_off(*actions: str) -> tuple[SavedMission, float]:
    """In the middle of row 1, after these events; through JSON, as a file would hold it."""
    one = ride()
    one.settle()
    s_m = row_at_m(one, 1)
    one.along(0.0, s_m)
    for action in actions:
        one.be_at(*one.place(s_m), action)
    saved = one.mission.snapshot()
    assert saved is not None
    return msgspec.json.decode(msgspec.json.encode(saved), type=SavedMission), s_m


def stand(again: Ride, *actions: str) -> Goal:
    for _ in range(STANDING_TICKS):
        goal = again.be_at(*again.start, *actions)
        actions = ()
        assert goal.max_speed_mps == 0.0
        assert not goal.tool_on
    return goal


def resumed(saved: SavedMission) -> Ride:
    again = ride(saved)
    again.start = saved.pose[:2]
    return again


@pytest.mark.parametrize("last", [(), ("cancel",)], ids=["killed", "interrupted"])
def test_a_stop_holds_the_run_that_goes_on_until_it_is_cleared_and_resumed(
    last: tuple[str, ...],
) -> None:
    saved, s_m = cut_off("stop", *last)
    again = resumed(saved)
    status = stand(again).status
    assert status.state == "paused"
    assert status.stopped_fact == StoppedBy("operator")
    assert status.fact == StopToResume(StoppedBy("operator"))
    assert stand(again, "resume").status.stopped_fact, "a resume alone is not enough"
    assert stand(again, "clear_stop").status.stopped_fact is None
    again.be_at(*again.start, "resume")
    goal = again.settle()
    assert goal.status.state == "running"
    assert goal.s_m == pytest.approx(s_m, abs=0.05)
    assert goal.status.rows_done == (0,)


@pytest.mark.parametrize("last", [(), ("cancel",)], ids=["killed", "interrupted"])
def test_a_paused_run_goes_on_only_when_it_is_resumed(last: tuple[str, ...]) -> None:
    saved, s_m = cut_off("pause", *last)
    again = resumed(saved)
    status = stand(again).status
    assert (status.state, status.stopped_fact) == ("paused", None)
    assert status.fact == CutOff(PausedBy("operator"))
    again.be_at(*again.start, "resume")
    assert again.settle().s_m == pytest.approx(s_m, abs=0.05)


def test_however_often_a_run_is_cut_off_it_tells_once_why_it_stands() -> None:
    saved, _ = cut_off("pause")
    for _ in range(3):
        again = resumed(saved)
        assert stand(again).status.fact == CutOff(PausedBy("operator"))
        after = again.mission.snapshot()
        assert after is not None
        assert after.paused_fact == PausedBy("operator")
        saved = after


def test_a_mission_that_held_itself_and_is_cancelled_is_held_no_more_and_kept_as_it_stood() -> None:
    one = ride()
    one.settle()
    one.along(0.0, 2.0)
    place, doubt = one.place(2.0), CameraAndGnssDisagree(0.4, is_left_open=True)
    unsure = msgspec.structs.replace(at(*place, one.t_s), contradiction_fact=doubt)
    assert one.mission.step(unsure).status.held_fact == doubt
    status = one.be_at(*place, "cancel").status
    assert (status.state, status.held) == ("cancelled", "")
    saved = one.mission.snapshot()
    assert saved is not None
    assert (saved.paused, saved.paused_fact) == (render(doubt), doubt)


def test_a_run_that_drove_when_it_was_cut_off_goes_on_by_itself() -> None:
    for actions in ((), ("pause", "resume"), ("stop", "clear_stop", "resume"), ("cancel",)):
        saved, _ = cut_off(*actions)
        assert (saved.stopped_fact, saved.paused_fact) == (None, None)
        assert resumed(saved).settle().status.state == "running"


def test_a_stop_is_still_there_when_the_run_that_goes_on_is_cut_off_too() -> None:
    again = resumed(cut_off("stop")[0])
    again.be_at(*again.start)
    twice = again.mission.snapshot()
    assert twice is not None
    assert twice.stopped_fact == StoppedBy("operator")
    assert stand(resumed(twice)).status.stopped_fact == StoppedBy("operator")
    again.be_at(*again.start, "clear_stop")
    assert (once := again.mission.snapshot()) is not None
    assert (once.stopped_fact, once.paused_fact) == (None, ResumeAwaited())


def test_a_file_of_an_older_version_holds_no_stop() -> None:
    tree = msgspec.to_builtins(cut_off("stop")[0])
    for name in ("stopped", "paused", "stopped_fact", "paused_fact"):
        del tree[name]
    saved = msgspec.convert(tree, SavedMission)
    assert resumed(saved).settle().status.state == "running"


def test_a_file_from_before_facts_holds_its_stop_in_its_words() -> None:
    tree = msgspec.to_builtins(cut_off("stop")[0])
    del tree["stopped_fact"], tree["paused_fact"]
    tree |= {"stopped": "a dog", "paused": "a dog"}
    status = resumed(msgspec.convert(tree, SavedMission)).settle().status
    assert status.stopped_fact == Said("a dog")


def test_a_latch_that_others_close_pauses_the_mission_with_its_reason() -> None:
    latch = Latch()
    one = Ride(Mission(PaperTask(plan, ROWS, home=home), MISSION, latch=latch))
    one.settle()
    one.along(0.0, 2.0)
    place = one.place(2.0)
    latch.hold(Said("the bumper touches something in front"))
    status = one.be_at(*place).status
    assert status.state == "paused"
    assert status.stopped_fact == latch.cause
    assert status.fact == StopToResume(Said("the bumper touches something in front"))
    for refused in ("resume", "start", "return_home", "goto"):
        assert one.be_at(*place, refused).status.state == "paused"
    assert one.be_at(*place, "clear_stop").status.fact == ResumeAwaited()
    assert one.be_at(*place, "resume").status.state == "running"
