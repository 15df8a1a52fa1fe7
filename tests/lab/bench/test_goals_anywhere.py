"""Goals at every bearing, in both hemispheres and across the antimeridian are reached."""

from __future__ import annotations

import math

import pytest

from agribot.autonomy.control.follower import Follower
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.ways.waypoints import plan_waypoints
from agribot.core.config import (
    ControlConfig,
    EstimateConfig,
    FieldConfig,
    MissionConfig,
    RunConfig,
    SimConfig,
)
from agribot.core.geo import Datum, MapFrame, wrap_rad
from agribot.description.loader import load_robot
from agribot.lab.bench.nav.plant import SoilRover
from agribot.lab.bench.nav.scenario import DT_S, TICK_STEPS, SoilDrift
from agribot.lab.bench.nav.sensors import Sensors
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
    sensors = Sensors(RunConfig(seed=seed, sim=SimConfig(sensors="rtk"), field=field), ROBOT)
    rover = SoilRover(seed, SoilDrift())
    rover.x_m, rover.y_m, rover.yaw_rad = 0.0, 0.0, wrap_rad(yaw_rad + 0.4)
    v_mps = yaw_rate_radps = 0.0
    for k in range(1, round(90.0 / DT_S)):
        rover.step(v_mps, yaw_rate_radps)
        sensors.step(rover)
        if k % TICK_STEPS:
            continue
        estimate = localizer.update(sensors.read())
        goal = mission.step(estimate)
        command, _ = follower.step(estimate, goal)
        v_mps, yaw_rate_radps = command.v_mps, command.yaw_rate_radps
        if goal.status.state in ("done", "failed"):
            assert goal.status.state == "done", goal.status.reason
            return math.dist((rover.x_m, rover.y_m), goal_m)
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
