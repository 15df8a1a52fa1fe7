"""Stems at the edge of the picture, where the leaves may be those of a plant beyond it."""

from __future__ import annotations

import math

from agribot.autonomy.weeds.map import WeedMap
from agribot.core.config import WeedConfig
from agribot.core.messages import GroundPlant, PlantClass
from tests.autonomy.weeds.weed_field import make_estimate, make_scene

# Ground on which a plant is seen whole, body frame.
VIEW = ((0.6, -0.4), (1.4, -0.6), (1.4, 0.6), (0.6, 0.4))


def make_plant(x_body_m: float, seen_height_m: float | None) -> GroundPlant:
    return GroundPlant(
        x_body_m=x_body_m, y_body_m=0.0, plant=PlantClass.CROP, area_m2=0.01, confidence=0.9,
        std_m=0.01, seen_height_m=seen_height_m,
    )  # fmt: skip


def drive_by(ahead_m: float, seen_height_m: float | None, frames: range) -> WeedMap:
    """Drive 4 cm a frame past a plant that starts this far ahead; see it in these frames."""
    weed_map = WeedMap(WeedConfig())
    for index in range(frames.stop):
        t_s, way_m = 0.1 * index, 0.04 * index
        weed_map.track_pose(make_estimate(t_s, way_m, 0.0, 0.0))
        plant = make_plant(ahead_m - way_m, seen_height_m)
        weed_map.add(make_scene(t_s, (plant,) if index in frames else (), view=VIEW))
    return weed_map


def test_a_stem_that_comes_up_only_at_the_edge_of_the_picture_is_no_plant() -> None:
    weed_map = drive_by(0.58, 0.0, range(6))
    assert not weed_map.plants()


def test_a_stem_seen_whole_before_is_followed_to_the_edge() -> None:
    weed_map = drive_by(0.78, 0.0, range(10))
    (plant,) = weed_map.crops()
    assert plant.sightings == 10
    assert math.dist((plant.x_map_m, plant.y_map_m), (0.78, 0.0)) < 1e-6


def test_leaves_that_no_edge_cuts_start_a_plant_there_too() -> None:
    assert len(drive_by(0.58, None, range(6)).crops()) == 1
