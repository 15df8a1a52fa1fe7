"""What the benchmark drives is the robot's own filter, mission and control law."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.description.loader import load_robot
from agribot.lab.bench.nav.batch.localizer import BatchLocalizer
from agribot.lab.bench.nav.driving import BatchDriving
from agribot.lab.bench.nav.missions import Sensors, hear
from agribot.lab.bench.nav.plant import RoverFleet
from agribot.lab.bench.nav.scenario import DT_S, TICK_STEPS, Receiver, Variant, scenario
from tests import nightly
from tests.lab.bench.single_robot import SingleRobot

SEEDS, FEW = (3, 4, 5, 1022), (3, 1022)
BRIEF_S, LONG_S = 22.0, 40.0  # a row and its turn, and more
TICK_S = TICK_STEPS * DT_S


@nightly.one_by_one(
    "which",
    [
        ("m8n", True, "hard", FEW, BRIEF_S),
        ("rtk", False, "hard", FEW, BRIEF_S),
        ("m8n", True, "hard", SEEDS, LONG_S),
        ("rtk", False, "hard", SEEDS, LONG_S),
        ("rtk-dual", True, "nominal", SEEDS, LONG_S),
    ],
    in_suite=2,
)
def test_each_robot_of_a_batch_estimates_and_drives_as_the_stack_does(
    which: tuple[Receiver, bool, Variant, Sequence[int], float],
) -> None:
    """The hard camera states less than half of its noise, which both have to learn."""
    receiver, vision, variant, seeds, driven_s = which
    what, robot = scenario(receiver, vision=vision, speed_mps=0.8, variant=variant), load_robot()
    if what.vision is not None and variant == "hard":
        camera = msgspec.structs.replace(what.vision, stated_ratio=0.4)
        what = msgspec.structs.replace(what, vision=camera)
    plant, sensors = RoverFleet(seeds, what.soil), Sensors(seeds, what, robot)
    localizer = BatchLocalizer(
        len(seeds), what.estimate(), what.field(), robot, is_corrected=what.gnss.is_corrected
    )
    driving = BatchDriving(len(seeds), what, robot)
    singles = [SingleRobot(i, what, robot, driving.path) for i in range(len(seeds))]
    for k in range(1, round(driven_s / DT_S)):
        plant.step(driving.follower.v_mps, driving.follower.yaw_rate_radps)
        sensors.step(k, plant)
        if k % TICK_STEPS:
            continue
        t_s = k * DT_S
        distance_m, turn_rad, readings = sensors.read(t_s)
        localizer.advance(t_s, distance_m, turn_rad / TICK_S)
        lines = hear(localizer, readings)
        driving.step(t_s, localizer.estimate())
        level_m = localizer.bound(t_s)
        for line in lines:
            localizer.observe_line(line)
        for i, single in enumerate(singles):
            command = single.tick(t_s, float(distance_m[i]), float(turn_rad[i]), readings)
            assert command.v_mps == pytest.approx(driving.follower.v_mps[i], abs=1e-8), t_s
            rate = driving.follower.yaw_rate_radps[i]
            assert command.yaw_rate_radps == pytest.approx(rate, abs=1e-7), t_s
    for i, single in enumerate(singles):
        told = single.localizer._estimate(t_s)
        if abs(math.sin(told.yaw_map_rad)) < 0.05:  # along the rows
            if what.gnss.is_corrected:  # the stack has the receiver's velocities in turns
                assert level_m[i] > 0.85 * told.across_protection_m
            else:
                assert level_m[i] == pytest.approx(told.across_protection_m, rel=0.15)
        state = np.array(single.localizer._ekf.x)
        np.testing.assert_allclose(localizer.ekf.x[:, i], state, rtol=0.0, atol=1e-9)
        cov = single.localizer._ekf.cov
        np.testing.assert_allclose(localizer.ekf.cov[:, :, i], cov, rtol=1e-6, atol=1e-9)
        assert single.mission.path is driving.path
    assert plant.x_m.min() > 5.0 or plant.y_m.min() > 0.5, "the robots should have driven"
    assert math.isfinite(float(localizer.ekf.cov.sum()))
