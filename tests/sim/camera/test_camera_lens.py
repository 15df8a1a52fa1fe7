"""Lens distortion and exposure of the simulated camera."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from agribot.core.errors import DescriptionError
from agribot.core.messages import FloatArray
from agribot.core.world import Light
from agribot.sim.camera import Appearance, CameraRenderer
from tests.sim.camera.camera_scenes import CAMERA, mixed_field, obstacle, plant, pose, world

K1, K2, P1, P2 = -0.22, 0.04, 0.006, -0.004
BENT = msgspec.structs.replace(CAMERA, distortion=(K1, K2, P1, P2))


def _seen_at(p_map_m: FloatArray, map_from_camera: FloatArray) -> FloatArray:
    """Column and row of a point of the map by the published formula."""
    x, y, z = (np.linalg.inv(map_from_camera) @ np.append(p_map_m, 1.0))[:3]
    x, y = x / z, y / z
    r2 = x**2 + y**2
    radial = 1 + K1 * r2 + K2 * r2**2
    bent_x = x * radial + 2 * P1 * x * y + P2 * (r2 + 2 * x**2)
    bent_y = y * radial + P1 * (r2 + 2 * y**2) + 2 * P2 * x * y
    matrix = CAMERA.matrix()
    return np.array([matrix[0, 0] * bent_x + matrix[0, 2], matrix[1, 1] * bent_y + matrix[1, 2]])


@pytest.mark.parametrize("place_m", [(0.0, 0.0), (1.0, 0.7), (-0.9, 0.8), (0.75, -1.3)])
def test_a_ball_appears_where_the_formula_of_the_distortion_puts_it(
    place_m: tuple[float, float],
) -> None:
    view = pose(z_m=1.5, down_deg=90.0)
    ball = obstacle("sphere", (0.03, 0.0, 0.0), *place_m, 0.03)
    renderer = CameraRenderer(world(obstacles=(ball,)))
    drawn = renderer.render(view, BENT, noise_seed=None, supersample=3)
    rows, columns = np.nonzero(drawn.depth_m < 1.499)
    expected = _seen_at(np.array([*place_m, 0.03]), view)
    assert len(rows) > 20
    assert np.hypot(columns.mean() - expected[0], rows.mean() - expected[1]) < 0.7
    pinhole = renderer.render(view, CAMERA, noise_seed=None, supersample=3)
    straight = np.argwhere(pinhole.depth_m < 1.499)
    if place_m != (0.0, 0.0):  # in the corners a pinhole would show it elsewhere or not at all
        shift_px = np.hypot(*(straight.mean(axis=0)[::-1] - expected)) if len(straight) else np.inf
        assert shift_px > 5.0


def test_labels_bend_with_the_picture() -> None:
    field = mixed_field(np.random.default_rng(5), 60)
    drawn = CameraRenderer(field).render(pose(), BENT, noise_seed=None)
    green = drawn.image_rgb[..., 1].astype(int) - drawn.image_rgb[..., 0]
    is_plant = drawn.instance >= 0
    assert green[is_plant].mean() > green[~is_plant].mean() + 25
    classes = np.array([int(p.plant) for p in field.plants])
    np.testing.assert_array_equal(drawn.class_id[is_plant], classes[drawn.instance[is_plant]])


def test_a_distorted_picture_is_bit_identical_for_any_number_of_threads() -> None:
    field = mixed_field(np.random.default_rng(2), 40)
    look = Appearance(auto_exposure_level=110.0)
    one, three = (
        CameraRenderer(field, threads=n, appearance=look).render(pose(), BENT, noise_seed=4)
        for n in (1, 3)
    )
    np.testing.assert_array_equal(one.image_rgb, three.image_rgb)
    np.testing.assert_array_equal(one.depth_m, three.depth_m)


def test_a_distortion_that_folds_the_picture_is_refused() -> None:
    camera = msgspec.structs.replace(CAMERA, distortion=(-0.9, 0.0, 0.0, 0.0))
    with pytest.raises(DescriptionError, match="use smaller coefficients"):
        CameraRenderer(world()).render(pose(), camera, noise_seed=None)


@pytest.mark.parametrize("diffuse", [0.2, 0.7, 1.1])
def test_automatic_exposure_reaches_its_level_in_any_light(diffuse: float) -> None:
    light = Light(diffuse=diffuse, ambient=0.2)
    look = Appearance(auto_exposure_level=105.0)
    renderer = CameraRenderer(world(plant(0.9, 0.0), light=light), appearance=look)
    drawn = renderer.render(pose(), CAMERA, noise_seed=None)
    assert drawn.image_rgb.mean() == pytest.approx(105.0, abs=2.0)
