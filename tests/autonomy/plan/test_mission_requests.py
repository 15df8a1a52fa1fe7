"""The one table of what a mission does with every request, in every state."""

from __future__ import annotations

from typing import get_args

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.mission.errand import STOPPING
from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.mission.requests import COLUMN_OF, TABLE, Column, Do, Ignore, Refuse
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.plan.mission.states import (
    Driving,
    Ended,
    OnErrand,
    Paused,
    State,
    Stopping,
    Waiting,
)
from agribot.core.facts import (
    AwayFromRows,
    BatteryLow,
    CancelledBy,
    CarriedAway,
    ErrandRefused,
    InNoRow,
    NothingPlanned,
    NotResumed,
    PausedBy,
    ResumeAwaited,
    RobotDrives,
    RowNotMoved,
    RowNotSkipped,
    Said,
    TaskRefused,
)
from agribot.core.latch import Latch
from agribot.core.messages import (
    ChangeSetting,
    CorrectPose,
    DrawShape,
    Goal,
    MissionStatus,
    PointOut,
    RequestEvent,
    RequestWord,
    TakePlan,
    Visit,
)
from tests.asking import ask, go_to
from tests.autonomy.plan.paper_task import PaperTasks
from tests.autonomy.plan.planting import MISSION, at, point_at
from tests.autonomy.plan.test_mission_cut_off import places
from tests.autonomy.plan.test_mission_errands import HEADLAND, Drive, task
from tests.autonomy.plan.test_mission_states import Ride

STATES: dict[Column, type[State]] = {
    "waiting": Waiting,
    "driving": Driving,
    "on_errand": OnErrand,
    "stopping": Stopping,
    "paused": Paused,
    "ended": Ended,
    "open": Ended,
    "stopped": Paused,
}
ACTIONS = get_args(RequestWord)
REQUESTS: dict[str, RequestEvent] = {
    "goto": ask(go_to(HEADLAND), "Ada"),
    "visit": ask(Visit(places_map_m=((-2.0, 6.0),)), "Ada"),
    "plan": ask(TakePlan(geojson="1"), "Ada"),
    "set": ask(ChangeSetting(setting="mission.speed_mps", value=0.2)),
    "pose_estimate": ask(CorrectPose(x_map_m=0.0, y_map_m=0.0, yaw_map_rad=0.0)),
    "point_out": ask(PointOut(x_map_m=0.0, y_map_m=0.0)),
    "draw_polygon": ask(DrawShape(shape="polygon", corners_map_m=())),
    "draw_route": ask(DrawShape(shape="route", corners_map_m=())),
}


def request(action: RequestWord) -> RequestEvent:
    return REQUESTS[action] if action in REQUESTS else ask(action, "Ada")


class Asked(Ride):
    """A mission over three rows that takes everything, in a state of one's choice."""

    def __init__(self, saved: SavedMission | None = None) -> None:
        new_tasks = PaperTasks(lambda text: task(int(text)), places)
        super().__init__(Mission(task(), MISSION, saved, new_tasks, latch=Latch()))
        self.where = self.start

    def ask(self, event: RequestEvent | None = None, v_mps: float = 0.0) -> MissionStatus:
        return self.want(event, v_mps).status

    def want(self, event: RequestEvent | None = None, v_mps: float = 0.0) -> Goal:
        self.t_s += 0.02
        here = msgspec.structs.replace(at(*self.where, self.t_s), v_mps=v_mps)
        return self.mission.step(here, [event] if event else [])

    def into(self, column: Column) -> MissionStatus:
        """Bring it into a state; the status that it has there."""
        if column == "waiting":
            return self.ask()
        self.settle()
        self.along(0.0, 3.0)
        self.where = self.place(3.0)
        if column in ("on_errand", "stopping"):
            self.ask(request("goto"), v_mps=0.4 * (column == "stopping"))
        elif column == "paused":
            self.ask(request("pause"))
        elif column == "stopped":
            self.ask(request("stop"))
        elif column in ("ended", "open"):
            self.ask(request("cancel"))
        if column == "open":
            self.mission.stay_open()
        v_mps = 0.4 * (column == "stopping")
        return self.ask(v_mps=v_mps)


def test_every_request_has_a_reaction_in_every_state() -> None:
    assert set(TABLE) == set(ACTIONS)
    assert set(COLUMN_OF) == set(get_args(State))
    for action, reactions in TABLE.items():
        assert set(reactions) >= {*COLUMN_OF.values(), "open"}, action
        assert set(reactions) <= set(get_args(Column)), action
        for reaction in reactions.values():
            assert isinstance(reaction, Do) or reaction.why, action


@pytest.mark.parametrize("column", STATES)
@pytest.mark.parametrize("action", ACTIONS)
def test_a_mission_does_with_a_request_what_the_table_says(
    action: RequestWord, column: Column
) -> None:
    one = Asked()
    before = one.into(column)
    assert isinstance(one.mission.state, STATES[column])
    reactions = TABLE[action]
    if column == "stopped":
        reaction = reactions.get("stopped") or reactions["paused"]
    else:
        reaction = reactions[column]
    v_mps = 0.4 * (column == "stopping")
    after = one.ask(request(action), v_mps)
    if isinstance(reaction, Refuse):
        assert after.refusal_fact == reaction.why
        assert after == msgspec.structs.replace(
            before, refusal=after.refusal, refusal_fact=reaction.why
        )
    elif isinstance(reaction, Ignore):
        assert after == before
    else:
        assert is_done(reaction, one, before, after), (reaction, after)


def is_done(reaction: Do, one: Asked, before: MissionStatus, after: MissionStatus) -> bool:
    """What may be seen of it at once, or why it could not be done."""
    state, refusal = one.mission.state, after.refusal_fact
    is_stopped = after.stopped_fact is not None
    seen = {
        Do.HOLD: is_stopped and isinstance(state, Paused | Ended),
        Do.RELEASE: not is_stopped and (after == before or after.fact == ResumeAwaited()),
        Do.PAUSE: after.fact == PausedBy("Ada"),
        Do.RESUME: isinstance(state, Driving),
        Do.BEGIN_ANEW: isinstance(state, Waiting),
        Do.CANCEL: (after.state, after.fact) == ("cancelled", CancelledBy("Ada")),
        Do.SKIP_ROW: any(row.skipped for row in one.mission.row_results),
        Do.NUDGE_LEFT: after.row_nudged_m > 0.0 or refusal == RowNotMoved(InNoRow()),
        Do.NUDGE_RIGHT: after.row_nudged_m < 0.0 or refusal == RowNotMoved(InNoRow()),
        Do.TURN_HOME: after.leg in ("way home", STOPPING)
        or refusal == ErrandRefused("home", NothingPlanned()),
        Do.TURN_TO_GOAL: after.leg in ("to the goal", STOPPING),
        Do.TAKE_PLAN: after.rows_total == 1 or refusal == TaskRefused("plan", RobotDrives()),
        Do.TAKE_VISIT: after.task == "visit",
        Do.SET: one.mission.speed_mps == 0.2,
    }
    return seen[reaction]


@pytest.mark.parametrize("action", ["pause", "cancel", "skip_row", "stop"])
def test_a_pause_on_an_errand_keeps_its_way(action: RequestWord) -> None:
    one = Asked()
    one.into("on_errand")
    one.ask(request("pause"))
    path = one.mission.path
    status = one.ask(request(action))
    assert one.mission.path is path
    if action == "skip_row":
        assert status.refusal_fact == RowNotSkipped(AwayFromRows())


def test_a_mission_that_is_cancelled_while_it_stops_for_an_errand_stays_where_it_is() -> None:
    one = Asked()
    one.into("stopping")
    one.ask(request("cancel"), v_mps=0.4)
    for _ in range(20):
        goal = one.want()
        assert goal.max_speed_mps == 0.0
    assert goal.status.state == "cancelled"
    saved = one.mission.snapshot()
    assert saved is not None and saved.errand is not None, "a run that goes on asks about it"


def test_resumed_twice_it_still_goes_to_the_place_that_it_stops_for() -> None:
    one = Asked()
    one.into("stopping")
    for _ in range(3):
        goal = one.want(request("resume"), v_mps=0.4)
        assert (goal.status.leg, goal.max_speed_mps) == (STOPPING, 0.0)
    assert one.ask().leg == "to the goal"


def test_a_new_task_is_not_asked_about_what_an_earlier_run_was_sent_to() -> None:
    first = Asked()
    first.into("on_errand")
    saved = first.mission.snapshot()
    again = Asked(saved=saved)
    again.where = first.where
    again.ask()
    again.ask(request("visit"))
    for _ in range(60):
        status = again.ask()
    assert (status.state, status.task) == ("running", "visit")


class Later:
    """A planning host that answers when the test lets it."""

    def __init__(self) -> None:
        self.is_ready = True
        self._work: object = None

    def ask(self, t_s: float, work: object, latency_s: float) -> None:
        self._work = work

    def take(self, t_s: float) -> object:
        if not self.is_ready:
            return None
        work, self._work = self._work, None
        return work


@pytest.mark.parametrize("has_errand", [False, True])
def test_a_speed_set_while_a_way_is_planned_is_that_of_the_way(has_errand: bool) -> None:
    host = Later()
    one = Asked()
    one.mission = Mission(task(), MISSION, planning=host)  # type: ignore[arg-type]
    if has_errand:
        one.into("driving")
        host.is_ready = False
        one.ask(request("goto"))
    else:
        host.is_ready = False
        for _ in range(60):
            one.ask()
    slow = ask(ChangeSetting(setting="mission.speed_mps", value=0.1))
    one.ask(slow)
    host.is_ready = True
    status = one.ask()
    assert status.state == "running"
    assert status.eta_s is not None
    assert status.eta_s == pytest.approx(status.distance_left_m / 0.1, rel=0.1)


def test_back_at_its_work_the_robot_is_not_held_for_the_headway_of_its_errand() -> None:
    """The way back is longer than what is driven of the work when it goes on."""
    drive = Drive()
    patient = msgspec.structs.replace(MISSION, stall_timeout_s=5.0)
    drive.mission = Mission(task(), patient)
    drive.settle()
    drive.along(0.0, 4.0)
    drive.goto(drive.place(4.0), 2.0, 8.0)
    drive.to_the_end()
    drive.be_at(*HEADLAND, "resume")
    way = drive.mission.path
    assert way is not None
    drive.to_the_end()
    work = drive.mission.path
    assert work is not None
    s_m = drive.be_at(*way.xy_map_m[-1]).s_m
    assert s_m + 2.0 < way.s_m[-1], "else this proves nothing"
    for step_m in np.arange(s_m, s_m + 2.0, 0.4 * 0.02):  # 5 s at 0.4 m/s and 50 Hz
        status = drive.be_at(*point_at(work, float(step_m))).status
    assert (status.state, status.reason) == ("running", "")


def test_a_battery_that_gets_low_in_the_moment_of_a_stop_is_heeded_after_it() -> None:
    latch, one = Latch(), Asked()
    one.mission = Mission(task(), MISSION, latch=latch)
    one.into("driving")
    latch.hold(Said("the bumper touches something in front"))
    moments: tuple[RequestWord | None, ...] = (None, "clear_stop", "resume")
    for action in moments:
        one.mission.obey_warning(BatteryLow(19.0, 20.0))
        one.ask(request(action) if action else None)
    one.mission.obey_warning(BatteryLow(18.0, 20.0))
    assert one.ask().leg == "way home"


def test_a_mission_carried_away_tells_in_its_refusal_why_it_is_not_resumed() -> None:
    one = Asked()
    one.into("paused")
    one.where = (one.where[0] + 3.0, one.where[1])
    status = one.ask(request("resume"))
    assert status.refusal_fact == status.fact
    assert isinstance(status.refusal_fact, NotResumed)
    assert isinstance(status.refusal_fact.cause, CarriedAway)
    assert status.refusal_fact.cause.away_m == pytest.approx(3.0, abs=0.05)
