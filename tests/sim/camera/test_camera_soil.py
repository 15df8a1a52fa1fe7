"""What lies on the soil of a picture: residue, stones, wet patches and wheel tracks."""

from __future__ import annotations

import msgspec
import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.world import GroundTile, Soil
from agribot.sim.camera import CameraRenderer
from tests.sim.camera.camera_scenes import CAMERA, pose, world

BARE = world()


def _ground(soil: Soil, *, x_m: float = 0.0, up_m: float = 1.2) -> FloatArray:
    """Bare ground from straight above."""
    renderer = CameraRenderer(msgspec.structs.replace(BARE, soil=soil))
    view = pose(x_m, z_m=up_m, down_deg=90.0)
    return renderer.render(view, CAMERA, noise_seed=None).image_rgb.astype(float)


def test_residue_and_stones_lie_pale_on_the_soil_and_more_of_them_the_more_is_asked() -> None:
    bare = _ground(Soil())
    for litter in ("residue_ratio", "stones_ratio"):
        paler = [
            ((_ground(Soil(**{litter: ratio})) - bare).mean(axis=2) > 25.0).mean()
            for ratio in (0.3, 1.0)
        ]
        assert 0.002 < paler[0] < paler[1] < 0.5


def test_wet_ground_is_darker_in_patches_of_about_the_share_asked() -> None:
    def change(ratio: float) -> FloatArray:
        dry, wet = _ground(Soil(), up_m=12.0), _ground(Soil(wet_ratio=ratio), up_m=12.0)
        quotient: FloatArray = wet.sum(axis=2) / dry.sum(axis=2)
        return quotient

    patches = change(0.4)
    assert patches.min() < 0.65
    assert patches.max() > 0.97
    assert 0.2 < (patches < 0.8).mean() < 0.6
    assert change(1.0).max() < 0.65


def test_a_wheel_track_is_a_darker_strip_where_the_world_has_it() -> None:
    track = GroundTile(surface="track", x_min_m=-9.0, x_max_m=9.0, y_min_m=0.2, y_max_m=0.4)
    renderer = CameraRenderer(world(ground=(track,)))
    view = pose(z_m=1.2, down_deg=90.0)
    seen = renderer.render(view, CAMERA, noise_seed=None).image_rgb.astype(float).mean(axis=(0, 2))
    middle_px = (CAMERA.width_px - 1) / 2.0
    y_m = (middle_px - np.arange(CAMERA.width_px)) * 1.2 / CAMERA.focal_px
    strip, beside = (y_m > 0.22) & (y_m < 0.38), (y_m < 0.15) | (y_m > 0.45)
    assert seen[strip].mean() < 0.97 * seen[beside].mean()


def test_bare_soil_looks_as_it_always_did() -> None:
    assert np.array_equal(_ground(Soil()), _ground(Soil(residue_ratio=0.0)))
    assert not np.array_equal(_ground(Soil()), _ground(Soil(residue_ratio=0.5)))
