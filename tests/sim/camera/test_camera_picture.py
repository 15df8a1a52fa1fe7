"""What the picture looks like: light, surfaces, noise and repeatability."""

from __future__ import annotations

import subprocess
import sys

import msgspec
import numpy as np
import pytest

from agribot.core.errors import DescriptionError
from agribot.core.messages import PlantClass
from agribot.core.world import GroundTile, Light
from agribot.sim.camera import Appearance, CameraRenderer
from tests.sim.camera.camera_scenes import (
    CAMERA,
    brightness,
    mixed_field,
    obstacle,
    plant,
    pose,
    rays,
    world,
)

DOWN = pose(down_deg=90.0)


def test_pictures_are_bit_identical_on_repeat_and_for_any_number_of_threads() -> None:
    field = mixed_field(np.random.default_rng(2), 60)
    first = CameraRenderer(field, threads=1)
    pictures = [
        renderer.render(pose(), CAMERA, noise_seed=7)
        for renderer in (first, first, CameraRenderer(field, threads=3))
    ]
    for other in pictures[1:]:
        for name in ("image_rgb", "depth_m", "class_id", "instance"):
            np.testing.assert_array_equal(getattr(other, name), getattr(pictures[0], name))


def test_soil_in_the_shadow_of_a_plant_is_darker() -> None:
    light = Light(to_sun=(0.7, 0.0, 0.7))
    beet = plant(0.0, 0.0, size_m=0.3)
    lit = CameraRenderer(world(light=light)).render(DOWN, CAMERA, noise_seed=None)
    shaded = CameraRenderer(world(beet, light=light)).render(DOWN, CAMERA, noise_seed=None)
    soil = shaded.instance == -1
    ratio = brightness(shaded)[soil] / brightness(lit)[soil]
    assert (ratio < 0.6).sum() > 1000
    assert np.median(ratio) == pytest.approx(1.0, abs=0.02)
    # The sun is in the East, which is up in this picture: the shadow lies on the other side.
    rows = np.nonzero(soil)[0][ratio < 0.6]
    assert rows.mean() > CAMERA.height_px / 2 + 5


def test_under_clouds_a_shadow_is_below_its_thing_and_has_no_edge() -> None:
    view = pose(-1.0, 0.0, 1.0, down_deg=45.0)  # the ball does not hide the soil below it
    ball = obstacle("sphere", (0.12, 0.12, 0.12), 0.0, 0.0, 0.4)

    def shadow(light: Light) -> tuple[float, float]:
        """Metres from below the ball to the middle of the shadow; how much of it is half-dark."""
        bare = CameraRenderer(world(light=light)).render(view, CAMERA, noise_seed=None)
        drawn = CameraRenderer(world(obstacles=(ball,), light=light)).render(
            view, CAMERA, noise_seed=None
        )
        is_soil = drawn.depth_m > bare.depth_m - 0.01
        dark = np.where(is_soil, 1.0 - brightness(drawn) / brightness(bare), 0.0)
        place_m = (view[:3, 3] + rays(view, CAMERA) * bare.depth_m[..., None])[..., :2]
        strong = dark > 0.05 * dark.max()
        middle_m = np.average(place_m[strong], axis=0, weights=dark[strong])
        half = (dark > 0.2 * dark.max()) & (dark < 0.8 * dark.max())
        return float(np.hypot(*middle_m)), half.sum() / strong.sum()

    clear_m, clear_edge = shadow(Light(to_sun=(0.7, 0.0, 0.7), diffuse=0.8, ambient=0.5))
    cloudy_m, cloudy_edge = shadow(Light(to_sun=(0.7, 0.0, 0.7), diffuse=0.1, ambient=0.9))
    assert clear_m == pytest.approx(0.4, abs=0.05)
    assert cloudy_m < 0.15
    assert cloudy_edge > 2.0 * clear_edge


def test_a_post_shades_the_plant_behind_it() -> None:
    light = Light(to_sun=(0.7, 0.0, 0.7))
    wall = obstacle("box", (0.1, 3.0, 2.0), 0.8, 0.0, 1.0)
    small = plant(0.0, 0.0, size_m=0.15)
    free = CameraRenderer(world(small, light=light)).render(DOWN, CAMERA, noise_seed=None)
    behind = CameraRenderer(world(small, obstacles=(wall,), light=light)).render(
        DOWN, CAMERA, noise_seed=None
    )
    leaf = (free.instance == 0) & (behind.instance == 0)
    assert brightness(behind)[leaf].mean() < 0.7 * brightness(free)[leaf].mean()


def test_noise_has_the_deviation_of_the_camera_and_its_own_seed() -> None:
    renderer = CameraRenderer(world())
    clean = renderer.render(DOWN, CAMERA, noise_seed=None).image_rgb.astype(float)
    camera = msgspec.structs.replace(CAMERA, noise_std=0.02)
    noisy = [renderer.render(DOWN, camera, noise_seed=k).image_rgb - clean for k in (1, 2)]
    for noise in noisy:
        assert noise.std() == pytest.approx(0.02 * 255, rel=0.03)
        assert abs(noise.mean()) < 0.05
    assert abs(np.corrcoef(noisy[0].ravel(), noisy[1].ravel())[0, 1]) < 0.02
    # Nor do the colours or the neighbours of a pixel share their noise.
    assert abs(np.corrcoef(noisy[0][..., 0].ravel(), noisy[0][..., 2].ravel())[0, 1]) < 0.02
    assert abs(np.corrcoef(noisy[0][:, 1:].ravel(), noisy[0][:, :-1].ravel())[0, 1]) < 0.02


def test_the_later_of_two_tiles_wins() -> None:
    grass = GroundTile(surface="grass", x_min_m=-5, y_min_m=-5, x_max_m=5, y_max_m=5)
    paved = GroundTile(surface="pavement", x_min_m=-5, y_min_m=-5, x_max_m=5, y_max_m=0)
    drawn = CameraRenderer(world(ground=(grass, paved))).render(DOWN, CAMERA, noise_seed=None)
    # Looking down with East up in the picture, North (grass) is left of the middle.
    left, right = drawn.image_rgb[:, :155].astype(float), drawn.image_rgb[:, 165:].astype(float)
    assert left[..., 1].mean() > left[..., 2].mean() + 30  # green
    assert right[..., 1].mean() == pytest.approx(right[..., 2].mean(), abs=12)  # grey


def test_supersampling_comes_closer_to_the_true_picture_without_moving_it() -> None:
    renderer = CameraRenderer(mixed_field(np.random.default_rng(8), 60))
    plain = renderer.render(pose(), CAMERA, noise_seed=None)
    smooth = renderer.render(pose(), CAMERA, noise_seed=None, supersample=3)
    assert smooth.image_rgb.shape == plain.image_rgb.shape
    assert brightness(smooth).mean() == pytest.approx(brightness(plain).mean(), rel=0.01)
    assert (smooth.instance == plain.instance).mean() > 0.97
    finest = renderer.render(pose(), CAMERA, noise_seed=None, supersample=8)
    plants = finest.instance >= 0
    error = [np.abs(brightness(p) - brightness(finest))[plants].mean() for p in (plain, smooth)]
    assert error[1] < 0.5 * error[0]


def test_appearance_changes_soil_leaves_and_exposure() -> None:
    field = world(plant(0.0, 0.0, size_m=0.3))

    def mean_rgb(look: Appearance, kind: PlantClass) -> list[float]:
        drawn = CameraRenderer(field, appearance=look).render(DOWN, CAMERA, noise_seed=None)
        means: list[float] = drawn.image_rgb[drawn.class_id == kind].mean(axis=0).tolist()
        return means

    neutral = Appearance()
    soil, leaf = mean_rgb(neutral, PlantClass.SOIL), mean_rgb(neutral, PlantClass.CROP)
    red = mean_rgb(Appearance(soil_tint=(1.2, 1.0, 0.8)), PlantClass.SOIL)
    assert red[0] > 1.1 * soil[0]
    assert red[2] < 0.9 * soil[2]
    pale = mean_rgb(Appearance(leaf_gain=(1.3, 1.0, 1.0)), PlantClass.CROP)
    assert pale[0] > 1.15 * leaf[0]
    dark = mean_rgb(Appearance(exposure=0.5), PlantClass.SOIL)
    assert dark[1] == pytest.approx(0.5 * soil[1], rel=0.02)
    flat = mean_rgb(Appearance(gamma=0.7), PlantClass.SOIL)
    assert flat[1] > 1.1 * soil[1]


def test_crops_and_weeds_cannot_be_told_apart_by_colour_alone() -> None:
    """The best threshold on any ratio of colours must leave many plants in the wrong class."""
    rng = np.random.default_rng(4)
    plants = []
    for index in range(120):
        is_crop = index % 2 == 0
        species = "sugar_beet" if is_crop else str(rng.choice(["grass", "thistle", "amaranth"]))
        kind = PlantClass.CROP if is_crop else PlantClass.WEED
        place = (index % 12 * 0.3 - 1.65, index // 12 * 0.3 - 1.35)
        plants.append(plant(*place, species, size_m=0.12, seed=index * 7, kind=kind))
    view = pose(0.0, 0.0, 2.2, down_deg=90.0)
    drawn = CameraRenderer(world(*plants)).render(view, CAMERA, noise_seed=None, supersample=2)
    seen = [k for k in range(120) if (drawn.instance == k).sum() > 12]
    colour = np.array([drawn.image_rgb[drawn.instance == k].mean(axis=0) for k in seen])
    crop = np.array([plants[k].plant == PlantClass.CROP for k in seen])
    assert len(seen) > 80
    for ratio in (colour[:, 0] / colour[:, 1], colour[:, 2] / colour[:, 1], colour.sum(axis=1)):
        right = [np.mean((ratio > edge) == crop) for edge in ratio]
        assert max(*right, *(1.0 - r for r in right)) < 0.9


def test_an_empty_world_is_soil_and_sky() -> None:
    drawn = CameraRenderer(world()).render(pose(down_deg=0.0), CAMERA, noise_seed=None)
    assert np.isinf(drawn.depth_m[:100]).all()
    assert np.isfinite(drawn.depth_m[140:]).all()
    sky, soil = drawn.image_rgb[20].mean(axis=0), drawn.image_rgb[-20].mean(axis=0)
    assert sky[2] > sky[0]
    assert soil[0] > soil[2]


def test_unknown_things_are_named_with_what_is_known() -> None:
    with pytest.raises(DescriptionError, match=r"triffid.*sugar_beet"):
        CameraRenderer(world(plant(0.0, 0.0, "triffid")))
    lava = GroundTile(surface="lava", x_min_m=0, y_min_m=0, x_max_m=1, y_max_m=1)
    with pytest.raises(DescriptionError, match=r"lava.*soil"):
        CameraRenderer(world(ground=(lava,)))
    with pytest.raises(DescriptionError, match=r"'mesh'.*box"):
        CameraRenderer(world(obstacles=(obstacle("mesh", (1.0, 1.0, 1.0), 0.0, 0.0, 0.0),)))


def test_rendering_loads_no_graphics_library() -> None:
    program = """
import sys
sys.path.insert(0, "tests/sim/camera")
from tests.sim.camera.camera_scenes import CAMERA, plant, pose, world
from agribot.sim.camera import CameraRenderer
CameraRenderer(world(plant(1.0, 0.0)), threads=1).render(pose(), CAMERA, noise_seed=1)
wanted = ("OpenGL", "glfw", "mujoco", "moderngl", "pyglet", "vtk", "pybullet", "vulkan", "torch")
loaded = [name for name in wanted if name in sys.modules]
if sys.platform == "linux":
    maps = open("/proc/self/maps").read()
    loaded += [name for name in ("libGL.", "libEGL", "libOSMesa", "libvulkan") if name in maps]
print(loaded)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout.strip() == "[]"
