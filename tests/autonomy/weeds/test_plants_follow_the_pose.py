"""A plant that was seen lately is known from the robot: it follows the corrections of the pose."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.weeds.map import WeedMap
from agribot.core.config import WeedConfig
from agribot.core.implement.plants import Disc, GroundBox
from agribot.core.messages import MappedPlant
from agribot.core.pose import Pose2
from tests.autonomy.implements.looks import POSE, cover
from tests.autonomy.weeds.weed_field import make_estimate, make_plant, make_scene

TICK_S, SPEED_MPS = 0.02, 0.4
START = Pose2(2.0, -1.0, 0.4)
WEED_M = (1.6, 0.2)  # ahead and to the left of where the drive begins


def drive(weed_map: WeedMap, wander: Pose2, way_m: float) -> Pose2:
    """Drive straight on while the receiver wanders by `wander` and back; return the last pose."""
    ticks = round(way_m / SPEED_MPS / TICK_S)
    believed = START
    for tick in range(ticks + 1):
        t_s, driven_m = TICK_S * tick, SPEED_MPS * TICK_S * tick
        share = math.sin(math.tau * tick / ticks)
        off = Pose2(share * wander.x_m, share * wander.y_m, share * wander.yaw_rad)
        believed = START.compose(Pose2(driven_m, 0.0, 0.0)).compose(off)
        weed_map.track_pose(
            make_estimate(t_s, believed.x_m, believed.y_m, believed.yaw_rad, pos_std_m=0.3)
        )
        ahead_m = WEED_M[0] - driven_m
        if tick % 5 == 0 and 0.5 < ahead_m < 1.5:
            weed_map.add(make_scene(t_s, (make_plant(ahead_m, WEED_M[1], std_m=0.01),), view=()))
    return believed


def see_from(believed: Pose2, plant: MappedPlant) -> tuple[float, float]:
    return believed.locate(plant.x_map_m, plant.y_map_m)


@pytest.mark.parametrize(
    "wander",
    [Pose2(0.0, 0.0, 0.0), Pose2(0.1, -0.15, 0.0), Pose2(-0.1, 0.1, 0.05)],
    ids=["true", "aside", "turned"],
)
def test_a_plant_stands_at_the_tool_where_it_was_seen_however_the_receiver_wanders(
    wander: Pose2,
) -> None:
    weed_map = WeedMap(WeedConfig())
    believed = drive(weed_map, wander, way_m=1.904)
    (weed,) = weed_map.weeds()
    assert see_from(believed, weed) == pytest.approx((WEED_M[0] - 1.904, WEED_M[1]), abs=0.01)


def test_the_ground_under_leaves_follows_as_well() -> None:
    weed_map, leaf_m = WeedMap(WeedConfig()), (1.2, 0.3)

    def is_leaf(x_m: float, y_m: float) -> bool:
        return math.dist((x_m, y_m), leaf_m) < 0.1

    for look in range(3):
        weed_map.track_pose(make_estimate(TICK_S * look, 0.0, 0.0, 0.0, v_mps=0.0))
        scene = make_scene(TICK_S * look, (), view=())
        weed_map.add(msgspec.structs.replace(scene, crop_cover=cover(POSE, is_leaf)))
    weed_map.track_pose(make_estimate(0.06, 0.5, -0.4, 0.3, v_mps=0.0))
    now = Pose2(0.5, -0.4, 0.3)
    ground, there_m = weed_map.crop_ground, now.transform(*leaf_m)
    there, before = (
        GroundBox(place, 0.02, 0.02) for place in (Pose2(*there_m, 0.3), Pose2(*leaf_m, 0.0))
    )
    assert ground.covers(there)
    assert not ground.covers(there, known=[Disc(*there_m, 0.2)])
    assert ground.is_seen(there)
    assert not ground.covers(before)


def test_a_plant_that_the_robot_has_left_stands_where_the_poses_of_all_looks_had_it() -> None:
    """A receiver that errs to and fro is off by less in the mean of a pass than at its end."""
    weed_map, rng = WeedMap(WeedConfig()), np.random.default_rng(3)
    off_m = np.zeros(2)
    for tick in range(500):
        t_s, x_m = TICK_S * tick, SPEED_MPS * TICK_S * tick
        off_m = rng.normal(0.0, 0.02, 2) if tick % 5 == 0 else off_m
        weed_map.track_pose(make_estimate(t_s, x_m + off_m[0], off_m[1], 0.0))
        if tick % 5 == 0 and 0.5 < 1.6 - x_m < 1.5:
            weed_map.add(make_scene(t_s, (make_plant(1.6 - x_m, 0.2, std_m=0.02),), view=()))
    (weed,) = weed_map.weeds()
    assert (weed.x_map_m, weed.y_map_m) == pytest.approx((1.6, 0.2), abs=0.008)


def test_wheels_that_count_the_way_too_long_are_found_out_by_the_corrections() -> None:
    """Then plants stand where they were seen at the end of the way to the tool as well."""
    weed_map, factor = WeedMap(WeedConfig()), 1.02
    for tick in range(3000):
        t_s, x_m = TICK_S * tick, SPEED_MPS * TICK_S * tick
        weed_map.track_pose(make_estimate(t_s, x_m, 0.0, 0.0, v_mps=SPEED_MPS * factor))
        ahead_m = 23.2 - x_m
        if tick % 5 == 0 and 0.5 < ahead_m < 0.7:
            weed_map.add(make_scene(t_s, (make_plant(ahead_m, 0.2, std_m=0.01),), view=()))
        if -0.36 < ahead_m < -0.35:
            (weed,) = weed_map.weeds()
            assert weed.x_map_m - x_m == pytest.approx(ahead_m, abs=0.006)  # 18 mm without


def test_a_plant_that_is_far_behind_stays_when_the_pose_is_corrected() -> None:
    weed_map = WeedMap(WeedConfig())
    believed = drive(weed_map, Pose2(0.0, 0.0, 0.0), way_m=3.2)
    before = [(weed.x_map_m, weed.y_map_m) for weed in weed_map.weeds()]
    weed_map.track_pose(make_estimate(8.02, believed.x_m + 0.3, believed.y_m, believed.yaw_rad))
    after = [(weed.x_map_m, weed.y_map_m) for weed in weed_map.weeds()]
    assert after == [pytest.approx(place_m, abs=1e-6) for place_m in before]


def test_on_a_later_pass_a_plant_stands_where_it_is_seen_then() -> None:
    """Between two passes a receiver that is off by decimetres has another error."""
    weed_map = WeedMap(WeedConfig())
    for pass_s, off_m in ((0.0, 0.0), (60.0, 0.1)):
        for look in range(12):
            t_s = pass_s + 0.1 * look
            weed_map.track_pose(make_estimate(t_s, off_m, 0.0, 0.0, v_mps=0.0, pos_std_m=0.3))
            weed_map.add(make_scene(t_s, (make_plant(1.0, 0.2, std_m=0.02),), view=()))
    (weed,) = weed_map.weeds()
    assert weed.sightings == 24
    assert (weed.x_map_m, weed.y_map_m) == pytest.approx((1.1, 0.2), abs=0.002)


def test_many_sightings_of_a_pass_are_worth_more_than_the_first_as_the_pose_grows_unsure() -> None:
    """A pose without corrections grows unsure; the nearest looks at a plant are the best still."""
    weed_map = WeedMap(WeedConfig())
    for look in range(30):
        t_s, is_far = 0.1 * look, look < 8
        weed_map.track_pose(
            make_estimate(t_s, 0.0, 0.0, 0.0, v_mps=0.0, pos_std_m=0.3 + 0.001 * look)
        )
        place = make_plant(0.9 if is_far else 1.0, 0.0, std_m=0.04 if is_far else 0.012)
        weed_map.add(make_scene(t_s, (place,), view=()))
    (weed,) = weed_map.weeds()
    assert weed.x_map_m == pytest.approx(1.0, abs=0.006)
