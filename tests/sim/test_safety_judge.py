"""What a fault cost, by the truth: metres outside, way until it stood, crops crushed after it."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import DriveCommand, Row, TickRecord
from agribot.description.loader import load_robot
from agribot.sim.field_edge import FieldEdge
from agribot.sim.safety_judge import (
    MARGIN_M,
    Crush,
    Rolling,
    SafetyJudge,
    StopWatch,
    find_boundary,
)
from agribot.sim.truth import Truth
from tests.record import record_samples as samples

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
ROWS = tuple(
    Row(index=k, start_map_m=(k * 1.0, 2.0), end_map_m=(k * 1.0, 12.0)) for k in range(3)
)  # fmt: skip


def truth(t_s: float, x_m: float, v_mps: float) -> Truth:
    return Truth(t_s=t_s, x_map_m=x_m, y_map_m=5.0, yaw_map_rad=0.0, v_mps=v_mps,
                 yaw_rate_radps=0.0, roll_rad=0.0, pitch_rad=0.0)  # fmt: skip


def tick(v_mps: float, reason: str = "") -> TickRecord:
    record = samples.ticks(1)[0]
    drive = DriveCommand(v_mps=v_mps)
    command = msgspec.structs.replace(record.command, drive=drive)
    return msgspec.structs.replace(record, command=command, reason=reason)


def bounds(*rings: np.ndarray, half_m: float = 0.0) -> FieldBounds:
    return FieldBounds(rings_map_m=rings, front_m=half_m, rear_m=half_m, half_width_m=half_m)


def outside_m(ring: np.ndarray, x_m: float, y_m: float) -> float:
    return FieldEdge(bounds(ring)).measure_outside_m(x_m, y_m, 0.0)


@pytest.mark.parametrize(
    ("x_m", "y_m", "expected_m"),
    [(5.0, 5.0, 0.0), (12.0, 5.0, 2.0), (5.0, -1.0, 1.0), (13.0, 14.0, 5.0), (-0.5, 10.0, 0.5)],
)
def test_outside_is_the_distance_to_the_nearest_edge(
    x_m: float, y_m: float, expected_m: float
) -> None:
    assert outside_m(SQUARE, x_m, y_m) == pytest.approx(expected_m)


def test_of_a_field_with_a_bay_the_bay_is_outside() -> None:
    bay = np.array([[0, 0], [10, 0], [10, 10], [5, 2], [0, 10]], dtype=float)
    assert outside_m(bay, 5.0, 1.0) == 0.0
    assert outside_m(bay, 5.0, 3.0) == pytest.approx(5.0 / math.hypot(5, 8), abs=1e-9)


def test_the_corners_of_the_robot_count_and_how_it_is_turned() -> None:
    edge = FieldEdge(bounds(SQUARE, half_m=0.5))
    assert edge.measure_outside_m(9.5, 5.0, 0.0) == pytest.approx(0.0, abs=1e-9)
    assert edge.measure_outside_m(9.5, 5.0, math.pi / 4) == pytest.approx(0.5 * math.sqrt(2) - 0.5)
    assert edge.measure_outside_m(9.8, 5.0, 0.0) == pytest.approx(0.3)


def test_a_hole_is_outside_and_so_is_a_post_below_the_middle_of_the_robot() -> None:
    pond = np.array([[4.0, 4.0], [6.0, 4.0], [6.0, 6.0], [4.0, 6.0]])
    edge = FieldEdge(bounds(SQUARE, pond, half_m=0.5))
    assert edge.measure_outside_m(3.4, 5.0, 0.0) == 0.0
    assert edge.measure_outside_m(3.7, 5.0, 0.0) == pytest.approx(0.2)
    assert edge.measure_outside_m(5.0, 3.6, 0.0) == pytest.approx(0.1)
    post = np.array([[5.0, 5.0], [5.02, 5.0], [5.02, 5.02]])
    edge = FieldEdge(bounds(SQUARE, post, half_m=0.5))
    assert edge.measure_outside_m(5.0, 5.2, 0.3) > 0.2
    assert edge.measure_outside_m(5.0, 5.6, 0.0) == 0.0


def test_far_from_the_edge_nothing_is_measured_anew_and_nothing_is_missed() -> None:
    edge, rng = FieldEdge(bounds(SQUARE, half_m=0.5)), np.random.default_rng(3)
    x_m, y_m = 5.0, 5.0
    for _ in range(2000):
        x_m, y_m = x_m + rng.normal(0.0, 0.3), y_m + rng.normal(0.0, 0.3)
        fresh = FieldEdge(bounds(SQUARE, half_m=0.5))
        assert edge.measure_outside_m(x_m, y_m, 0.4) == fresh.measure_outside_m(x_m, y_m, 0.4)


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7])
def test_rows_and_start_have_headland_and_margin_around_them(yaw_rad: float) -> None:
    turn = np.array([[math.cos(yaw_rad), -math.sin(yaw_rad)],
                     [math.sin(yaw_rad), math.cos(yaw_rad)]])  # fmt: skip

    def turned(x_m: float, y_m: float) -> tuple[float, float]:
        x, y = (turn @ (x_m, y_m)).tolist()
        return x, y

    rows = [
        msgspec.structs.replace(
            row, start_map_m=turned(*row.start_map_m), end_map_m=turned(*row.end_map_m)
        )
        for row in ROWS
    ]
    boundary = find_boundary(rows, turned(-2.0, 0.0), 1.0)
    assert boundary is not None
    room_m = 1.0 + MARGIN_M
    for place, expected_m in (
        ((-2.0, 0.0), 0.0),
        ((0.0, 12.0 + room_m - 0.01), 0.0),
        ((0.0, 12.0 + room_m + 1.0), 1.0),
        ((2.0 + room_m + 0.5, 5.0), 0.5),
        ((-2.0 - room_m - 0.5, 5.0), 0.5),
    ):
        assert outside_m(boundary, *turned(*place)) == pytest.approx(expected_m, abs=1e-9)
    assert find_boundary((), None, 1.0) is None


def test_a_bent_row_is_inside_where_it_bends() -> None:
    bent = Row(index=0, start_map_m=(0.0, 0.0), end_map_m=(10.0, 0.0), curvature_radpm=0.1)
    boundary = find_boundary((bent,), None, 0.0)
    assert boundary is not None
    bulge_m = 10.0 * (1.0 - math.sqrt(0.75))  # of a chord as long as the radius
    corners_m = boundary[:, 1]
    reach_m = max(abs(corners_m.min()), abs(corners_m.max()))
    assert reach_m == pytest.approx(bulge_m + MARGIN_M, abs=1e-6)


ROBOT = load_robot("agribot")


def stop_from(judge: SafetyJudge, speeds_mps: list[float], cut_after: int | None = None) -> float:
    """Let a robot at 0.4 m/s be stopped at the first of these speeds; return how far it rolls.

    Its motors lose their power `cut_after` speeds later.
    """
    x_m = 0.0
    for k, v_mps in enumerate([0.4] * 5 + speeds_mps + [0.0, 0.0]):
        x_m += 0.02 * v_mps
        is_stopped = k >= 5
        record = tick(0.0 if is_stopped else 0.4, "bumper" if is_stopped else "")
        is_cut = cut_after is not None and k >= 5 + cut_after
        command = msgspec.structs.replace(record.command, is_power_cut=is_cut)
        record = msgspec.structs.replace(record, command=command)
        judge.look(record, truth(0.02 * k, x_m, v_mps))
    return 0.02 * sum(speeds_mps[1:])


def test_the_way_of_a_stop_counts_from_the_command_until_it_stands() -> None:
    judge = SafetyJudge(bounds(SQUARE), ROBOT)
    rolled_m = stop_from(judge, [0.4, 0.3, 0.2, 0.1])
    score = judge.score(set())
    assert score.stop_distance_m_max == pytest.approx(rolled_m)
    promised_m = 0.4 * 0.2 + 0.4**2 / (2.0 * ROBOT.drive.max_accel_mps2)
    assert score.stop_allowed_m == pytest.approx(promised_m)
    assert rolled_m < promised_m
    assert score.stops_too_long == 0


def test_what_a_robot_drove_while_its_program_stood_still_is_no_way_of_the_stop() -> None:
    judge = SafetyJudge(None, ROBOT)
    judge.look(tick(0.4), truth(1.0, 0.0, 0.4))
    judge.look(tick(0.0, "clock"), truth(4.0, 0.24, 0.0))  # its board had stopped it long before
    judge.look(tick(0.0, "clock"), truth(4.02, 0.24, 0.0))
    score = judge.score(set())
    assert (score.stop_distance_m_max, score.stops_too_long) == (0.0, 0)


def test_a_robot_that_rolls_on_has_not_kept_what_its_drive_promises() -> None:
    judge = SafetyJudge(None, ROBOT)
    rolled_m = stop_from(judge, [0.4] * 100)
    score = judge.score(set())
    assert score.stop_distance_m_max == pytest.approx(rolled_m)
    assert score.stops_too_long == 1
    then = SafetyJudge(None, ROBOT)
    then.restore(judge.export_state())
    stop_from(then, [0.1])
    kept = then.score(set())
    assert kept.stop_distance_m_max == pytest.approx(rolled_m)
    assert kept.stops_too_long == 1


def test_the_time_above_the_protection_level_counts_over_all_runs_of_a_job() -> None:
    judge = SafetyJudge(None, ROBOT)
    assert judge.score(set()).over_level_ratio is None
    for ok, off_m in ((False, 9.0), (True, 0.1), (True, 0.1), (True, 0.6)):
        record = tick(0.4)
        estimate = msgspec.structs.replace(
            record.estimate, x_map_m=off_m, y_map_m=5.0, ok=ok, protection_m=0.5
        )
        judge.look(msgspec.structs.replace(record, estimate=estimate), truth(1.0, 0.0, 0.4))
    then = SafetyJudge(None, ROBOT)
    then.restore(judge.export_state())
    assert then.score(set()).over_level_ratio == pytest.approx(1 / 3)


def test_a_robot_without_power_may_roll_out_from_where_it_lost_it_and_no_farther() -> None:
    roll_out_m = ROBOT.promise_roll_out_m(0.4)
    judge = SafetyJudge(None, ROBOT)
    rolled_m = stop_from(judge, [0.4] * 40, cut_after=25)  # it was driven on for 0.5 s
    score = judge.score(set())
    assert score.stop_distance_m_max == pytest.approx(rolled_m)
    assert score.stop_allowed_m == pytest.approx(0.4 * 0.5 + roll_out_m)
    assert score.stops_too_long == 0
    stop_from(judge, [0.4] * 40)
    assert judge.score(set()).stops_too_long == 1, "with its power it should have braked"
    stop_from(judge, [0.4] * 100, cut_after=25)
    assert judge.score(set()).stops_too_long == 2
    late = SafetyJudge(None, ROBOT)
    stop_from(late, [0.4] * 150, cut_after=130)  # it ought to have lost its power after 1 s
    driven_on_m = 1.0 * ROBOT.drive.max_speed_mps
    assert late.score(set()).stop_allowed_m == pytest.approx(driven_on_m + roll_out_m)


def test_a_stop_at_the_end_of_a_mission_is_no_stop_of_the_supervisor() -> None:
    judge = SafetyJudge(None)
    for k, v_mps in enumerate([0.4, 0.4, 0.3, 0.2]):
        judge.look(tick(0.0), truth(0.02 * k, 0.01 * k, v_mps))
    score = judge.score({1, 2})
    assert (score.stop_distance_m_max, score.crushed_after_fault) == (0.0, None)


def test_crushes_after_a_fault_have_their_times_and_so_has_coming_to_rest() -> None:
    judge = SafetyJudge(None)
    crushes = [(index, Crush(t_s=t_s, by="wheel")) for index, t_s in ((4, 0.5), (7, 3.0), (9, 2.0))]
    stop_from(judge, [0.2])
    assert judge.score({4}, crushes[:1]).crushes == ()
    judge.crushed_before = frozenset({4})
    stop_from(judge, [0.2])
    score = judge.score({4, 7, 9}, crushes)
    assert [crush.t_s for crush in score.crushes] == [2.0, 3.0]
    assert score.stood_s == pytest.approx((0.12,))


def test_a_way_into_the_field_is_not_outside_and_a_way_out_is() -> None:
    judge = SafetyJudge(bounds(SQUARE, half_m=0.5))
    for k, x_m in enumerate((-3.0, -1.0, 2.0)):
        judge.look(tick(0.4), truth(1.0 * k, x_m, 0.4))
    assert judge.score(set()).outside_m_max == 0.0
    judge.look(tick(0.4), truth(5.0, 9.7, 0.4))
    assert judge.score(set()).outside_m_max == pytest.approx(0.2)


def test_the_worst_of_a_job_outlives_its_runs() -> None:
    first = SafetyJudge(bounds(SQUARE))
    first.look(tick(0.4), truth(0.0, 5.0, 0.4))
    first.look(tick(0.4), truth(1.0, 13.0, 0.4))
    first.crushed_before = frozenset({4})
    then = SafetyJudge(bounds(SQUARE))
    then.restore(first.export_state())
    then.look(tick(0.4), truth(0.0, 5.0, 0.4))
    then.look(tick(0.4), truth(1.0, 11.0, 0.4))
    score = then.score({4, 7, 9})
    assert (score.outside_m_max, score.crushed_after_fault) == (3.0, 2)


def test_wheels_that_spin_a_deaf_board_and_a_robot_that_was_tipped_lengthen_the_promise() -> None:
    plain_m = ROBOT.promise_stop_m(0.2)
    for rolling, more_m in (
        (Rolling(0.2), 0.0),
        (Rolling(0.2, wheels_mps=-0.4), ROBOT.promise_stop_m(0.4) - plain_m),
        (Rolling(0.2, silent_s=0.3), 0.2 * (ROBOT.drive.command_timeout_s - 0.3)),
        (
            Rolling(0.2, tilt_rad=0.6),
            0.6 * (ROBOT.drive.wheelbase_m / 2.0 + ROBOT.drive.wheel_radius_m),
        ),
    ):
        watch = StopWatch(ROBOT)
        for x_m, is_stopped in ((0.0, False), (0.01, True), (0.02, True)):
            watch.look((x_m, 0.0), rolling, is_stopped=is_stopped)
        assert watch.allowed_m == pytest.approx(plain_m + more_m)
