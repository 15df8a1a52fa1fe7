"""A row counts as done with evidence only: its crop was seen, or the position is that good."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.mission.row_evidence import link_stretches, row_pitch_m
from agribot.autonomy.plan.mission.row_log import Doubt, RowLog
from agribot.autonomy.plan.ways.boustrophedon import plan_rows
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig
from agribot.core.facts import RowsUnproven, RowUnproven
from agribot.core.messages import Estimate, GnssQuality, MissionStatus, Row
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import FARM_START, MISSION, at, point_at
from tests.finding import holds, is_like
from tests.robot_parts import plain_rover

ROWS = lay_rows(FieldConfig(row_count=2, row_length_m=4.0))
PATH = plan_rows(ROWS, FARM_START, plain_rover(), MISSION)
LENGTH_M = float(PATH.s_m[-1])
Look = Callable[[int, float], dict[str, object]]


def mission(*, has_crop: bool = True) -> Mission:
    return Mission(PaperTask(lambda _: PATH, ROWS, has_crop=has_crop), MISSION)


def drive(one: Mission, look: Look, from_m: float = 0.0, to_m: float = LENGTH_M) -> MissionStatus:
    """Along the path with estimates as `look` changes them, by row and metres in it."""
    t_s, entered_m, row = 0.0, 0.0, -1

    def step(x_m: float, y_m: float, changes: dict[str, object]) -> MissionStatus:
        nonlocal t_s
        t_s += 0.02
        estimate: Estimate = msgspec.structs.replace(at(x_m, y_m, t_s), **changes)
        return one.step(estimate).status

    while (status := step(*FARM_START[:2], {})).state == "waiting":
        assert t_s < 10.0
    for s_m in np.arange(from_m, to_m + 0.02, 0.02):
        if status.row != row:
            row, entered_m = status.row, float(s_m)
        status = step(*point_at(PATH, float(s_m)), look(row, float(s_m) - entered_m))
    return status


def test_a_row_in_which_a_camera_sees_no_crop_is_not_done_and_the_mission_says_so() -> None:
    status = drive(mission(), lambda row, _: {"row_seen": row != 1})
    assert status.state == "failed"
    assert is_like(status.fact, RowsUnproven(rows=(RowUnproven(2, 4.0),)), within=0.05)
    assert (status.rows_done, status.rows_unproven) == ((0,), (1,))


@pytest.mark.parametrize("bare", [0, 1], ids=["first", "last"])
def test_a_bare_row_undoes_all_that_were_told_by_counting_from_a_mark(bare: int) -> None:
    """The robot may have been put down one row off: the others look right to it."""
    first = mission()
    status = drive(first, lambda row, _: {"row_seen": row != bare, "quality": GnssQuality.SINGLE})
    assert status.state == "failed"
    assert (status.rows_done, sorted(status.rows_unproven)) == ((), [0, 1])
    unseen, counted = RowUnproven(bare + 1, 4.0), RowUnproven(2 - bare)
    assert holds(status.fact, RowsUnproven, unseen, counted, within=0.05)
    saved = first.snapshot()
    assert saved is not None
    assert saved.covered == ()


def test_a_row_of_which_most_but_not_all_is_bare_says_nothing_of_the_others() -> None:
    def look(row: int, in_row_m: float) -> dict[str, object]:
        return {"row_seen": row != 1 or in_row_m < 1.2, "quality": GnssQuality.SINGLE}

    status = drive(mission(), look)
    assert (status.rows_done, status.rows_unproven) == ((0,), (1,))


@pytest.mark.parametrize(
    ("driven_m", "done", "unproven"), [(2.2, (), [0, 1]), (1.8, (0,), [])], ids=["most", "less"]
)
def test_a_row_given_up_on_bare_ground_undoes_those_told_by_counting_once_most_of_it_is_driven(
    driven_m: float, done: tuple[int, ...], unproven: list[int]
) -> None:
    log = RowLog([0, 1])
    stretches: tuple[tuple[int, float, Doubt], ...] = ((0, 4.0, ""), (1, driven_m, "unseen"))
    for row, length_m, doubt in stretches:
        for at_m in (0.0, length_m):
            log.work(row, 0.0, 10.0 * row + at_m, 0.0, doubt, is_counted=True)
    log.give_up(length_m=4.0)
    assert (log.done, sorted(log.unproven)) == (done, unproven)


def test_a_gap_in_the_row_does_not_undo_it() -> None:
    status = drive(mission(), lambda _, in_row_m: {"row_seen": not 1.0 < in_row_m < 2.5})
    assert (status.state, status.fact) == ("done", None)
    assert (status.rows_done, status.rows_unproven) == ((0, 1), ())


@pytest.mark.parametrize("has_crop", [True, False], ids=["no camera", "bare rows"])
@pytest.mark.parametrize(("std_m", "is_done"), [(0.2, True), (0.3, False)])
def test_without_camera_or_crop_the_position_has_to_distinguish_rows(
    std_m: float, is_done: bool, has_crop: bool
) -> None:
    cov = (std_m**2, 0.0, 0.0, 0.0, std_m**2, 0.0, 0.0, 0.0, 1e-4)
    row_seen = None if has_crop else False
    status = drive(mission(has_crop=has_crop), lambda *_: {"pose_cov": cov, "row_seen": row_seen})
    assert row_pitch_m(ROWS) == pytest.approx(1.0)
    assert status.rows_done == ((0, 1) if is_done else ())
    if not is_done:
        both = tuple(RowUnproven(row, 0.0, 4.0) for row in (1, 2))
        assert is_like(status.fact, RowsUnproven(rows=both), within=0.05)
        assert status.rows_unproven == (0, 1)


def test_swaths_without_crop_ask_for_no_evidence() -> None:
    status = drive(mission(has_crop=False), lambda *_: {"row_seen": False})
    assert (status.state, status.rows_done) == ("done", (0, 1))


def test_what_was_not_seen_before_a_crash_is_not_forgotten() -> None:
    """3 of 4 m of the second row were driven blind; the rest is seen."""
    first = mission()
    entered_m = float(PATH.s_m[int(np.flatnonzero(PATH.row == 1)[0])])
    drive(first, lambda row, _: {"row_seen": row != 1}, to_m=entered_m + 3.0)
    saved = first.snapshot()
    assert saved is not None
    again = msgspec.json.decode(msgspec.json.encode(saved), type=type(saved))
    second = Mission(PaperTask(lambda _: PATH, ROWS), MISSION, again)
    place = point_at(PATH, saved.s_m)
    t_s = 0.0
    while (status := second.step(at(*place, t_s)).status).state == "waiting":
        t_s += 0.02
    for s_m in np.arange(saved.s_m, LENGTH_M + 0.02, 0.02):
        t_s += 0.02
        estimate = msgspec.structs.replace(at(*point_at(PATH, float(s_m)), t_s), row_seen=True)
        status = second.step(estimate).status
    assert status.rows_unproven == (1,)
    assert is_like(status.fact, RowsUnproven(rows=(RowUnproven(2, 3.0),)), within=0.05)


def work(log: RowLog, row: int, metres: Sequence[tuple[float, Doubt]], t_s: float) -> None:
    """Drive through a stretch, some metres with each doubt; the path goes on from stretch 0."""
    s_m = 10.0 * row
    log.work(row, 0.0, s_m, t_s)
    for length_m, doubt in metres:
        s_m += length_m
        log.work(row, 0.0, s_m, t_s, doubt)


BENT = {0: 1}  # stretch 0 of a row goes on as stretch 1; row 2 is another


@pytest.mark.parametrize("short", [0, 1], ids=["first", "last"])
def test_a_short_stretch_of_a_bent_row_is_proven_by_the_rest_of_the_row(short: int) -> None:
    """At its ends a camera that looks ahead sees no more crop."""
    log = RowLog([0, 1, 2], BENT)
    for row in (0, 1):
        work(log, row, [(0.2, ""), (0.5, "unseen")] if row == short else [(5.0, "")], row)
    log.work(-1, 0.0, 30.0, 9.0)
    assert (log.done, log.unproven) == ((0, 1), ())
    straight = RowLog([0])
    work(straight, 0, [(0.2, ""), (0.5, "unseen")], 0.0)
    straight.work(-1, 0.0, 30.0, 9.0)
    assert (straight.done, straight.unproven) == ((), (0,))


def test_a_bent_row_that_nobody_saw_is_not_done_in_any_of_its_stretches() -> None:
    log = RowLog([0, 1, 2], BENT)
    work(log, 2, [(5.0, "")], 0.0)
    work(log, 0, [(1.0, "")], 1.0)
    work(log, 1, [(5.0, "unsure")], 2.0)
    assert log.done == (2, 0), "the row under the robot may still be proven"
    log.work(-1, 0.0, 30.0, 9.0)
    left = {"done": log.done, "unproven": log.unproven}
    assert left == {"done": (2,), "unproven": (0, 1)}


def test_a_bent_row_whose_rest_is_skipped_is_judged_by_what_was_driven() -> None:
    log = RowLog([0, 1, 2], BENT)
    work(log, 0, [(1.0, "unseen")], 1.0)
    log.skip(1)
    log.work(-1, 0.0, 30.0, 9.0)
    assert (log.done, log.unproven, log.skipped) == ((), (0,), (1,))


def test_stretches_that_join_end_to_end_are_one_row() -> None:
    places = ((0.0, 0.0), (4.0, 0.0), (6.0, 0.3), (6.0, 1.3), (0.0, 1.0))
    lines = [(0, 1), (1, 2), (3, 4)]
    rows = [
        Row(index=7 + k, start_map_m=places[first], end_map_m=places[last])
        for k, (first, last) in enumerate(lines)
    ]
    assert link_stretches(rows) == {7: 8}
    assert link_stretches(ROWS) == {}
