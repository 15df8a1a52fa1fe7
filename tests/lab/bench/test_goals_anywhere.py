"""Goals at every bearing, in both hemispheres and across the antimeridian are reached."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.control.follower import Follower
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.plan.mission import Mission
from agribot.autonomy.plan.waypoints import plan_waypoints
from agribot.core.config import ControlConfig, EstimateConfig, FieldConfig, MissionConfig
from agribot.core.geo import Datum, MapFrame, wrap_rad
from agribot.core.messages import (
    GnssFix,
    GnssQuality,
    ImuSample,
    MagSample,
    SensorBatch,
    WheelSample,
)
from agribot.description.loader import load_robot
from agribot.lab.bench.nav.plant import Proprioception, RoverFleet
from agribot.lab.bench.nav.scenario import DT_S, TICK_STEPS, SoilDrift
from tests import nightly
from tests.autonomy.plan.paper_task import PaperTask

ROBOT = load_robot()
PLACES = {
    "India": (21.161289, 72.787022),
    "Chile": (-33.45, -70.66),
    "East of Fiji": (-17.8, 179.99999),
    "on the equator": (0.0, 0.0),
}


def final_distance_m(place: tuple[float, float], bearing_deg: float, seed: int) -> float:
    """The whole stack without camera drives 6 m along a bearing; how far from the goal it ends."""
    frame = MapFrame(Datum(lat_deg=place[0], lon_deg=place[1]))
    field = FieldConfig(datum=frame.datum)
    yaw_rad = math.radians(90.0 - bearing_deg)
    goal_m = (6.0 * math.cos(yaw_rad), 6.0 * math.sin(yaw_rad))
    mission_config = MissionConfig()
    localizer = Localizer(EstimateConfig(), field, ROBOT)
    task = PaperTask(
        lambda e: plan_waypoints(
            (goal_m,), (e.x_map_m, e.y_map_m, e.yaw_map_rad), ROBOT, mission_config
        ),
        waypoints=(goal_m,),
    )
    mission = Mission(task, mission_config)
    follower = Follower(ControlConfig(), ROBOT)
    plant, own = RoverFleet((seed,), SoilDrift()), Proprioception((seed,))
    plant.x_m[:], plant.y_m[:], plant.yaw_rad[:] = 0.0, 0.0, wrap_rad(yaw_rad + 0.4)
    normal = np.random.default_rng(seed).standard_normal
    lever_x, lever_y, lever_z = ROBOT.body_from_link(ROBOT.gnss.link)[:3, 3]
    v_mps = yaw_rate = angle = 0.0
    for k in range(round(90.0 / DT_S)):
        plant.step(np.full(1, v_mps), np.full(1, yaw_rate))
        wheel_mps, rate = own.read(plant)
        angle += float(wheel_mps[0]) * DT_S / ROBOT.drive.wheel_radius_m
        if k % TICK_STEPS:
            continue
        t_s, yaw = k * DT_S, float(plant.yaw_rad[0])
        mag: tuple[MagSample, ...] = ()
        gnss: tuple[GnssFix, ...] = ()
        if k % 20 == 0:
            north = math.pi / 2.0 - yaw + math.radians(1.5) * normal()
            mag = (MagSample(t_s=t_s, field_t=(math.cos(north), math.sin(north), -1.0)),)
        if k % 10 == 0:
            cos, sin = math.cos(yaw), math.sin(yaw)
            east = plant.x_m[0] + cos * lever_x - sin * lever_y + 0.008 * normal()
            north_m = plant.y_m[0] + sin * lever_x + cos * lever_y + 0.008 * normal()
            lat, lon, alt = frame.geodetic_from_map(east, north_m, lever_z)
            gnss = (
                GnssFix(
                    t_s=t_s, lat_deg=lat, lon_deg=lon, alt_m=alt, pos_std_m=0.014,
                    quality=GnssQuality.RTK_FIXED,
                ),
            )  # fmt: skip
        batch = SensorBatch(
            t_s=t_s,
            wheels=(WheelSample(t_s=t_s, angle_rad=(angle,) * 4, speed_radps=(0.0,) * 4),),
            imu=(
                ImuSample(
                    t_s=t_s, gyro_radps=(0.0, 0.0, float(rate[0])), accel_mps2=(0.0, 0.0, 9.8)
                ),
            ),
            mag=mag,
            gnss=gnss,
        )
        estimate = localizer.update(batch)
        goal = mission.step(estimate)
        command, _ = follower.step(estimate, goal)
        v_mps, yaw_rate = command.v_mps, command.yaw_rate_radps
        if goal.status.state in ("done", "failed"):
            assert goal.status.state == "done", goal.status.reason
            return math.dist((plant.x_m[0], plant.y_m[0]), goal_m)
    raise AssertionError("the goal was not reached in 90 s")


@nightly.one_by_one("bearing_deg", (45, 180, 270, 0, 90, 135, 225, 315), in_suite=3)
def test_a_goal_at_any_bearing_is_reached(bearing_deg: int) -> None:
    assert final_distance_m(PLACES["India"], bearing_deg, 1 + bearing_deg) < 0.15


@pytest.mark.parametrize("place", ["Chile", "East of Fiji", "on the equator"])
@nightly.one_by_one("bearing_deg", (90, 180), in_suite=1)
def test_a_goal_is_reached_in_either_hemisphere_and_across_the_antimeridian(
    place: str, bearing_deg: int
) -> None:
    assert final_distance_m(PLACES[place], bearing_deg, bearing_deg) < 0.15
