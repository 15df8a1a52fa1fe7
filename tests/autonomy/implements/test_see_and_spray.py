"""From noisy sightings to wet weeds, on one drive."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from agribot.autonomy.implements.treatment import Treatment
from agribot.core.config import TreatmentConfig
from agribot.core.messages import Scene
from tests import nightly
from tests.autonomy.implements.spray_ground import BOOM, Field, figure
from tests.autonomy.weeds.weed_field import (
    SPEED_MPS,
    TICK_S,
    TICKS_PER_FRAME,
    Eyes,
    Walk,
    drive,
    look,
    make_estimate,
    plant_strip,
)

LATENCY_S = 0.2


def see_and_spray(seed: int, eyes: Eyes) -> tuple[Walk, Field, Treatment]:
    """One pass; the pose error wanders, scenes arrive late, the spray falls at the true boom."""
    rng = np.random.default_rng(seed)
    weeds_m, crops_m = plant_strip(rng, weeds=25)
    weeds_m = weeds_m[np.abs(weeds_m[:, 1]) < 0.36]
    strip = Walk(weeds_m=weeds_m, crops_m=crops_m)
    plants = {f"weed{i}": (float(x), float(y)) for i, (x, y) in enumerate(weeds_m)}
    plants |= {f"crop{i}": (float(x), float(y)) for i, (x, y) in enumerate(crops_m)}
    ground, treatment = Field(plants=plants), Treatment(TreatmentConfig(), BOOM)
    std = np.array([eyes.pos_std_m, eyes.pos_std_m, eyes.yaw_std_rad])
    error = rng.normal(0.0, std)
    coming: deque[Scene] = deque()
    for tick, pose in enumerate(drive(back=False)):
        t_s = tick * TICK_S
        error += -error * TICK_S / 5.0 + rng.normal(0.0, std) * (2.0 * TICK_S / 5.0) ** 0.5
        x, y, yaw = pose + error
        estimate = make_estimate(
            t_s, x, y, yaw, pos_std_m=eyes.pos_std_m, yaw_std_rad=eyes.yaw_std_rad
        )
        strip.map.track_pose(estimate)
        if tick % TICKS_PER_FRAME == 0:
            coming.append(look(rng, t_s, pose, strip, eyes))
        while coming and coming[0].t_s + LATENCY_S <= t_s:
            strip.map.add(coming.popleft())
        command = treatment.step(estimate, strip.map, True)
        ground.step(t_s, (pose[0], pose[1], pose[2]), command.sections_on, SPEED_MPS * TICK_S)
    return strip, ground, treatment


@nightly.all_or_first("seeds", range(8), in_suite=3)
def test_a_drive_wets_nearly_every_weed_no_crop_and_little_ground(seeds: Sequence[int]) -> None:
    wet = weeds = crops_wet = 0
    agree = 0.0
    ratios = []
    for seed in seeds:
        strip, ground, treatment = see_and_spray(seed, Eyes())
        weeds += len(strip.weeds_m)
        wet += sum(name.startswith("weed") for name in ground.hit)
        crops_wet += sum(name.startswith("crop") for name in ground.hit)
        agree += figure(treatment, "plants treated as weeds")
        ratios.append(figure(treatment, "sprayed") / figure(treatment, "passed"))
        assert strip.map.scenes_dropped == 0
    assert wet >= 0.95 * weeds
    assert crops_wet == 0
    assert abs(agree - wet) <= 0.10 * weeds
    assert np.mean(ratios) < 0.05
