from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.ground import (
    GroundLookup,
    HorizonError,
    ground_to_pixels,
    pixels_to_ground,
)
from agribot.core.errors import PerceptionError
from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import FloatArray
from agribot.core.robot import CameraSpec
from tests.autonomy.perceive.drawn_field import BODY_FROM_CAMERA, CAMERA, GROUND


def area_of(polygon: tuple[tuple[float, float], ...]) -> float:
    """Signed area by the shoelace rule, positive when counter-clockwise."""
    x, y = np.array(polygon).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def test_right_in_the_image_is_right_of_the_robot() -> None:
    left, right = pixels_to_ground(
        np.array([[100.0, 240.0], [540.0, 240.0]]), CAMERA.matrix(), BODY_FROM_CAMERA
    )
    assert right[1] < 0.0 < left[1]


def test_up_in_the_image_is_farther_ahead() -> None:
    up, down = pixels_to_ground(
        np.array([[320.0, 100.0], [320.0, 400.0]]), CAMERA.matrix(), BODY_FROM_CAMERA
    )
    assert up[0] > down[0]


def test_the_optical_axis_meets_the_ground_where_trigonometry_says() -> None:
    centre = np.array([[319.5, 239.5]])
    (x_m, y_m) = pixels_to_ground(centre, CAMERA.matrix(), BODY_FROM_CAMERA)[0]
    assert x_m == pytest.approx(0.3 + 0.7 / math.tan(math.radians(50.0)), abs=1e-9)
    assert y_m == pytest.approx(0.0, abs=1e-9)


def test_the_edge_of_the_image_lies_at_half_the_field_of_view() -> None:
    down = transform((0.0, 0.0, 1.0), (0.0, math.pi / 2, 0.0)) @ LINK_FROM_OPTICAL
    # The image ends half a pixel outside the centre of its last column.
    edge = pixels_to_ground(np.array([[639.5, 239.5]]), CAMERA.matrix(), down)[0]
    assert edge[1] == pytest.approx(-math.tan(math.radians(40.0)), rel=1e-9)


def test_ground_points_survive_the_round_trip_through_a_rolled_camera() -> None:
    body_from_camera = (
        transform((0.2, -0.1, 0.6), (0.1, math.radians(45.0), -0.2)) @ LINK_FROM_OPTICAL
    )
    rng = np.random.default_rng(3)
    points_m = rng.uniform((0.5, -0.5), (1.5, 0.5), (200, 2))
    pixels = ground_to_pixels(points_m, CAMERA.matrix(), body_from_camera)
    back_m = pixels_to_ground(pixels, CAMERA.matrix(), body_from_camera)
    np.testing.assert_allclose(back_m, points_m, atol=1e-9)


def test_points_behind_the_camera_have_no_pixel() -> None:
    pixels = ground_to_pixels(np.array([[-5.0, 0.0]]), CAMERA.matrix(), BODY_FROM_CAMERA)
    assert np.isnan(pixels).all()


def test_a_pixel_above_the_horizon_is_refused() -> None:
    level = transform((0.0, 0.0, 0.5)) @ LINK_FROM_OPTICAL
    with pytest.raises(HorizonError, match="above the horizon"):
        pixels_to_ground(np.array([[320.0, 100.0]]), CAMERA.matrix(), level)


def test_a_level_camera_sees_ground_only_in_the_lower_half() -> None:
    level = transform((0.0, 0.0, 0.5)) @ LINK_FROM_OPTICAL
    ground = GroundLookup(CAMERA, level, (96, 128), max_range_m=3.0)
    assert np.isnan(ground.range_m[:48]).all()
    assert np.isfinite(ground.range_m[49:]).all()
    assert (ground.area_m2[:48] == 0.0).all()


def test_the_lookup_agrees_with_the_exact_projection() -> None:
    for row, column in ((100, 30), (250, 400), (383, 511)):
        pixel = np.array([[(column + 0.5) * 1.25 - 0.5, (row + 0.5) * 1.25 - 0.5]])
        x_m, y_m = pixels_to_ground(pixel, CAMERA.matrix(), BODY_FROM_CAMERA)[0]
        assert GROUND.x_body_m[row, column] == pytest.approx(x_m, abs=1e-5)
        assert GROUND.y_body_m[row, column] == pytest.approx(y_m, abs=1e-5)


def test_pixel_areas_add_up_to_the_ground_they_cover() -> None:
    down = transform((0.0, 0.0, 1.0), (0.0, math.pi / 2, 0.0)) @ LINK_FROM_OPTICAL
    ground = GroundLookup(CAMERA, down, (384, 512), max_range_m=5.0)
    width_m = 2.0 * math.tan(math.radians(40.0))
    assert float(ground.area_m2.sum()) == pytest.approx(width_m**2 * 480 / 640, rel=1e-3)


def test_the_view_is_counter_clockwise_ahead_and_within_range() -> None:
    corners = np.array(GROUND.view_body_m)
    assert area_of(GROUND.view_body_m) > 0.3
    assert len(corners) < 40
    assert (np.hypot(corners[:, 0] - 0.3, corners[:, 1]) <= GROUND.max_range_m).all()
    # The robot is symmetric, so its view is too.
    assert corners[:, 1].max() == pytest.approx(-corners[:, 1].min(), abs=0.02)


def test_a_camera_that_looks_up_says_what_to_do() -> None:
    up = transform((0.0, 0.0, 0.5), (0.0, math.radians(-60.0), 0.0)) @ LINK_FROM_OPTICAL
    with pytest.raises(PerceptionError, match="tilt it down"):
        GroundLookup(CAMERA, up, (96, 128), max_range_m=1.6)


def test_a_buried_camera_is_refused() -> None:
    buried = transform((0.0, 0.0, -0.1), (0.0, 1.0, 0.0)) @ LINK_FROM_OPTICAL
    with pytest.raises(PerceptionError, match="above"):
        GroundLookup(CAMERA, buried, (96, 128), max_range_m=1.6)


def _through_the_lens(points_body_m: FloatArray, camera: CameraSpec) -> FloatArray:
    """Pixels (N, 2) of ground points by the published formula of the lens."""
    k1, k2, p1, p2 = camera.distortion
    flat = np.column_stack(
        [points_body_m, np.zeros(len(points_body_m)), np.ones(len(points_body_m))]
    )
    x, y, z = (flat @ np.linalg.inv(BODY_FROM_CAMERA).T)[:, :3].T
    x, y = x / z, y / z
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2
    bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    bent_y = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.column_stack([bent_x, bent_y]) * camera.focal_px + camera.matrix()[:2, 2]


def test_the_ground_seen_through_a_bent_lens_is_where_it_is() -> None:
    bent = msgspec.structs.replace(CAMERA, distortion=(-0.22, 0.04, 0.006, -0.004))
    ground = GroundLookup(bent, BODY_FROM_CAMERA, (bent.height_px, bent.width_px), 1.6)
    v_px, u_px = np.mgrid[0 : bent.height_px : 37, 0 : bent.width_px : 41].reshape(2, -1)
    points_m = np.column_stack([ground.x_body_m[v_px, u_px], ground.y_body_m[v_px, u_px]])
    seen = ~np.isnan(points_m[:, 0])
    assert seen.sum() > 150
    back_px = _through_the_lens(points_m[seen].astype(float), bent)
    error_px = np.hypot(back_px[:, 0] - u_px[seen], back_px[:, 1] - v_px[seen])
    assert error_px.max() < 0.1
    straight = GroundLookup(CAMERA, BODY_FROM_CAMERA, (bent.height_px, bent.width_px), 1.6)
    shift_m = np.hypot(ground.x_body_m - straight.x_body_m, ground.y_body_m - straight.y_body_m)
    assert shift_m[400, 30] > 0.03  # what a pinhole would be wrong by in a corner


def test_a_lens_that_folds_the_picture_is_refused() -> None:
    folded = msgspec.structs.replace(CAMERA, distortion=(-1.5, 0.0, 0.0, 0.0))
    with pytest.raises(PerceptionError, match="cannot be undone"):
        GroundLookup(folded, BODY_FROM_CAMERA, (48, 64), 1.6)
