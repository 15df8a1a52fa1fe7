"""The camera over a dense field: what a frame costs, and how fast a camera at 30 Hz can be."""

from __future__ import annotations

import math
from functools import cache

import msgspec
import numpy as np

from agribot.core import config
from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import DriveCommand, RobotCommand
from agribot.core.world import HeightField, WorldSpec
from agribot.description.field_generator import generate_field
from agribot.description.field_settings import (
    CropSettings,
    FieldSettings,
    RowsSettings,
    WeedsSettings,
)
from agribot.lab.bench.ground import ROUGH

CAMERA_RATE_HZ = 30.0
SEED = 1
# Height over the soil and angle below the horizon: straight down, across, as the original's camera.
NADIR, ACROSS, FORWARD = (1.2, 89.9), (0.88, 45.0), (0.28, 0.0)


@cache
def dense_field(is_hilly: bool = False, is_rough: bool = False) -> WorldSpec:
    """40 rows of sugar beet of 40 m, every 18 cm, with 4 weeds on a square metre: 10,816 plants."""
    plan = FieldSettings(
        name="dense",
        spawn_xy_map_m=(-17.0, 0.0),
        spawn_yaw_deg=0.0,
        rows=RowsSettings(
            count=40, length_m=40.0, pitch_m=0.5, first_row_start_map_m=(-20.0, 9.75), yaw_deg=0.0
        ),
        crop=CropSettings(
            spacing_m=0.18, height_spread_ratio=0.2, jitter_m=0.02, missing_ratio=0.05
        ),
        weeds=WeedsSettings(density_per_m2=4.0, cluster_ratio=0.5),
    )
    world = generate_field(plan, SEED)
    if is_rough:
        world = msgspec.structs.replace(world, relief=ROUGH)
    if not is_hilly:
        return world
    y_m, x_m = np.mgrid[-30.0:30.1:0.1, -30.0:30.1:0.1]
    height_m = 0.35 * np.sin(x_m / 3.1) * np.cos(y_m / 4.3) + 0.05 * np.sin(1.7 * x_m + y_m)
    hills = HeightField(x_min_m=-30.0, y_min_m=-30.0, resolution_m=0.1, height_m=height_m)
    return msgspec.structs.replace(world, terrain=hills)


class DenseView:
    """One camera over the field, drawn by one thread, with noise and labels."""

    def __init__(
        self, height_m: float, down_deg: float, *, is_hilly: bool = False, is_rough: bool = False
    ) -> None:
        from agribot.description.loader import load_robot
        from agribot.sim.camera import CameraRenderer
        from agribot.sim.camera.scene import sample_ground_heights
        from agribot.sim.ground_surface import build_ground_surface

        world, camera = dense_field(is_hilly, is_rough), load_robot().camera
        surface = build_ground_surface(world)
        assert camera is not None  # the packaged robot has a camera
        at = np.array([[-18.0, 0.0, 0.0]])
        up_m = height_m + float(sample_ground_heights(world, at, surface)[0])
        pose = transform((-18.0, 0.0, up_m), (0.0, math.radians(down_deg), 0.02))
        self._renderer, self._camera = CameraRenderer(world, threads=1, ground=surface), camera
        self._map_from_camera = pose @ LINK_FROM_OPTICAL

    def render(self) -> None:
        self._renderer.render(self._map_from_camera, self._camera, noise_seed=SEED)


class CameraLoop:
    """Physics, every sensor and the robot's own camera at 30 Hz, on the flat field."""

    def __init__(self) -> None:
        from agribot.description.loader import load_robot
        from agribot.sim.platform import SimPlatform

        settings = config.load("beet", [f"perception.camera_rate_hz={CAMERA_RATE_HZ}"])
        self._platform = SimPlatform(settings, load_robot(), dense_field())
        self._tick_hz = settings.tick_hz
        self.frames = 0

    def advance(self, seconds: float) -> None:
        for _ in range(round(seconds * self._tick_hz)):
            self.frames += len(self._platform.read().frames)
            drive = DriveCommand(v_mps=0.4, yaw_rate_radps=0.05)
            self._platform.write(RobotCommand(t_s=0.0, drive=drive))
