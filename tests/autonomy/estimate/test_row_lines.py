"""Row lines: the pose decides which row, outliers are kept out, a lost row is found again."""

from __future__ import annotations

import math

import msgspec
import pytest

from agribot.autonomy.estimate.filter.ekf import ROW_BIAS, ROW_OFFSET, YAW, Ekf, X, Y
from agribot.autonomy.estimate.filter.history import Motion
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.estimate.sensors.correction import Ladder
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.autonomy.estimate.sensors.row_lines import RowLines
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.messages import GroundPlant, PlantClass, RowLine, Scene
from agribot.lab.bench.nav.scenario import ROWS, make_scenario
from tests.autonomy.estimate.noisy_rover import M8N, record, stand
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.row_plants import watch

FIELD = make_scenario("m8n", vision=True).config(seed=0).field
SEEN = RowLine(t_s=0.0, offset_m=0.0, heading_rad=0.0, offset_std_m=0.015, heading_std_rad=0.012)


class Robot:
    """Stands at a place of the map with a filter that knows it only roughly."""

    def __init__(
        self,
        x_m: float,
        y_m: float,
        yaw_rad: float,
        std_m: float = 0.05,
        field: FieldConfig = FIELD,
    ) -> None:
        self.ekf = Ekf([std_m, std_m, 0.05, *[1e-3] * 7, 0.0], row_yaw_rad=0.0)
        self.ekf.x[X], self.ekf.x[Y], self.ekf.x[YAW] = x_m, y_m, yaw_rad
        self.pose = pose = PoseFilter(EstimateConfig(), field, robot(), self.ekf)
        pose.known.add("position")
        self.rejected, self._history = pose.rejected, pose.history
        self._lines = RowLines(pose)
        self.ladder = Ladder("row line", self._lines)
        self._t_s = 0.0

    def see(self, **changes: float | None) -> None:
        self.ladder.update(self._line(changes))

    def see_picture(self, **changes: float | None) -> None:
        line = self._lines.pick(self._line(changes))
        if line is not None:
            self.ladder.update(line)

    def _line(self, changes: dict[str, float | None]) -> RowLine:
        self._t_s += 0.07
        self._history.append(Motion(self._t_s, 0.0, 0.0, 0.0, 0.0, 0.0))
        return msgspec.structs.replace(SEEN, t_s=self._t_s, **changes)


@pytest.mark.parametrize(("yaw_rad", "side"), [(0.0, 1.0), (math.pi, -1.0)])
@pytest.mark.parametrize("row_y_m", [0.0, 4.0, float(ROWS - 1)])
def test_a_line_puts_the_robot_beside_the_nearest_row(
    yaw_rad: float, side: float, row_y_m: float
) -> None:
    robot = Robot(5.0, row_y_m + 0.02, yaw_rad)
    for _ in range(40):
        robot.see(offset_m=0.08)  # to the left of the row, as the robot faces
    assert robot.ekf.x[Y] == pytest.approx(row_y_m + side * 0.08, abs=0.015)
    assert not robot.rejected


@pytest.mark.parametrize("back_rad", [0.0, math.pi])
def test_lines_of_a_bent_row_put_the_robot_beside_its_arc_and_along_it(back_rad: float) -> None:
    """Row 4 of rows about (0, 30): the robot is 4 cm left of it, 6 m along the first row."""
    bent = msgspec.structs.replace(FIELD, row_yaw_deg=0.0, row_curvature_radpm=1.0 / 30.0)
    turn_rad, at_ahead_m = 0.2, 1.0
    side = math.cos(back_rad)
    radius_m = 30.0 + 3.0 * bent.row_pitch_m - side * 0.04
    x0, y0 = bent.first_row_start_map_m
    true = (x0 + radius_m * math.sin(turn_rad), y0 + 30.0 - radius_m * math.cos(turn_rad))
    ahead_rad = math.atan2(at_ahead_m, radius_m)
    robot = Robot(true[0] + 0.06, true[1] - 0.05, turn_rad + back_rad + 0.03, field=bent)
    ends = {"end_ahead_m": (bent.row_length_m * 33.0 / 30.0 - 33.0 * turn_rad)}
    ends = ends if side > 0.0 else {"end_ahead_m": 33.0 * turn_rad}
    for _ in range(80):
        robot.see(
            offset_m=side * (33.0 - math.hypot(radius_m, at_ahead_m)),
            heading_rad=-side * ahead_rad,
            at_ahead_m=at_ahead_m,
            **ends,
        )
    off_m = math.hypot(robot.ekf.x[X] - x0, robot.ekf.x[Y] - y0 - 30.0) - radius_m
    assert off_m == pytest.approx(0.0, abs=0.01)
    along_rad = math.atan2(robot.ekf.x[X] - x0, 30.0 + y0 - robot.ekf.x[Y])
    assert along_rad * 33.0 == pytest.approx(turn_rad * 33.0, abs=0.02)
    assert math.remainder(robot.ekf.x[YAW] - turn_rad - back_rad, math.tau) == pytest.approx(
        0.0, abs=0.01
    )


def test_the_heading_of_the_line_turns_the_robot_also_when_it_drives_back() -> None:
    robot = Robot(5.0, 3.0, math.pi - 0.02)
    for _ in range(60):
        robot.see(heading_rad=0.03)
    assert robot.ekf.x[YAW] == pytest.approx(-math.pi + 0.03, abs=0.01)


def test_one_outlier_changes_nothing_and_a_run_of_them_opens_the_filter() -> None:
    robot = Robot(5.0, 3.0, 0.0, std_m=0.02)
    robot.see(offset_m=0.3)
    assert robot.ekf.x[Y] == 3.0
    assert robot.rejected["row line off its row"] == 1
    for _ in range(60):
        robot.see(offset_m=0.2)
    assert robot.rejected["row found again"] >= 1
    assert robot.ekf.x[Y] == pytest.approx(3.2, abs=0.03)


def test_a_pose_that_cannot_tell_rows_apart_uses_no_line() -> None:
    robot = Robot(5.0, 3.0, 0.0, std_m=0.5)
    robot.see(offset_m=0.1)
    assert robot.rejected == {"row line ambiguous": 1}
    assert robot.ekf.x[Y] == 3.0


@pytest.mark.parametrize(("off_m", "is_used"), [(0.25, True), (-0.25, True), (0.35, False)])
def test_a_line_near_enough_to_one_row_is_of_that_row_and_leaves_a_rest_of_doubt(
    off_m: float, is_used: bool
) -> None:
    """Known to 0.3 m, 0.25 m off its row, a robot would be 0.75 m off the next: 16 to 1."""
    robot = Robot(5.0, 3.0, 0.0, std_m=0.3)
    robot.see(offset_m=off_m)
    if not is_used:
        assert robot.rejected == {"row line ambiguous": 1}
        return
    assert robot.ekf.x[Y] == pytest.approx(3.0 + off_m, abs=0.03)
    assert 0.90 < robot.pose.identity.certainty < 0.94
    for _ in range(20):
        robot.see(offset_m=off_m)
    assert 0.90 < robot.pose.identity.certainty < 0.94  # the same doubt, not one for each look


@pytest.mark.parametrize(
    ("yaw_rad", "ahead", "expected_m"),
    [
        (0.0, {"end_ahead_m": 1.0}, 11.0),
        (math.pi, {"end_ahead_m": 1.0}, 1.0),
        (0.0, {"start_ahead_m": 1.0}, -1.0),
        (math.pi, {"start_ahead_m": 1.0}, 13.0),
    ],
)
def test_the_ends_of_a_row_tell_the_place_along_it(
    yaw_rad: float, ahead: dict[str, float], expected_m: float
) -> None:
    robot = Robot(expected_m + 0.3, 3.0, yaw_rad, std_m=0.2)
    for _ in range(30):
        robot.see(offset_m=None, heading_rad=None, **ahead)
    assert robot.ekf.x[X] == pytest.approx(expected_m, abs=0.03)


@pytest.mark.parametrize("yaw_rad", [0.1, 0.1 - math.pi])
def test_an_offset_told_ahead_is_that_of_the_place_ahead(yaw_rad: float) -> None:
    robot = Robot(5.0, 3.0, yaw_rad)
    robot.ekf.cov[YAW, YAW] = 1e-8
    for _ in range(40):
        robot.see(offset_m=0.05 + math.sin(0.1), heading_rad=0.1, at_ahead_m=1.0)
    side = 1.0 if yaw_rad > 0.0 else -1.0
    assert robot.ekf.x[Y] == pytest.approx(3.0 + side * 0.05, abs=0.01)
    assert robot.ekf.x[YAW] == pytest.approx(yaw_rad, abs=0.002)


def test_a_heading_error_does_not_pull_a_robot_aside_that_sees_its_row_far_ahead() -> None:
    robot = Robot(5.0, 3.0, 0.05, std_m=0.001)
    for _ in range(60):
        robot.see(offset_m=0.0, at_ahead_m=1.2, heading_std_rad=1.0)
    assert robot.ekf.x[Y] == pytest.approx(3.0, abs=0.003)
    assert robot.ekf.x[YAW] == pytest.approx(0.0, abs=0.015)


@pytest.mark.parametrize(("yaw_rad", "seen_rad"), [(math.pi / 2.0, 0.0), (0.0, 0.35), (0.7, 0.7)])
def test_a_line_in_a_picture_aslant_to_the_rows_is_none_of_them(
    yaw_rad: float, seen_rad: float
) -> None:
    robot = Robot(5.0, 3.0, yaw_rad)
    for _ in range(20):
        robot.see_picture(offset_m=0.1, heading_rad=seen_rad, end_ahead_m=1.0)
    assert robot.rejected == {"row line aslant": 20}
    assert (robot.ekf.x[X], robot.ekf.x[Y], robot.ekf.x[YAW]) == (5.0, 3.0, yaw_rad)


def test_a_gap_in_the_middle_of_a_row_is_not_taken_for_its_end() -> None:
    robot = Robot(5.0, 3.0, 0.0, std_m=0.2)
    for _ in range(20):
        robot.see_picture(end_ahead_m=1.2, range_std_m=0.15)
    assert robot.rejected == {"gap in the row": 20}
    assert robot.ekf.x[X] == pytest.approx(5.0, abs=1e-6)
    near = Robot(11.0, 3.0, 0.0, std_m=0.2)
    for _ in range(80):
        near.see_picture(end_ahead_m=0.5, range_std_m=0.15)
    assert near.ekf.x[X] == pytest.approx(11.5, abs=0.1)


def test_looks_at_one_end_of_a_row_never_make_the_robot_surer_than_its_last_plant_is_there() -> (
    None
):
    for spacing_m in (0.15, 0.3):
        field = msgspec.structs.replace(FIELD, plant_spacing_m=spacing_m)
        robot = Robot(11.0, 3.0, 0.0, std_m=0.5, field=field)
        for _ in range(20):
            robot.see_picture(end_ahead_m=1.0, range_std_m=0.15)
        assert 0.3 * spacing_m < math.sqrt(robot.ekf.cov[X, X]) < spacing_m


@pytest.mark.parametrize("yaw_rad", [0.0, math.pi])
def test_rows_beside_their_map_are_told_from_a_robot_beside_its_place(yaw_rad: float) -> None:
    """Rows run East; they stand 6 cm South of the map, and GNSS knows the robot to a centimetre."""
    field = msgspec.structs.replace(FIELD, row_map_std_m=0.03)
    robot = Robot(5.0, 3.0, yaw_rad, std_m=0.01, field=field)
    for _ in range(300):
        robot.see(offset_m=0.06 * math.cos(yaw_rad))
        for state, value in ((X, 5.0), (Y, 3.0)):
            robot.ekf.update(((state, 1.0),), value - robot.ekf.x[state], 0.01**2)
    assert robot.ekf.x[Y] == pytest.approx(3.0, abs=0.015)
    assert robot.ekf.x[ROW_OFFSET] == pytest.approx(0.06, abs=0.03)
    east_m, north_m = robot.pose.rows_off_m
    assert east_m == pytest.approx(0.0, abs=1e-9)
    assert north_m == pytest.approx(-robot.ekf.x[ROW_OFFSET])


def test_rows_that_are_not_looked_at_stand_where_the_map_has_them() -> None:
    robot = Robot(5.0, 3.0, 0.0, field=msgspec.structs.replace(FIELD, row_map_std_m=0.03))
    assert robot.ekf.cov[ROW_OFFSET, ROW_OFFSET] == 0.0
    assert robot.pose.rows_off_m == (0.0, 0.0)


def test_numbers_that_are_none_and_times_that_run_back_are_refused() -> None:
    robot = Robot(5.0, 3.0, 0.0)
    robot.see(offset_m=math.nan)
    robot.see(end_ahead_m=math.inf)
    robot.see(offset_std_m=0.0)
    assert robot.rejected["row line not usable"] == 3
    robot.see()
    robot.ladder.update(msgspec.structs.replace(SEEN, t_s=0.1))
    assert robot.rejected["row line out of order"] == 1
    assert robot.ekf.x[ROW_BIAS] == pytest.approx(0.0, abs=1e-6)


def scene(t_s: float, line: RowLine | None) -> Scene:
    """A frame with a row line and a crop plant of quite another row."""
    plant = GroundPlant(
        x_body_m=1.0, y_body_m=0.1, plant=PlantClass.CROP, area_m2=0.05, confidence=0.9, std_m=0.02
    )
    view = ((0.4, -0.6), (2.0, -1.2), (2.0, 1.2), (0.4, 0.6))
    return Scene(
        t_s=t_s, ready_s=t_s, frame_index=0, plants=(plant,), view_body_m=view, row_line=line
    )


def std_after(spacing_m: float | None, times_s: list[float], *, drives: bool) -> float:
    """1 sigma across the rows (they run North) once frames with lines were seen."""
    field = FieldConfig(
        first_row_start_map_m=(0.0, -5.0), row_count=5, row_length_m=30.0,
        plant_spacing_m=spacing_m, start_map_m=(0.0, 0.0), start_yaw_deg=90.0, start_std_m=0.1,
        row_map_std_m=0.0,
    )  # fmt: skip
    motion = (lambda t_s: (0.4 if t_s > 4.0 else 0.0, 0.0)) if drives else stand
    recording = record(motion, 8.0, seed=1, errors=M8N, start=(0.0, 0.0, math.pi / 2.0))
    into = Localizer(EstimateConfig(), field, robot())
    lines = [scene(t_s, msgspec.structs.replace(SEEN, t_s=t_s)) for t_s in times_s]
    return math.sqrt(watch(into, recording, lines)[-1].pose_cov[0])


def test_a_robot_that_stands_learns_nothing_from_the_same_picture_again() -> None:
    once = std_after(0.25, [5.0], drives=False)
    often = std_after(0.25, [5.0 + 0.1 * i for i in range(25)], drives=False)
    assert often == pytest.approx(once, rel=0.02)
    moving = std_after(0.25, [5.0 + 0.1 * i for i in range(25)], drives=True)
    assert moving < 0.95 * once
