"""Where things appear: projection, depth, occlusion and the near plane."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from agribot.core.messages import PlantClass
from agribot.core.world import HeightField
from agribot.sim.camera import CameraRenderer
from tests.sim.camera.camera_scenes import (
    CAMERA,
    mixed_field,
    obstacle,
    pixel_of,
    plant,
    pose,
    rays,
    world,
)


@pytest.mark.parametrize(("x_m", "y_m"), [(0.8, 0.0), (1.4, 0.5), (2.0, -0.8)])
def test_a_plant_appears_where_the_pinhole_matrix_puts_it(x_m: float, y_m: float) -> None:
    view = pose(down_deg=40.0)
    small = plant(x_m, y_m, "lettuce", size_m=0.04)
    drawn = CameraRenderer(world(small)).render(view, CAMERA, noise_seed=None, supersample=3)
    rows, columns = np.nonzero(drawn.instance == 0)
    expected = pixel_of(np.array([x_m, y_m, 0.02]), view, CAMERA)
    assert len(rows) > 4
    assert np.hypot(columns.mean() - expected[0], rows.mean() - expected[1]) < 1.5


def test_the_outline_of_a_sphere_is_centred_on_its_projection() -> None:
    view = pose(down_deg=90.0)
    ball = obstacle("sphere", (0.2, 0.0, 0.0), 0.0, 0.0, 0.3)
    drawn = CameraRenderer(world(obstacles=(ball,))).render(view, CAMERA, noise_seed=None)
    rows, columns = np.nonzero(drawn.depth_m < 0.88)
    expected = pixel_of(np.array([0.0, 0.0, 0.3]), view, CAMERA)
    # The principal point lies between pixels: (159.5, 119.5).
    assert columns.mean() == pytest.approx(expected[0], abs=0.05)
    assert rows.mean() == pytest.approx(expected[1], abs=0.05)
    assert expected == pytest.approx([159.5, 119.5])


@pytest.mark.parametrize("down_deg", [15.0, 50.0, 90.0])
def test_depth_of_flat_ground_is_where_the_ray_meets_the_plane(down_deg: float) -> None:
    view = pose(3.0, -2.0, 0.9, down_deg=down_deg, yaw_rad=0.7)
    drawn = CameraRenderer(world()).render(view, CAMERA, noise_seed=None)
    up = rays(view, CAMERA)[..., 2]
    with np.errstate(divide="ignore"):
        depth_m = np.where(up < 0.0, -0.9 / up, np.inf)
    hit = depth_m < CAMERA.clip_far_m * 0.99
    np.testing.assert_allclose(drawn.depth_m[hit], depth_m[hit], rtol=1e-5)
    assert np.isinf(drawn.depth_m[up > 0.0]).all()


def test_the_nearer_plant_hides_the_farther() -> None:
    view = pose(z_m=0.15, down_deg=0.0)
    renderer = CameraRenderer(world(plant(1.0, 0.0, seed=1), plant(0.6, 0.0, seed=2)))
    both = renderer.render(view, CAMERA, noise_seed=None)
    near_only = CameraRenderer(world(plant(0.6, 0.0, seed=2))).render(view, CAMERA, noise_seed=None)
    far_only = CameraRenderer(world(plant(1.0, 0.0, seed=1))).render(view, CAMERA, noise_seed=None)
    overlap = (near_only.instance == 0) & (far_only.instance == 0)
    overlap &= near_only.depth_m < far_only.depth_m
    assert overlap.sum() > 100
    assert (both.instance[overlap] == 1).all()
    np.testing.assert_array_equal(both.depth_m[overlap], near_only.depth_m[overlap])


def test_plants_across_the_near_plane_are_cut_without_a_hole() -> None:
    """What lies beyond the near plane must not change when the plane cuts what is before it."""
    plants = [plant(0.3 + 0.1 * k, 0.05 * k - 0.1, seed=k, size_m=0.25) for k in range(4)]
    renderer = CameraRenderer(world(*plants))
    view = pose(z_m=0.3, down_deg=30.0)
    whole = renderer.render(view, CAMERA, noise_seed=None)
    near_m = 0.25
    cut_camera = msgspec.structs.replace(CAMERA, clip_near_m=near_m)
    cut = renderer.render(view, cut_camera, noise_seed=None)
    was_nearer = (whole.depth_m < near_m) & (whole.instance >= 0)
    beyond = (whole.depth_m > near_m + 1e-3) & (whole.instance >= 0)
    assert was_nearer.sum() > 500
    assert beyond.sum() > 500
    assert (cut.instance[beyond] == whole.instance[beyond]).mean() > 0.999
    assert cut.depth_m.min() >= near_m * 0.9999


def test_a_floor_that_passes_under_the_camera_has_no_hole() -> None:
    slab = obstacle("box", (20.0, 20.0, 0.2), 0.0, 0.0, 0.3)
    view = pose(z_m=0.9, down_deg=45.0)
    drawn = CameraRenderer(world(obstacles=(slab,))).render(view, CAMERA, noise_seed=None)
    depth_m = -0.5 / rays(view, CAMERA)[..., 2]
    np.testing.assert_allclose(drawn.depth_m, depth_m, rtol=1e-4)


def test_every_plant_pixel_has_the_class_of_its_plant() -> None:
    field = mixed_field(np.random.default_rng(5), 80)
    drawn = CameraRenderer(field).render(pose(), CAMERA, noise_seed=3)
    classes = np.array([int(p.plant) for p in field.plants])
    is_plant = drawn.instance >= 0
    assert len(np.unique(drawn.instance)) > 10
    np.testing.assert_array_equal(drawn.class_id[is_plant], classes[drawn.instance[is_plant]])
    assert (drawn.class_id[~is_plant] == PlantClass.SOIL).all()
    assert {0, 1, 2} == set(np.unique(drawn.class_id).tolist())


def test_obstacles_count_as_soil() -> None:
    post = obstacle("cylinder", (0.1, 1.0, 0.0), 1.0, 0.0, 0.5)
    drawn = CameraRenderer(world(obstacles=(post,))).render(pose(), CAMERA, noise_seed=None)
    bare = CameraRenderer(world()).render(pose(), CAMERA, noise_seed=None)
    assert (drawn.depth_m < bare.depth_m - 0.05).sum() > 300
    assert (drawn.class_id == PlantClass.SOIL).all()
    assert (drawn.instance == -1).all()


def _slope(rise: float) -> HeightField:
    x_m = np.arange(-10.0, 10.01, 0.5)
    return HeightField(
        height_m=np.tile(rise * x_m, (len(x_m), 1)), x_min_m=-10.0, y_min_m=-10.0, resolution_m=0.5
    )


def test_depth_of_a_slope_is_where_the_ray_meets_it() -> None:
    view = pose(z_m=0.9, down_deg=40.0, yaw_rad=0.4)
    drawn = CameraRenderer(world(terrain=_slope(0.15))).render(view, CAMERA, noise_seed=None)
    ray = rays(view, CAMERA)
    depth_m = 0.9 / (0.15 * ray[..., 0] - ray[..., 2])
    near = (depth_m > 0.0) & (depth_m < 7.0)
    assert near.mean() > 0.9
    np.testing.assert_allclose(drawn.depth_m[near], depth_m[near], rtol=1e-3)


def test_a_plant_on_a_slope_stands_on_the_ground() -> None:
    view = pose(z_m=1.2, down_deg=35.0)
    small = plant(2.0, 0.3, "lettuce", size_m=0.06)
    renderer = CameraRenderer(world(small, terrain=_slope(0.2)))
    drawn = renderer.render(view, CAMERA, noise_seed=None, supersample=3)
    rows, columns = np.nonzero(drawn.instance == 0)
    expected = pixel_of(np.array([2.0, 0.3, 0.43]), view, CAMERA)
    assert len(rows) > 4
    assert np.hypot(columns.mean() - expected[0], rows.mean() - expected[1]) < 2.0
