"""The world of a run as the drawn conditions make it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from agribot.core.geo import wrap_rad
from agribot.core.messages import Row
from agribot.core.world import Light, Relief, SoilStrength, WorldSpec
from agribot.description.conditions import Conditions, Preset
from agribot.description.sowing import SEEDS, sow

# Light of a clear and of a clouded sky; the shares of sun and sky on level ground.
CLEAR, CLOUDED = Light(diffuse=0.85, ambient=0.45), Light(diffuse=0.12, ambient=0.9)


def alter_world(
    world: WorldSpec, rows: Sequence[Row], preset: Preset, drawn: Conditions, seed: int
) -> WorldSpec:
    """Return the world as the drawn conditions make it; `rows` are those of the map."""
    (x_m, y_m), (dx_m, dy_m) = world.spawn_xy_map_m, drawn.start_offset_m
    turn_rad = math.radians(drawn.start_turn_deg)
    friction = drawn.friction_ratio
    soil = {
        name: getattr(drawn, name)
        for name in ("residue_ratio", "stones_ratio")
        if getattr(drawn, name) is not None
    }
    if drawn.soil_class != "rigid":
        soil["wet_ratio"] = max(world.soil.wet_ratio, drawn.moisture_ratio**2)
    return msgspec.structs.replace(
        world,
        spawn_xy_map_m=(x_m + dx_m, y_m + dy_m),
        spawn_yaw_map_rad=wrap_rad(world.spawn_yaw_map_rad + turn_rad),
        friction_ratio=world.friction_ratio if friction is None else friction,
        light=_make_light(world.light, drawn),
        soil=msgspec.structs.replace(world.soil, **soil),
        strength=SoilStrength(soil_class=drawn.soil_class, moisture_ratio=drawn.moisture_ratio),
        relief=Relief(
            seed=seed % SEEDS,
            roughness_rms_m=drawn.roughness_rms_m,
            clods_per_m2=drawn.clods_per_m2,
            clod_height_m=drawn.clod_height_m,
            ridge_height_m=drawn.ridge_height_m,
            rows=tuple(drawn.find_true_row(row) for row in rows),
        ),
        plants=sow(world.plants, rows, preset, drawn, seed),
    )


def _make_light(own: Light, drawn: Conditions) -> Light:
    if drawn.sun_elevation_deg is None or drawn.sun_azimuth_deg is None:
        return own
    elevation_rad = math.radians(drawn.sun_elevation_deg)
    azimuth_rad = math.radians(drawn.sun_azimuth_deg)
    level = math.cos(elevation_rad)
    cloud = drawn.cloud_ratio
    return Light(
        to_sun=(level * math.cos(azimuth_rad), level * math.sin(azimuth_rad),
                math.sin(elevation_rad)),
        diffuse=(1.0 - cloud) * CLEAR.diffuse + cloud * CLOUDED.diffuse,
        ambient=(1.0 - cloud) * CLEAR.ambient + cloud * CLOUDED.ambient,
    )  # fmt: skip
