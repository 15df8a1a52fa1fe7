"""A camera that is not mounted as described: found from rendered pictures of a drive."""

from __future__ import annotations

import math

import numpy as np

from agribot.autonomy.perceive.foliage import HEIGHT_RATIO
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.mount_fit import Look, MountFit, fit_mount
from agribot.autonomy.perceive.plants import observe
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.config import PerceptionConfig
from agribot.core.geo import rotation_from_rpy, transform
from agribot.core.messages import CameraFrame, FloatArray, GroundPlant, PlantClass
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.sim.camera import CameraRenderer
from tests import nightly

ROBOT = load_robot()
DESCRIBED = ROBOT.body_from_camera()
# Roll, pitch, yaw and height by which the real mount is off.
ERROR = np.array([math.radians(2.0), math.radians(-3.0), math.radians(2.5), 0.04])


def mounted(error: FloatArray) -> FloatArray:
    body_from_camera = DESCRIBED.copy()
    body_from_camera[:3, :3] = rotation_from_rpy(*error[:3].tolist()) @ DESCRIBED[:3, :3]
    body_from_camera[2, 3] += error[3]
    return body_from_camera


def found(fit: MountFit) -> FloatArray:
    return np.array([fit.roll_rad, fit.pitch_rad, fit.yaw_rad, fit.height_m])


def sigmas(fit: MountFit) -> FloatArray:
    return np.array([fit.roll_std_rad, fit.pitch_std_rad, fit.yaw_std_rad, fit.height_std_m])


def drawn_looks(
    real: FloatArray, seed: int, std_m: float = 0.0, shows_stems: bool = False
) -> list[Look]:
    """Two ways along a row of plants, without pictures: rays to the leaves' middle, or to stems."""
    rng = np.random.default_rng(seed)
    area_m2, looks = 0.01, []
    leaves_m = HEIGHT_RATIO[PlantClass.CROP] * 2.0 * math.sqrt(area_m2 / math.pi)
    if shows_stems:
        leaves_m = 0.0
    places = np.column_stack([rng.uniform(0.0, 8.0, 60), rng.uniform(-0.5, 0.5, 60)])
    for number in range(320):
        way_m = 0.05 * (number % 160) - 1.0
        pose = (way_m, 0.05, 0.02) if number < 160 else (9.0 - way_m, -0.05, math.pi)
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        dx, dy = places[:, 0] - pose[0], places[:, 1] - pose[1]
        body = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, np.full(60, leaves_m)])
        near = (body[:, 0] > 0.5) & (body[:, 0] < 1.8)
        rays = (body[near] - real[:3, 3]) @ real[:3, :3] @ DESCRIBED[:3, :3].T
        reach = (leaves_m - DESCRIBED[2, 3]) / rays[:, 2]
        seen = DESCRIBED[:2, 3] + reach[:, None] * rays[:, :2]
        seen = seen + std_m * rng.standard_normal(seen.shape)
        plants = tuple(
            GroundPlant(
                x_body_m=x, y_body_m=y, plant=PlantClass.CROP, area_m2=area_m2, confidence=1.0,
                std_m=0.01, seen_height_m=0.0 if shows_stems else None,
            )
            for x, y in seen.tolist()
        )  # fmt: skip
        looks.append(Look(0.1 * number + 10.0 * (number >= 160), pose, plants))
    return looks


def test_without_noise_the_mount_is_found_exactly() -> None:
    fit = fit_mount(drawn_looks(mounted(ERROR), 1), DESCRIBED)
    assert fit is not None and not fit.complaints()
    np.testing.assert_allclose(found(fit), ERROR, atol=2e-4)
    assert fit.scatter_m < 1e-3
    assert fit.scatter_before_m > 0.02


def test_of_stems_no_height_is_guessed() -> None:
    fit = fit_mount(drawn_looks(mounted(ERROR), 1, shows_stems=True), DESCRIBED)
    assert fit is not None and not fit.complaints()
    np.testing.assert_allclose(found(fit), ERROR, atol=2e-4)


def test_over_seeds_it_errs_no_more_than_it_says() -> None:
    ratios = []
    for seed in range(12):
        fit = fit_mount(drawn_looks(mounted(ERROR), seed, std_m=0.01), DESCRIBED)
        assert fit is not None and not fit.complaints()
        ratios.append((found(fit) - ERROR) / sigmas(fit))
    assert np.sqrt(np.mean(np.square(ratios), axis=0)).max() < 1.3


def test_a_robot_that_stands_or_sees_little_says_so() -> None:
    looks = drawn_looks(DESCRIBED, 1)
    standing = [look._replace(pose_map=(0.0, 0.0, 0.0)) for look in looks]
    assert fit_mount(standing, DESCRIBED) is None
    assert fit_mount([], DESCRIBED) is None
    short = fit_mount(looks[:24], DESCRIBED)
    assert short is not None
    assert "drive further" in short.complaints()[0]


def rendered_looks(real: FloatArray) -> list[Look]:
    """What the network sees through the real mount, placed as described, to and fro on the farm."""
    world, segmenter = load_world("Farm", seed=3), Segmenter("agribot-sim")
    assert ROBOT.camera is not None
    settings = PerceptionConfig()
    ground = GroundLookup(ROBOT.camera, DESCRIBED, segmenter.map_shape, settings.max_range_m)
    renderer, looks = CameraRenderer(world), []
    for number in range(120):
        way_m, yaw_rad = 0.05 * (number % 60) - 1.5, math.pi * (number >= 60)
        pose = (3.5 + math.cos(yaw_rad) * way_m, 7.0, yaw_rad)
        body = transform((pose[0], pose[1], 0.0), (0.0, 0.0, yaw_rad))
        picture = renderer.render(body @ real, ROBOT.camera, noise_seed=number)
        frame = CameraFrame(t_s=0.1 * number, index=number, image_rgb=picture.image_rgb)
        scene = observe(frame, segmenter.segment(frame.image_rgb), ground, settings, 0.0)
        looks.append(Look(scene.t_s + 10.0 * (number >= 60), pose, scene.plants))
    return looks


@nightly.by_day(
    "test_without_noise_the_mount_is_found_exactly",
    "test_over_seeds_it_errs_no_more_than_it_says",
    "test_a_robot_that_stands_or_sees_little_says_so",
)
def test_a_wrong_mount_is_found_from_rendered_pictures() -> None:
    """Six metres show pitch, yaw and height; roll takes a longer way, and the result says so."""
    fit = fit_mount(rendered_looks(mounted(ERROR)), DESCRIBED)
    assert fit is not None
    roll_rad, pitch_rad, yaw_rad, height_m = np.abs(found(fit) - ERROR).tolist()
    assert math.degrees(pitch_rad) < 0.6
    assert math.degrees(yaw_rad) < 0.4
    assert height_m < 0.02
    assert roll_rad < 3.0 * fit.roll_std_rad
    assert "roll is known to" in " ".join(fit.complaints())
    assert fit.scatter_m < 0.4 * fit.scatter_before_m
