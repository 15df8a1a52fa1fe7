"""Random fields on the ground and in the light of the condition presets, and a robot on it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.core.geo import transform
from agribot.core.messages import FloatArray, Row
from agribot.core.robot import DriveSpec
from agribot.core.world import WorldSpec
from agribot.description.altered_world import alter_world
from agribot.description.conditions import draw_conditions, load_condition_preset
from agribot.sim.ground_surface import GroundSurface
from agribot.sim.random_scenes import Variety

PRESETS, PRESET_SHARE = ("field", "hard"), (0.7, 0.3)
SEEDS = 2**31
# Share of the rough fields with wheel tracks along the rows; depth, gauge and width of these.
TRACKED_SHARE = 0.3
TRACK_DEPTH_M, TRACK_GAUGE_M, TRACK_WIDTH_M = (0.005, 0.03), (0.5, 0.9), (0.1, 0.25)


def roughen(
    world: WorldSpec, rows: Sequence[Row], variety: Variety, rng: np.random.Generator
) -> WorldSpec:
    """Give a share of the worlds what a preset draws; the others stay as they are.

    That is relief, with ridges under `rows`, litter and moisture, light, growth and the errors
    of sowing; along `rows` some have wheel tracks as well.
    """
    if not variety.rough_share:
        return world
    is_rough, seed = rng.random() < variety.rough_share, int(rng.integers(SEEDS))
    preset = load_condition_preset(str(rng.choice(PRESETS, p=PRESET_SHARE)))
    if not is_rough:
        return world
    rough = alter_world(world, rows, preset, draw_conditions(preset, seed, rows), seed)
    if not rows or rng.random() >= TRACKED_SHARE:
        return rough
    relief = msgspec.structs.replace(
        rough.relief,
        track_depth_m=float(rng.uniform(*TRACK_DEPTH_M)),
        track_gauge_m=float(rng.uniform(*TRACK_GAUGE_M)),
        track_width_m=float(rng.uniform(*TRACK_WIDTH_M)),
    )
    return msgspec.structs.replace(rough, relief=relief)


def stand_on(ground: GroundSurface, map_from_body: FloatArray, drive: DriveSpec) -> FloatArray:
    """Put a level body (4, 4) on the ground: the plane that fits best below its four wheels."""
    ahead_m, left_m = drive.wheelbase_m / 2.0, drive.track_m / 2.0
    wheels = np.array([(x, y, 0.0, 1.0) for x in (ahead_m, -ahead_m) for y in (left_m, -left_m)])
    heights_m = ground.sample_heights(wheels @ map_from_body.T)
    front_left, front_right, rear_left, rear_right = heights_m.tolist()
    climb_m = (front_left + front_right - rear_left - rear_right) / 2.0
    lean_m = (front_left + rear_left - front_right - rear_right) / 2.0
    roll_rad, pitch_rad = math.atan2(lean_m, drive.track_m), -math.atan2(climb_m, drive.wheelbase_m)
    lifted: FloatArray = map_from_body @ transform(
        (0.0, 0.0, float(heights_m.mean())), (roll_rad, pitch_rad, 0.0)
    )
    return lifted
