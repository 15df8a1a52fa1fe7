"""The robot in its own picture: where its parts appear, and where its shadow falls."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.core.errors import DescriptionError
from agribot.core.geo import transform
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.robot import Origin, RobotSpec, Shape
from agribot.core.world import HeightField, Light
from agribot.description.loader import load_robot
from agribot.sim.camera import CameraRenderer
from tests.sim.camera.camera_scenes import CAMERA, brightness, pixel_of, plant, pose, rays, world

SUN = Light(to_sun=(0.6, 0.0, 0.8))
ABOVE = pose(0.0, 0.0, 2.0, down_deg=90.0)
BALL_M, BALL_RADIUS_M = (0.1, -0.2, 0.6), 0.06
BODY = transform((0.2, 0.1, 0.0), (0.0, 0.0, 0.7))


@pytest.fixture(scope="module")
def rover() -> RobotSpec:
    return load_robot()


@pytest.fixture(scope="module")
def ball(rover: RobotSpec) -> RobotSpec:
    """A robot with only a ball as its visible shape, at BALL_M in the body frame."""
    at = np.linalg.inv(rover.body_from_link("base_link")) @ np.append(BALL_M, 1.0)
    shape = Shape(
        kind="sphere", size_m=(BALL_RADIUS_M, 0.0, 0.0), rgba=(0.9, 0.1, 0.1, 1.0),
        origin=Origin(xyz_m=(float(at[0]), float(at[1]), float(at[2]))),
    )  # fmt: skip
    links = tuple(
        msgspec.structs.replace(link, visuals=(shape,) if link.name == "base_link" else ())
        for link in rover.links
    )
    return msgspec.structs.replace(rover, links=links)


def _ground_points(view: FloatArray, height_m: float) -> FloatArray:
    """Where the rays of all pixels meet the level of a height, (h, w, 3)."""
    ray = rays(view, CAMERA)
    points: FloatArray = view[:3, 3] + ray * ((height_m - view[2, 3]) / ray[..., 2])[..., None]
    return points


def test_a_part_appears_where_the_body_pose_and_the_pinhole_put_it(ball: RobotSpec) -> None:
    renderer = CameraRenderer(world(light=SUN), ball)
    drawn = renderer.render(ABOVE, CAMERA, noise_seed=None, supersample=2, map_from_body=BODY)
    rows, columns = np.nonzero(drawn.depth_m < 1.9)
    centre = (BODY @ np.append(BALL_M, 1.0))[:3]
    expected = pixel_of(centre, ABOVE, CAMERA)
    assert np.hypot(columns.mean() - expected[0], rows.mean() - expected[1]) < 0.6
    radius_px = CAMERA.focal_px * BALL_RADIUS_M / (2.0 - BALL_M[2])
    assert len(rows) == pytest.approx(math.pi * radius_px**2, rel=0.08)
    assert (drawn.class_id == PlantClass.SOIL).all()
    assert (drawn.instance == -1).all()


def test_its_shadow_lies_on_the_ground_away_from_the_sun(ball: RobotSpec) -> None:
    renderer = CameraRenderer(world(light=SUN), ball)
    bare = renderer.render(ABOVE, CAMERA, noise_seed=None, supersample=4)
    drawn = renderer.render(ABOVE, CAMERA, noise_seed=None, supersample=4, map_from_body=BODY)
    dark = (brightness(drawn) < 0.7 * brightness(bare)) & (drawn.depth_m > 1.99)
    place_m = _ground_points(ABOVE, 0.0)[dark]
    centre = (BODY @ np.append(BALL_M, 1.0))[:3]
    sun = np.array(SUN.to_sun)
    expected = centre[:2] - sun[:2] / sun[2] * centre[2]
    np.testing.assert_allclose(place_m[:, :2].mean(axis=0), expected, atol=0.01)
    # A ball's shadow is an ellipse, longer by 1 / sin(elevation) along the sun.
    ratio = brightness(drawn) / brightness(bare)
    share = ((1.0 - ratio) / (1.0 - ratio[dark].min()))[drawn.depth_m > 1.99]
    area_m2 = share.sum() * (2.0 / CAMERA.focal_px) ** 2
    assert area_m2 == pytest.approx(math.pi * BALL_RADIUS_M**2 / sun[2], rel=0.1)


def test_under_clouds_its_shadow_is_wide_soft_and_nearly_below_it(ball: RobotSpec) -> None:
    clouds = Light(to_sun=SUN.to_sun, diffuse=0.0, ambient=1.0)
    renderer = CameraRenderer(world(light=clouds), ball)
    bare = renderer.render(ABOVE, CAMERA, noise_seed=None)
    drawn = renderer.render(ABOVE, CAMERA, noise_seed=None, map_from_body=BODY)
    is_soil = drawn.depth_m > 1.99
    dark = np.where(is_soil, 1.0 - brightness(drawn) / brightness(bare), 0.0)
    shaded = dark > 0.02
    radius_m = np.sqrt(shaded.sum() / math.pi) * 2.0 / CAMERA.focal_px
    assert radius_m > BALL_RADIUS_M
    assert dark.max() < 0.3  # the sky reaches below it
    place_m = _ground_points(ABOVE, 0.0)[shaded]
    centre = (BODY @ np.append(BALL_M, 1.0))[:2]
    assert np.hypot(*(place_m[:, :2].mean(axis=0) - centre)) < 0.1


def test_the_shadow_follows_a_slope(ball: RobotSpec) -> None:
    x_m = np.arange(-6.0, 6.01, 0.5)
    slope = HeightField(
        height_m=np.tile(0.2 * x_m, (len(x_m), 1)), x_min_m=-6.0, y_min_m=-6.0, resolution_m=0.5
    )
    renderer = CameraRenderer(world(light=SUN, terrain=slope), ball)
    bare = renderer.render(ABOVE, CAMERA, noise_seed=None)
    drawn = renderer.render(ABOVE, CAMERA, noise_seed=None, map_from_body=BODY)
    dark = (brightness(drawn) < 0.7 * brightness(bare)) & (drawn.depth_m > bare.depth_m - 0.01)
    seen_m = ABOVE[:3, 3] + rays(ABOVE, CAMERA) * drawn.depth_m[..., None]
    centre, sun = (BODY @ np.append(BALL_M, 1.0))[:3], np.array(SUN.to_sun)
    # On the ray from the ball away from the sun, where z = 0.2 x.
    along = (centre[2] - 0.2 * centre[0]) / (sun[2] - 0.2 * sun[0])
    np.testing.assert_allclose(seen_m[dark].mean(axis=0), centre - along * sun, atol=0.015)


def test_plants_below_the_shadowing_part_are_shaded_and_those_above_are_not(
    ball: RobotSpec,
) -> None:
    centre, sun = (BODY @ np.append(BALL_M, 1.0))[:3], np.array(SUN.to_sun)
    at = centre[:2] - sun[:2] / sun[2] * (centre[2] - 0.03)
    field = world(plant(float(at[0]), float(at[1]), "lettuce", size_m=0.05), light=SUN)
    renderer = CameraRenderer(field, ball)
    bare = renderer.render(ABOVE, CAMERA, noise_seed=None, supersample=2)
    high = BODY.copy()
    for rise_m, least, most in ((0.0, 0.3, 0.75), (-0.75, 0.999, 1.001)):
        high[2, 3] = rise_m
        drawn = renderer.render(ABOVE, CAMERA, noise_seed=None, supersample=2, map_from_body=high)
        leaf = (bare.instance == 0) & (drawn.instance == 0)
        assert leaf.sum() > 20
        ratio = brightness(drawn)[leaf].mean() / brightness(bare)[leaf].mean()
        assert least < ratio < most


def test_the_rover_stands_on_its_wheels_and_they_turn(rover: RobotSpec) -> None:
    renderer = CameraRenderer(world(), rover)
    view = pose(0.2, -1.6, 0.15, down_deg=0.0, yaw_rad=math.pi / 2)
    body = transform((0.0, 0.0, 0.0))
    bare = renderer.render(view, CAMERA, noise_seed=None)
    still = renderer.render(view, CAMERA, noise_seed=None, map_from_body=body)
    part = still.depth_m < bare.depth_m - 0.1
    near = part & (still.depth_m < 1.25)  # the right wheels
    lowest_m = (view[:3, 3] + rays(view, CAMERA) * still.depth_m[..., None])[near][:, 2].min()
    assert lowest_m == pytest.approx(0.0, abs=0.015)  # two pixels
    turned = renderer.render(
        view, CAMERA, noise_seed=None, map_from_body=body, wheel_angles_rad=(0.15, 0.0, 0.15, 0.0)
    )
    changed = np.abs(brightness(turned) - brightness(still)) > 4.0
    assert changed[near].sum() > 20
    assert not changed[bare.depth_m == still.depth_m][: CAMERA.height_px // 3].any()


def test_the_robot_leaves_no_trace_when_it_is_not_asked_for(rover: RobotSpec) -> None:
    field = world(plant(0.8, 0.0))
    with_robot, without = CameraRenderer(field, rover), CameraRenderer(field)
    first = with_robot.render(pose(), CAMERA, noise_seed=2, map_from_body=BODY)
    again = with_robot.render(pose(), CAMERA, noise_seed=2, map_from_body=BODY)
    np.testing.assert_array_equal(first.image_rgb, again.image_rgb)
    gone = with_robot.render(pose(), CAMERA, noise_seed=2)
    never = without.render(pose(), CAMERA, noise_seed=2)
    np.testing.assert_array_equal(gone.image_rgb, never.image_rgb)
    np.testing.assert_array_equal(gone.instance, never.instance)
    assert not np.array_equal(first.image_rgb, gone.image_rgb)


def test_a_wheel_turns_about_its_axle_and_rolls_forward(rover: RobotSpec) -> None:
    """The wheels turn about the axis of their joint: a mark on the rim moves on a circle."""
    from agribot.sim.camera.rover import Rover
    from agribot.sim.stl import find_mesh_file

    poses = [
        Rover(rover, find_mesh_file).compute_poses(np.eye(4), (angle, 0.0, 0.0, 0.0))
        for angle in (0.0, math.pi / 2)
    ]
    moved = [k for k in range(len(poses[0])) if not np.allclose(poses[0][k], poses[1][k])]
    assert len(moved) == 1
    turn = poses[1][moved[0]][:3, :3] @ poses[0][moved[0]][:3, :3].T
    # The axle points left, so that a positive angle rolls forward: up turns to the front.
    np.testing.assert_allclose(turn @ [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], atol=0.01)


def test_what_cannot_be_drawn_is_said_clearly(rover: RobotSpec, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="pass robot="):
        CameraRenderer(world()).render(pose(), CAMERA, noise_seed=None, map_from_body=BODY)
    with pytest.raises(DescriptionError, match="2 wheel angles given; pass 4"):
        CameraRenderer(world(), rover).render(
            pose(), CAMERA, noise_seed=None, map_from_body=BODY, wheel_angles_rad=(0.0, 0.0)
        )
    with pytest.raises(DescriptionError, match="cannot read the mesh"):
        CameraRenderer(world(), rover, resolve_mesh=lambda name: tmp_path / Path(name).name)
    broken = tmp_path / "broken.stl"
    broken.write_bytes(b"solid of text\n" * 20)
    with pytest.raises(DescriptionError, match="convert it to binary STL"):
        CameraRenderer(world(), rover, resolve_mesh=lambda _name: broken)
