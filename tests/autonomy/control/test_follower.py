from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest
import shapely

from agribot.autonomy.control.follower import Follower, _Line
from agribot.autonomy.control.supervise import Supervisor
from agribot.autonomy.plan.coverage.area import Leg, LegKind
from agribot.autonomy.plan.coverage.drive import sample_legs
from agribot.autonomy.plan.coverage.turns import plan_three_point_turn
from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.ways.boustrophedon import plan_rows
from agribot.autonomy.plan.ways.curves import Segment, sample
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import ControlConfig, FieldConfig, MissionConfig, SafetyConfig
from agribot.core.facts import Fact
from agribot.core.messages import (
    STOP,
    ControlMission,
    DriveCommand,
    FloatArray,
    Goal,
    MissionState,
    MissionStatus,
    Path,
    RobotCommand,
)  # fmt: skip
from agribot.core.pose import Pose2
from tests import nightly
from tests.asking import ask
from tests.autonomy.control.kinematic_rover import TICK_S, Rover, Soil
from tests.autonomy.plan.paper_task import PaperTask
from tests.robot_parts import plain_rover

ROBOT = plain_rover()
START = (-2.0, 0.0, math.pi / 2)
TWO_ROWS = FieldConfig(row_count=2, row_length_m=4.0)
MISSION = MissionConfig()


class Drive:
    """One closed-loop mission; columns of `log`: cross-track, row, |curvature|, v, yaw rate."""

    def __init__(
        self, soil: Soil, seed: int = 0, control: ControlConfig | None = None,
        field: FieldConfig = TWO_ROWS, start: tuple[float, float, float] = START,
    ) -> None:  # fmt: skip
        rows = lay_rows(field)
        self.path = plan_rows(rows, start, ROBOT, MISSION)
        self.mission = Mission(PaperTask(lambda _: self.path, rows), MISSION)
        self.follower = Follower(control or ControlConfig(), ROBOT)
        self.supervisor = Supervisor(SafetyConfig(), ROBOT)
        self.rover = Rover(start, soil, np.random.default_rng(seed))
        self.reasons: set[Fact | None] = set()
        self.log: FloatArray = np.zeros((0, 5))

    def run(self, limit_s: float = 300.0) -> MissionStatus:
        lines = []
        while self.rover.t_s < limit_s:
            estimate, batch = self.rover.estimate(), self.rover.batch()
            goal = self.mission.step(estimate)
            drive, tracking = self.follower.step(estimate, goal)
            wanted = RobotCommand(t_s=batch.t_s, drive=drive)
            sent, reason = self.supervisor.check(wanted, estimate, batch, goal)
            self.reasons.add(reason)
            index = int(np.searchsorted(self.path.s_m, goal.s_m))
            lines.append(
                (
                    tracking.cross_track_m if tracking else 0.0, self.path.row[index],
                    abs(self.path.curvature_radpm[index]), sent.drive.v_mps,
                    sent.drive.yaw_rate_radps,
                )
            )  # fmt: skip
            if goal.status.state in ("done", "failed"):
                break
            self.rover.drive(sent.drive)
        self.log = np.array(lines)
        return goal.status

    def p95_m(self) -> float:
        return float(np.quantile(np.abs(self.log[:, 0]), 0.95))


@nightly.all_or_first("seeds", range(20), in_suite=3)
def test_any_soil_is_driven_within_three_centimetres(seeds: Sequence[int]) -> None:
    for seed in seeds:
        drive = Drive(Soil.of_seed(np.random.default_rng(seed)), seed)
        status = drive.run()
        assert status.state == "done", f"seed {seed}: {status.reason}"
        assert status.rows_done == (0, 1)
        assert drive.p95_m() <= 0.03, f"seed {seed}"
        assert drive.reasons == {None}


@nightly.all_or_first("seeds", range(5), in_suite=2)
def test_delay_compensation_halves_the_error_of_the_turns(seeds: Sequence[int]) -> None:
    blind = ControlConfig(delay_s=0.0)
    with_s: list[float] = []
    without_s: list[float] = []
    for seed in seeds:
        soil = Soil.of_seed(np.random.default_rng(seed))
        for control, results in ((ControlConfig(), with_s), (blind, without_s)):
            drive = Drive(soil, seed, control)
            assert drive.run().state == "done"
            results.append(drive.p95_m())
    assert np.mean(with_s) < 0.6 * np.mean(without_s)


@pytest.mark.parametrize("yaw_gain_ratio", [0.65, 1.3])
def test_soil_that_turns_the_robot_far_too_little_or_much_is_learned(yaw_gain_ratio: float) -> None:
    drive = Drive(Soil(yaw_gain_ratio=yaw_gain_ratio))
    assert drive.run().state == "done"
    assert drive.p95_m() <= 0.03


def test_a_turn_in_which_the_ground_holds_the_inner_wheels_is_finished() -> None:
    drive = Drive(Soil(held_from_y_m=TWO_ROWS.row_length_m + 0.3))
    assert drive.run().state == "done"
    in_turn = drive.log[drive.log[:, 2] > 0.0]
    on_spot = (np.abs(in_turn[:, 3]) < 0.05) & (np.abs(in_turn[:, 4]) > 0.3)
    assert on_spot.sum() > 20, "it breaks loose by turning on the spot"
    assert np.abs(drive.log[drive.log[:, 1] >= 0, 0]).max() < 0.03, "and its rows are driven well"
    assert np.abs(in_turn[:, 0]).max() < 0.3


def test_a_robot_that_does_not_turn_on_the_spot_either_is_left_to_the_gate() -> None:
    """Its motors try once, not for ever: afterwards they pull along the path as before."""
    follower, path = Follower(ControlConfig(), ROBOT), circle_left()
    held = Rover((0.0, 0.0, 0.0), Soil(), np.random.default_rng(0)).estimate()
    commands = []
    for tick in range(500):
        there = msgspec.structs.replace(held, t_s=tick * TICK_S)
        commands.append(follower.step(there, goal_on(path, 0.0))[0])
    on_spot = [abs(c.v_mps) < 1e-6 and c.yaw_rate_radps > 0.3 for c in commands]
    assert 1.0 <= sum(on_spot) * TICK_S <= 2.0
    assert not any(on_spot[250:])
    assert commands[-1].v_mps > 0.1


def test_in_a_row_no_robot_turns_on_the_spot_to_break_loose() -> None:
    follower = Follower(ControlConfig(), ROBOT)
    path = msgspec.structs.replace(circle_left(), row=np.zeros(len(circle_left().s_m), dtype=int))
    held = Rover((0.0, 0.0, 0.0), Soil(), np.random.default_rng(0)).estimate()
    for tick in range(100):
        there = msgspec.structs.replace(held, t_s=tick * TICK_S)
        command, _ = follower.step(there, goal_on(path, 0.0))
        assert command.v_mps > 0.0


def test_a_piece_that_a_row_cut_short_is_not_taken_up_behind_it() -> None:
    follower, path = Follower(ControlConfig(), ROBOT), circle_left()
    path = msgspec.structs.replace(path, row=np.where(path.s_m > 1.0, 0, -1))
    held = Rover((0.0, 0.0, 0.0), Soil(), np.random.default_rng(0)).estimate()

    def drive(from_tick: int, ticks: int, s_m: float) -> DriveCommand:
        for tick in range(from_tick, from_tick + ticks):
            there = msgspec.structs.replace(held, t_s=tick * TICK_S)
            command, _ = follower.step(there, goal_on(path, s_m))
        return command

    assert drive(0, 60, 0.0).v_mps < 0.01, "it turns on the spot"
    assert drive(60, 20, 1.5).v_mps > 0.05, "in the row it drives"
    before = drive(80, 1, 1.5).v_mps
    assert drive(81, 5, 0.0).v_mps >= before


def test_crabbing_across_a_slope_leaves_no_offset_in_the_row() -> None:
    drive = Drive(Soil(crab_rad=math.radians(3.0)))
    drive.run()
    inside = drive.log[drive.log[:, 1] >= 0, 0]
    assert abs(float(np.mean(inside))) < 0.005


def test_whole_farm_is_driven_and_stops_at_the_end_of_the_path() -> None:
    drive = Drive(Soil.of_seed(np.random.default_rng(5)), field=FieldConfig())
    status = drive.run()
    assert status.rows_done == (0, 1, 2, 3, 4, 5)
    for _ in range(50):
        drive.rover.drive(STOP)
    end = drive.path.xy_map_m[-1]
    assert math.dist((drive.rover.x_m, drive.rover.y_m), end) < 0.05


def test_south_is_driven_as_well_as_north() -> None:
    worst_m = {}
    for yaw_deg in (90.0, -90.0, 180.0):
        field = FieldConfig(
            first_row_start_map_m=(0.0, 0.0), row_yaw_deg=yaw_deg, row_count=1, row_length_m=8.0
        )
        drive = Drive(Soil(yaw_gain_ratio=0.95), field=field, start=_behind(yaw_deg, 2.0))
        assert drive.run().state == "done"
        worst_m[yaw_deg] = float(np.abs(drive.log[:, 0]).max())
    assert max(worst_m.values()) - min(worst_m.values()) < 1e-6


def _behind(yaw_deg: float, distance_m: float) -> tuple[float, float, float]:
    yaw = math.radians(yaw_deg)
    return -distance_m * math.cos(yaw), -distance_m * math.sin(yaw), yaw


def test_commands_never_jump_by_more_than_the_drive_can_follow() -> None:
    drive = Drive(Soil.of_seed(np.random.default_rng(1)), 1)
    drive.run()
    before_end = drive.log[:-1]
    limit_mps = ROBOT.drive.max_accel_mps2 * TICK_S
    limit_radps = ROBOT.drive.max_yaw_accel_radps2 * TICK_S
    assert np.abs(np.diff(before_end[:, 3])).max() <= limit_mps * 1.001
    assert np.abs(np.diff(before_end[:, 4])).max() <= limit_radps * 1.001


def test_turns_are_driven_at_turn_speed() -> None:
    drive = Drive(Soil())
    drive.run()
    speed = drive.log[drive.log[:, 2] > 0.0, 3]
    assert speed.max() <= MISSION.turn_speed_mps + 1e-9


def straight_north(length_m: float = 20.0) -> Path:
    return sample(Pose2(0.0, 0.0, math.pi / 2), (Segment(length_m, 0.0),))


def circle_left() -> Path:
    return sample(Pose2(0.0, 0.0, 0.0), (Segment(2.0, 1.0 / 0.6),))


def goal_on(path: Path, s_m: float, state: MissionState = "running", speed: float = 0.4) -> Goal:
    status = MissionStatus(
        state=state, reason="", row=-1, rows_total=0, rows_done=(), s_m=s_m, length_m=20.0,
        waypoints_total=0, waypoints_reached=0,
    )  # fmt: skip
    return Goal(path=path, s_m=s_m, max_speed_mps=speed, tool_on=False, status=status)


def converge(beside_m: float, turned_rad: float) -> tuple[list[DriveCommand], Rover]:
    follower, path = Follower(ControlConfig(), ROBOT), straight_north()
    rover = Rover((beside_m, 5.0, math.pi / 2 + turned_rad), Soil(), np.random.default_rng(0))
    commands = []
    for _ in range(1000):
        command, _ = follower.step(rover.estimate(), goal_on(path, rover.y_m))
        commands.append(command)
        rover.drive(command)
    return commands, rover


@pytest.mark.parametrize("beside_m", [0.4, -0.4])
def test_a_robot_beside_its_line_comes_back_from_either_side(beside_m: float) -> None:
    commands, rover = converge(beside_m, 0.0)
    assert abs(rover.x_m) < 0.005
    assert commands[30].v_mps < 0.3


@pytest.mark.parametrize("turned_deg", [170.0, -120.0, 60.0])
def test_a_robot_that_looks_away_turns_on_the_spot_first(turned_deg: float) -> None:
    commands, rover = converge(0.0, math.radians(turned_deg))
    turning = next(command for command in commands if command.yaw_rate_radps != 0.0)
    assert turning.v_mps == 0.0
    assert math.copysign(1.0, turning.yaw_rate_radps) == -math.copysign(1.0, turned_deg)
    assert abs(math.remainder(rover.yaw_rad - math.pi / 2, math.tau)) < 0.02
    assert abs(rover.x_m) < 0.02


def test_tracking_tells_which_side_the_robot_is_on() -> None:
    follower, path = Follower(ControlConfig(), ROBOT), straight_north()
    west = Rover((-0.1, 5.0, math.pi / 2 + 0.2), Soil(), np.random.default_rng(0)).estimate()
    _, tracking = follower.step(west, goal_on(path, 5.0))
    assert tracking is not None
    assert tracking.cross_track_m == pytest.approx(0.1)
    assert tracking.heading_error_rad == pytest.approx(0.2)


def test_cross_track_is_right_on_an_arc_even_if_the_progress_lags() -> None:
    path = sample(Pose2(0.0, 0.0, 0.0), (Segment(math.pi * 0.5, 2.0),))
    follower = Follower(ControlConfig(), ROBOT)
    inside = Rover((0.45, 0.5, math.pi / 2), Soil(), np.random.default_rng(0)).estimate()
    _, tracking = follower.step(inside, goal_on(path, math.pi * 0.25 - 0.2))
    assert tracking is not None
    assert tracking.cross_track_m == pytest.approx(0.05, abs=1e-3)
    assert tracking.heading_error_rad == pytest.approx(0.0, abs=0.03)


def test_pause_ramps_the_robot_down_and_finished_missions_stop_at_once() -> None:
    follower, path = Follower(ControlConfig(), ROBOT), straight_north()
    rover = Rover((0.0, 5.0, math.pi / 2), Soil(), np.random.default_rng(0))
    for _ in range(100):
        rover.drive(follower.step(rover.estimate(), goal_on(path, rover.y_m))[0])
    paused = [
        follower.step(rover.estimate(), goal_on(path, rover.y_m, "paused", 0.0), TICK_S)[0].v_mps
        for _ in range(20)
    ]
    assert 0.3 < paused[0] < 0.4
    assert paused[-1] == 0.0
    for state in ("waiting", "done", "cancelled", "failed"):
        assert follower.step(rover.estimate(), goal_on(path, 5.0, state))[0] == STOP


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("column", ["x_map_m", "yaw_map_rad", "v_mps", "slip_rad"])
def test_a_pose_that_is_no_number_stops_the_robot(column: str, value: float) -> None:
    follower = Follower(ControlConfig(), ROBOT)
    rover = Rover((0.0, 5.0, math.pi / 2), Soil(), np.random.default_rng(0))
    estimate = msgspec.structs.replace(rover.estimate(), **{column: value})
    command, tracking = follower.step(estimate, goal_on(straight_north(), 5.0))
    assert command == STOP
    assert tracking is None


def test_paused_and_resumed_drive_continues_at_the_same_place() -> None:
    drive = Drive(Soil())
    drive.run(limit_s=12.0)
    event = ask(ControlMission(action="pause"), t_s=drive.rover.t_s)
    held = drive.mission.step(drive.rover.estimate(), (event,)).s_m
    drive.run(limit_s=16.0)
    resume = ask(ControlMission(action="resume"), t_s=drive.rover.t_s)
    resumed = drive.mission.step(drive.rover.estimate(), (resume,))
    assert resumed.status.state == "running"
    braking_m = 0.15
    assert held <= resumed.s_m <= held + braking_m
    assert drive.run().state == "done"


def test_without_a_path_the_robot_stands() -> None:
    rover = Rover((0.0, 5.0, 0.0), Soil(), np.random.default_rng(0))
    goal = msgspec.structs.replace(goal_on(straight_north(), 0.0), path=None)
    assert Follower(ControlConfig(), ROBOT).step(rover.estimate(), goal) == (STOP, None)


@pytest.mark.parametrize("tracked_x_m", [0.0, -0.35])
def test_on_a_slope_the_tracked_point_is_on_the_line(tracked_x_m: float) -> None:
    """The robot crabs by 4 degrees; what is steered is the tool, not the middle of the body."""
    rover = Rover(
        (0.0, 0.0, math.pi / 2), Soil(crab_rad=math.radians(4.0)), np.random.default_rng(0)
    )
    path = sample(Pose2(0.0, 0.0, math.pi / 2), [Segment(12.0, 0.0)])
    status = MissionStatus(state="running", reason="", row=0, rows_total=1, rows_done=(), s_m=0.0,
                           length_m=12.0, waypoints_total=0, waypoints_reached=0)  # fmt: skip
    follower = Follower(ControlConfig(), ROBOT)
    told = []
    while rover.y_m < 11.0:
        goal = Goal(path=path, s_m=max(rover.y_m, 0.0), max_speed_mps=0.4, tool_on=True,
                    status=status, tracked_x_m=tracked_x_m)  # fmt: skip
        command, tracking = follower.step(rover.estimate(), goal)
        rover.drive(command)
        told.append(tracking.cross_track_m if tracking else math.nan)
    tool_x_m = rover.x_m + tracked_x_m * math.cos(rover.yaw_rad)
    assert tool_x_m == pytest.approx(0.0, abs=0.004)
    assert told[-1] == pytest.approx(0.0, abs=0.004)
    assert abs(rover.x_m) == pytest.approx(abs(tracked_x_m) * math.radians(4.0), abs=0.004)


class Way:
    """A path driven with the mission's own progress and speed; columns of `log`: x, y, yaw, v."""

    def __init__(self, path: Path, soil: Soil) -> None:
        self.rover = Rover((0.0, 0.0, 0.0), soil, np.random.default_rng(1))
        self.mission = Mission(PaperTask(lambda _: path), MISSION)
        self.follower = Follower(ControlConfig(), ROBOT)
        self.log: FloatArray = np.zeros((0, 4))

    def run(self, limit_s: float = 120.0) -> MissionStatus:
        lines, rover = [], self.rover
        while rover.t_s < limit_s:
            goal = self.mission.step(rover.estimate())
            command, _ = self.follower.step(rover.estimate(), goal)
            rover.drive(command)
            lines.append((rover.x_m, rover.y_m, rover.yaw_rad, rover.v_mps))
            if goal.status.state in ("done", "failed"):
                break
        self.log = np.array(lines)
        return goal.status


def leg_path(*legs: tuple[LegKind, FloatArray]) -> Path:
    return sample_legs([Leg(kind=kind, xy_map_m=xy) for kind, xy in legs], [None] * len(legs))


@pytest.mark.parametrize("seed", range(6))
def test_a_three_point_turn_is_driven_forwards_back_and_forwards(seed: int) -> None:
    way = plan_three_point_turn(
        Pose2(2.0, 0.0, 0.0), Pose2(2.0, 0.6, math.pi), shapely.box(-9, -9, 9, 9)
    )
    assert way is not None
    into, back, out = way
    path = leg_path(
        ("arc", np.array([(0.0, 0.0), (2.0, 0.0)])), ("arc", into), ("reverse", back),
        ("arc", out), ("arc", np.array([(2.0, 0.6), (0.0, 0.6)])),
    )  # fmt: skip
    drive = Way(path, Soil.of_seed(np.random.default_rng(seed)))
    assert drive.run().state == "done"
    line = shapely.LineString(path.xy_map_m)
    assert float(np.max(shapely.distance(line, shapely.points(drive.log[:, :2])))) < 0.05
    moving = drive.log[np.abs(drive.log[:, 3]) > 0.02, 3]
    signs = np.sign(moving)
    assert np.count_nonzero(np.diff(signs)) == 2  # forwards, back, forwards
    assert math.cos(drive.rover.yaw_rad) == pytest.approx(-1.0, abs=0.01)


@pytest.mark.parametrize("bend_deg", [15.0, 30.0, 45.0, 80.0, 150.0])
def test_at_a_corner_of_any_angle_the_robot_turns_in_place_and_stays_on_its_line(
    bend_deg: float,
) -> None:
    bend_rad = math.radians(bend_deg)
    corner, end = (2.0, 0.0), (2.0 + 2.0 * math.cos(bend_rad), 2.0 * math.sin(bend_rad))
    path = leg_path(("link", np.array([(0.0, 0.0), corner, end])))
    drive = Way(path, Soil())
    assert drive.run().state == "done"
    line = shapely.LineString(path.xy_map_m)
    assert float(np.max(shapely.distance(line, shapely.points(drive.log[:, :2])))) < 0.04


def test_behind_a_corner_the_robot_looks_at_the_way_ahead_however_far_off_it_stopped() -> None:
    """Beside the corner the nearest point may be one of the way that it has come: that is over."""
    path = leg_path(("link", np.array([(0.0, 0.0), (2.0, 0.0), (2.0, -2.0)])))
    line = _Line(path)
    for left_m in (-0.05, 0.0, 0.05):
        for short_m in (-0.05, 0.0, 0.05):
            seen = line.errors(2.0, 2.0 - short_m, left_m, 0.0)
            assert seen.heading_rad == pytest.approx(math.pi / 2.0)
            assert seen.cross_track_m == pytest.approx(-short_m)
