"""What a fault cost, by the truth: metres outside, way until it stood, crops crushed after it."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.core.messages import DriveCommand, Row, TickRecord
from agribot.sim.safety_judge import MARGIN_M, SafetyJudge, find_boundary, measure_outside_m
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


@pytest.mark.parametrize(
    ("x_m", "y_m", "outside_m"),
    [(5.0, 5.0, 0.0), (12.0, 5.0, 2.0), (5.0, -1.0, 1.0), (13.0, 14.0, 5.0), (-0.5, 10.0, 0.5)],
)
def test_outside_is_the_distance_to_the_nearest_edge(
    x_m: float, y_m: float, outside_m: float
) -> None:
    assert measure_outside_m(SQUARE, x_m, y_m) == pytest.approx(outside_m)


def test_of_a_field_with_a_bay_the_bay_is_outside() -> None:
    bay = np.array([[0, 0], [10, 0], [10, 10], [5, 2], [0, 10]], dtype=float)
    assert measure_outside_m(bay, 5.0, 1.0) == 0.0
    assert measure_outside_m(bay, 5.0, 3.0) == pytest.approx(5.0 / math.hypot(5, 8), abs=1e-9)


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
    for place, outside_m in (
        ((-2.0, 0.0), 0.0),
        ((0.0, 12.0 + room_m - 0.01), 0.0),
        ((0.0, 12.0 + room_m + 1.0), 1.0),
        ((2.0 + room_m + 0.5, 5.0), 0.5),
        ((-2.0 - room_m - 0.5, 5.0), 0.5),
    ):
        assert measure_outside_m(boundary, *turned(*place)) == pytest.approx(outside_m, abs=1e-9)
    assert find_boundary((), None, 1.0) is None


def test_a_bent_row_is_inside_where_it_bends() -> None:
    bent = Row(index=0, start_map_m=(0.0, 0.0), end_map_m=(10.0, 0.0), curvature_radpm=0.1)
    boundary = find_boundary((bent,), None, 0.0)
    assert boundary is not None
    bulge_m = 10.0 * (1.0 - math.sqrt(0.75))  # of a chord as long as the radius
    corners_m = boundary[:, 1]
    reach_m = max(abs(corners_m.min()), abs(corners_m.max()))
    assert reach_m == pytest.approx(bulge_m + MARGIN_M, abs=1e-6)


def test_the_way_of_a_stop_counts_from_the_command_until_it_stands() -> None:
    judge, x_m = SafetyJudge(SQUARE), 0.0
    for k, v_mps in enumerate([0.4] * 5 + [0.4, 0.3, 0.2, 0.1, 0.0, 0.0]):
        x_m += 0.02 * v_mps
        is_stopped = k >= 5
        record = tick(0.0 if is_stopped else 0.4, "bumper" if is_stopped else "")
        judge.look(record, truth(0.02 * k, x_m, v_mps))
    assert judge.score(set()).stop_distance_m_max == pytest.approx(0.02 * (0.4 + 0.3 + 0.2 + 0.1))


def test_a_stop_at_the_end_of_a_mission_is_no_stop_of_the_supervisor() -> None:
    judge = SafetyJudge(None)
    for k, v_mps in enumerate([0.4, 0.4, 0.3, 0.2]):
        judge.look(tick(0.0), truth(0.02 * k, 0.01 * k, v_mps))
    score = judge.score({1, 2})
    assert (score.stop_distance_m_max, score.crushed_after_fault) == (0.0, None)


def test_the_worst_of_a_job_outlives_its_runs() -> None:
    first = SafetyJudge(SQUARE)
    first.look(tick(0.4), truth(0.0, 13.0, 0.4))
    first.crushed_before = frozenset({4})
    then = SafetyJudge(SQUARE)
    then.restore(first.export_state())
    then.look(tick(0.4), truth(0.0, 11.0, 0.4))
    score = then.score({4, 7, 9})
    assert (score.outside_m_max, score.crushed_after_fault) == (3.0, 2)
