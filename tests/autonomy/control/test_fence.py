"""The edge of a field and its holes, for a robot that must be able to stop inside them."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
import shapely

from agribot.autonomy.control.fence import FieldFence, _Edges
from agribot.core.config import SafetyConfig
from agribot.core.facts import BeyondField, Fact, LeavesField, NearEdgeAndDoubted, NearEdgeAndUnsure
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import (
    STOP,
    DriveCommand,
    Estimate,
    GnssQuality,
    Goal,
    Path,
    RobotCommand,
)
from agribot.core.pose import Pose2
from tests.autonomy.control.kinematic_rover import TICK_S
from tests.autonomy.control.test_supervisor import ROBOT, Gate, assert_stopped, goal
from tests.autonomy.plan.planting import at
from tests.finding import is_like

FRONT_M, REAR_M, HALF_M = 0.5, 0.4, 0.45
OUTER = [(0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (12.0, 12.0), (0.0, 10.0)]
HOLE = [(8.0, 4.0), (8.3, 4.0), (8.3, 4.3), (8.0, 4.3)]
FIELD = FieldBounds(
    rings_map_m=(np.array(OUTER), np.array(HOLE)),
    front_m=FRONT_M, rear_m=REAR_M, half_width_m=HALF_M,
)  # fmt: skip
CONFIG = SafetyConfig()
AHEAD = DriveCommand(v_mps=0.4)
ACCEL_MPS2 = 1.5


def believed(x_m: float, y_m: float, yaw_rad: float = 0.0, std_m: float = 0.0) -> Estimate:
    var = std_m * std_m
    return msgspec.structs.replace(
        at(x_m, y_m, 0.0), yaw_map_rad=yaw_rad, pos_std_m=std_m,
        pose_cov=(var, 0.0, 0.0, 0.0, var, 0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip


def along(*xy_map_m: tuple[float, float]) -> Path:
    """Straight from place to place, every 2 cm."""
    places = np.array(xy_map_m)
    steps_m = np.hypot(*np.diff(places, axis=0).T)
    s_m = np.arange(0.0, steps_m.sum(), 0.02)
    at_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    xy = np.stack([np.interp(s_m, at_m, places[:, k]) for k in (0, 1)], axis=1)
    yaw = np.arctan2(*np.gradient(xy, axis=0).T[::-1])
    return Path(
        xy_map_m=xy, yaw_map_rad=yaw, curvature_radpm=np.zeros(len(xy)),
        row=np.full(len(xy), -1), s_m=s_m,
    )  # fmt: skip


class Fenced:
    """The fence of a robot that was inside before, at the middle of the field."""

    def __init__(self, path: Path | None = None, s_m: float = 0.0) -> None:
        self.goal: Goal = msgspec.structs.replace(goal("running"), path=path, s_m=s_m)
        self.fence = FieldFence(FIELD, CONFIG, ACCEL_MPS2)
        assert self(believed(5.0, 5.0)) is None

    def __call__(self, estimate: Estimate, drive: DriveCommand = AHEAD) -> Fact | None:
        return self.fence.objection(estimate, drive, self.goal)


def test_a_robot_that_knows_where_it_is_drives_along_the_very_edge() -> None:
    fence = Fenced()
    for x_m in np.arange(1.0, 19.0, 0.05):
        assert fence(believed(float(x_m), HALF_M, std_m=0.015)) is None
        assert fence(believed(float(x_m), HALF_M - 0.08, std_m=0.015)) is None, "off its way"


@pytest.mark.parametrize("v_mps", [0.1, 0.4, 1.0])
def test_it_is_stopped_so_early_that_it_comes_to_rest_inside(v_mps: float) -> None:
    fence, drive = Fenced(), DriveCommand(v_mps=v_mps)
    x_m = 15.0
    while not (objection := fence(believed(x_m, 5.0), drive)):
        x_m += 0.02 * v_mps
        assert x_m < 20.0
    assert is_like(objection, LeavesField(x_m, 5.0, is_by_hand=False))
    stops_m = x_m + 0.15 * v_mps + v_mps * v_mps / (2.0 * ACCEL_MPS2)
    assert 20.0 - 0.05 < stops_m + FRONT_M < 20.0 + CONFIG.fence_tolerance_m
    assert fence(believed(x_m, 5.0), DriveCommand(v_mps=-v_mps)) is None, "it may turn back"
    assert fence(believed(x_m - 2.0 * v_mps, 5.0), drive) is None


def test_a_hole_between_the_wheels_is_an_edge_too() -> None:
    fence = Fenced()
    assert is_like(fence(believed(8.15, 4.15), STOP), BeyondField(8.15, 4.15))
    assert isinstance(fence(believed(8.0 - FRONT_M + 0.05, 4.15)), LeavesField)
    assert fence(believed(8.15, 4.3 + HALF_M + 0.01)) is None


@pytest.mark.parametrize(("std_m", "is_held"), [(0.05, False), (0.3, True), (1.0, True)])
def test_near_the_edge_an_uncertain_position_holds_the_robot_and_says_why(
    std_m: float, is_held: bool
) -> None:
    fence = Fenced()
    objection = fence(believed(10.0, HALF_M + 0.05, std_m=std_m))
    assert bool(objection) is is_held
    if is_held:
        assert is_like(objection, NearEdgeAndUnsure(10.0, HALF_M + 0.05, std_m))
    assert fence(believed(5.0, 5.0, std_m=std_m)) is None, "far from every edge it may drive"


@pytest.mark.parametrize("quality", [GnssQuality.SINGLE, GnssQuality.DGNSS])
def test_without_carrier_corrections_nothing_of_the_uncertainty_is_forgiven(
    quality: GnssQuality,
) -> None:
    """Such errors last for minutes; those of RTK, as far as they are known, may pass the edge."""
    std_m, sigmas = 0.12, CONFIG.fence_single_sigma
    beside = replace_quality(believed(10.0, HALF_M + 0.9 * sigmas * std_m, std_m=std_m), quality)
    clear = replace_quality(believed(10.0, HALF_M + 1.1 * sigmas * std_m, std_m=std_m), quality)
    assert isinstance(Fenced()(beside), NearEdgeAndUnsure)
    assert Fenced()(clear) is None
    assert Fenced()(replace_quality(beside, GnssQuality.RTK_FIXED)) is None


@pytest.mark.parametrize(
    ("yaw_deg", "drive", "may"),
    [
        (90.0, AHEAD, True), (45.0, AHEAD, True), (-90.0, DriveCommand(v_mps=-0.4), True),
        (0.0, AHEAD, False), (15.0, AHEAD, False), (-90.0, AHEAD, False), (90.0, STOP, False),
    ],
)  # fmt: skip
def test_too_uncertain_for_where_it_is_the_robot_may_only_drive_away_from_the_edge(
    yaw_deg: float, drive: DriveCommand, may: bool
) -> None:
    """Otherwise a robot that is put down beside a field could never drive."""
    near = believed(10.0, 0.8, math.radians(yaw_deg), std_m=0.3)
    assert (Fenced()(replace_quality(near, GnssQuality.SINGLE), drive) is None) is may


def test_two_solutions_that_differ_do_not_even_let_it_drive_away() -> None:
    near = replace_quality(believed(10.0, 0.8, math.pi / 4.0, std_m=0.1), GnssQuality.SINGLE)
    assert Fenced()(near) is None
    assert isinstance(Fenced()(split(near, 0.6)), NearEdgeAndDoubted)


def split(estimate: Estimate, apart_m: float) -> Estimate:
    """Two solutions differ by `apart_m` to the side, and each is good to 0.1 m."""
    return msgspec.structs.replace(
        estimate, across_protection_m=apart_m + 0.1, across_plain_m=0.05, across_unknown_m=0.1
    )


def test_sensors_that_contradict_each_other_keep_the_robot_off_the_edge() -> None:
    beside = believed(10.0, HALF_M + 0.2, std_m=0.02)
    assert Fenced()(split(beside, 0.0)) is None
    assert Fenced()(split(beside, CONFIG.fence_unsure_m + 0.1)) is None
    told = Fenced()(split(beside, CONFIG.fence_unsure_m + 0.3))
    assert is_like(told, NearEdgeAndDoubted(10.0, HALF_M + 0.2, 0.7))
    single = replace_quality(believed(10.0, HALF_M + 0.5, std_m=0.02), GnssQuality.SINGLE)
    assert Fenced()(split(single, 0.4)) is None
    assert isinstance(Fenced()(split(single, 0.6)), NearEdgeAndDoubted)


def replace_quality(estimate: Estimate, quality: GnssQuality) -> Estimate:
    return msgspec.structs.replace(estimate, quality=quality)


def test_uncertain_along_its_way_only_it_may_drive_beside_an_edge() -> None:
    wide = msgspec.structs.replace(
        believed(10.0, HALF_M + 0.05), pose_cov=(1.0, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 0.0)
    )
    assert Fenced()(wide) is None
    assert Fenced()(msgspec.structs.replace(wide, pose_cov=(1e-4, 0, 0, 0, 1.0, 0, 0, 0, 0)))


def test_a_way_into_the_field_is_free_until_the_robot_is_inside() -> None:
    fence = FieldFence(FIELD, CONFIG, ACCEL_MPS2)
    way = msgspec.structs.replace(goal("running"), path=along((-3.0, 5.0), (5.0, 5.0)))
    for x_m in np.arange(-3.0, 3.0, 0.05):
        assert fence.objection(believed(float(x_m), 5.0, std_m=0.02), AHEAD, way) is None
    later = msgspec.structs.replace(way, s_m=7.0)
    assert fence.objection(believed(0.2, 5.0, math.pi), AHEAD, later), "now the edge counts"


def test_a_way_that_was_planned_out_of_the_field_may_be_driven() -> None:
    way = along((5.0, 5.0), (-3.0, 5.0))
    for x_m in np.arange(4.0, -3.0, -0.25):
        fence = Fenced(way, s_m=5.0 - float(x_m))
        assert fence(believed(float(x_m), 5.0, math.pi)) is None
    fence = Fenced(way, s_m=0.5)
    assert fence(believed(0.2, 5.0, math.pi)), "elsewhere than its way is"


def test_a_robot_that_jumps_over_the_edge_is_outside() -> None:
    fence = Fenced()
    assert is_like(fence(believed(5.0, -3.0), STOP), BeyondField(5.0, -3.0))
    assert fence(believed(5.0, 5.0)) is None
    for x_m in np.arange(19.0, 23.0, 0.02):  # carried over it by hand
        fence.fence._here.touch((float(x_m), 5.0, 0.0), (-0.1, 0.1, -0.1, 0.1))
    assert fence(believed(22.98, 5.0), STOP)


def test_the_rectangle_leaves_the_field_exactly_when_a_polygon_library_says_so() -> None:
    rng = np.random.default_rng(7)
    field = shapely.Polygon(OUTER, [HOLE])
    edges, answers = _Edges(FIELD), set()
    for _ in range(2000):
        x_m, y_m = (float(v) for v in rng.uniform((-1.0, -1.0), (21.0, 13.0)))
        yaw_rad, rear_m, front_m, side_m = (
            float(v) for v in rng.uniform((-4.0, 0.2, 0.2, 0.2), (4.0, 1.5, 1.5, 1.5))
        )
        corners = [(front_m, side_m), (front_m, -side_m), (-rear_m, -side_m), (-rear_m, side_m)]
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        body = [(x_m + cos * x - sin * y, y_m + sin * x + cos * y) for x, y in corners]
        expected = not field.covers(shapely.Polygon(body))
        assert edges.touch((x_m, y_m, yaw_rad), (-rear_m, front_m, -side_m, side_m)) is expected
        answers.add(expected)
    assert answers == {True, False}


def test_a_rectangle_is_as_far_from_the_edges_as_a_polygon_library_says() -> None:
    rng = np.random.default_rng(2)
    edges, box = _Edges(FIELD), (-REAR_M, FRONT_M, -HALF_M, HALF_M)
    rings = shapely.MultiLineString([shapely.LinearRing(OUTER), shapely.LinearRing(HOLE)])
    corners = [(FRONT_M, HALF_M), (-REAR_M, HALF_M), (-REAR_M, -HALF_M), (FRONT_M, -HALF_M)]
    for _ in range(300):
        pose = (rng.uniform(0.5, 19.5), rng.uniform(0.5, 11.0), rng.uniform(-4.0, 4.0))
        body = shapely.Polygon([Pose2(*pose).transform(*corner) for corner in corners])
        expected = 0.0 if edges.touch(pose, box) else body.distance(rings)
        assert edges.measure_distance_m(pose, box) == pytest.approx(expected, abs=1e-9)


def test_a_new_way_in_the_same_field_does_not_free_a_robot_that_is_over_the_edge() -> None:
    gate = Gate()
    first, second = along((5.0, 5.0), (19.0, 5.0)), along((8.15, 5.0), (15.0, 5.0))

    def send(
        estimate: Estimate, path: Path | None, s_m: float = 0.0
    ) -> tuple[RobotCommand, Fact | None]:
        gate.rover.t_s += TICK_S
        bounds = None if path is None else FIELD
        wanted = msgspec.structs.replace(goal("running"), bounds=bounds, path=path, s_m=s_m)
        batch = gate.rover.batch()
        estimate = msgspec.structs.replace(estimate, t_s=batch.t_s)
        sent, reason = gate.supervisor.check(gate.command(AHEAD), estimate, batch, wanted)
        gate.rover.turn_wheels(sent.drive)
        return sent, reason

    for _ in range(10):
        assert send(believed(5.0, 5.0), first)[1] is None
    over_the_hole = believed(8.15, 4.15)
    for path in (first, second, None, second):  # none while a way is planned
        for _ in range(40):
            sent, reason = send(over_the_hole, path)
            assert path is None or reason == BeyondField(8.15, 4.15)
            assert path is None or sent.drive == STOP
    back = along((19.75, 5.0), (5.0, 5.0))
    for _ in range(40):
        sent, reason = send(believed(19.75, 5.0, math.pi), back)
        assert reason is None, "a way back in that was planned from there is free"
    assert sent.drive == AHEAD


def test_the_supervisor_holds_the_mission_at_the_edge_and_lets_a_hand_bring_it_back() -> None:
    gate = Gate()
    inside, out = believed(5.0, 5.0), believed(19.9, 5.0)
    bounded = msgspec.structs.replace(goal("running"), bounds=FIELD, path=None)
    check = gate.supervisor.check
    gate.send(estimate=inside)

    def send(estimate: Estimate, *, is_by_hand: bool = False) -> tuple[RobotCommand, Fact | None]:
        gate.rover.t_s += 0.02
        batch = gate.rover.batch()
        command = msgspec.structs.replace(gate.command(AHEAD))
        sent, reason = check(command, estimate, batch, bounded, is_by_hand=is_by_hand)
        return sent, reason

    assert send(inside)[1] is None
    assert ROBOT.drive.max_accel_mps2 == ACCEL_MPS2
    sent, reason = send(out)
    assert_stopped(sent, reason, BeyondField(19.9, 5.0))
    assert send(out, is_by_hand=True)[1] is None
    assert send(inside)[1] is None, "nothing was latched"
