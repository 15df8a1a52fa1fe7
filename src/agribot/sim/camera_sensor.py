"""Camera frames at their rate, and the true masks of the last ones for the referee."""

from __future__ import annotations

import logging
import math
from collections import OrderedDict
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.errors import DescriptionError
from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import ByteArray, CameraFrame, FloatArray, PlantClass, Vec3
from agribot.core.robot import CameraSpec, RobotSpec, Shape
from agribot.core.world import Obstacle, WorldSpec
from agribot.sim.attitude import read_base_pose
from agribot.sim.ground_surface import GroundSurface, build_ground_surface
from agribot.sim.kernel import sample_grid
from agribot.sim.plant_states import PlantStates
from agribot.sim.state import WHEEL_ANGLE
from agribot.sim.walkers import place_walkers

if TYPE_CHECKING:
    from agribot.sim.camera import CameraRenderer, Rendering

KEPT_MASKS = 20
LOOK_PX = 30  # visible pixels of a plant in a picture that count as a look at it
_LOG = logging.getLogger(__name__)


class TrueView(NamedTuple):
    """True content of a frame, and `map_from_camera` (4, 4) of the optical frame."""

    frame_index: int
    picture: Rendering
    camera: CameraSpec
    map_from_camera: FloatArray
    ground: GroundSurface


class CameraSensor:
    """The simulated camera as a sensor: frames from rows of the physics history.

    `noise` is the stream of the noise seeds of the frames, or None for clean images. With
    `has_body` the robot itself and its shadow are in the picture. `plants` says which of them
    lie, on `ground`; without them all stand, and with `keeps_weeds` the weeds do. The constructor
    compiles the renderer, so that the first picture takes no longer than any other. `looks` (N,)
    counts for each plant of the world the pictures that showed `LOOK_PX` of it.
    """

    def __init__(
        self,
        robot: RobotSpec,
        camera: CameraSpec,
        world: WorldSpec,
        noise: np.random.Generator | None,
        *,
        has_body: bool = False,
        plants: PlantStates | None = None,
        keeps_weeds: bool = False,
        ground: GroundSurface | None = None,
    ) -> None:
        # Compiling the renderer takes seconds; runs without a camera must not pay for it.
        from agribot.sim.camera import CameraRenderer

        self._world = world
        self._visible = keep_drawable(robot) if has_body else None
        self._ground = build_ground_surface(world) if ground is None else ground
        self._renderer: CameraRenderer = CameraRenderer(world, self._visible, ground=self._ground)
        self._base_from_body = transform((0.0, 0.0, -robot.base_height_m)) if has_body else None
        self._camera = camera
        self._base_from_mount = robot.base_from_link(camera.link) @ LINK_FROM_OPTICAL
        self._base_from_camera = self._base_from_mount
        self._noise = noise
        self._plants = PlantStates(len(world.plants)) if plants is None else plants
        self._places_map_m = [(plant.x_map_m, plant.y_map_m) for plant in world.plants]
        self._may_lie = [p.plant == PlantClass.CROP or not keeps_weeds for p in world.plants]
        self._walkers = world.walkers
        self._shown: dict[int, int] = {}  # plants that lie -> how old they are in the picture
        self.looks: npt.NDArray[np.int64] = np.zeros(len(world.plants), dtype=np.int64)
        self.view_taps: list[Callable[[TrueView], None]] = []  # called before a frame goes out
        self._index = 0
        self._masks: OrderedDict[int, ByteArray] = OrderedDict()
        self._draw(transform((0.0, 0.0, robot.base_height_m)), None if noise is None else 0, None)

    def sample(self, t_s: float, row: FloatArray) -> CameraFrame:
        """Render the view from one row of the physics history."""
        seed = None if self._noise is None else int(self._noise.integers(2**31))
        if self._plants.fallen:
            self._lay_plants(t_s)
        if self._walkers:
            self._renderer.set_walkers(place_walkers(self._walkers, self._ground, t_s))
        base = read_base_pose(row)
        self._renderer.follow_ground(float(base[0, 3]), float(base[1, 3]))
        picture = self._draw(base, seed, row[WHEEL_ANGLE].tolist())
        frame = CameraFrame(t_s=t_s, index=self._index, image_rgb=picture.image_rgb)
        self._masks[self._index] = picture.class_id
        self._count_looks(picture.instance)
        self._show(picture, base)
        if len(self._masks) > KEPT_MASKS:
            self._masks.popitem(last=False)
        self._index += 1
        return frame

    def _show(self, picture: Rendering, base: FloatArray) -> None:
        pose = base @ self._base_from_camera
        view = TrueView(self._index, picture, self._camera, pose, self._ground)
        for tap in self.view_taps:
            tap(view)

    def _count_looks(self, instance: npt.NDArray[np.int32]) -> None:
        """Count a look at each plant that shows enough pixels in a picture."""
        pixels = np.bincount(instance.ravel() + 1, minlength=len(self.looks) + 1)[1:]
        self.looks += pixels[: len(self.looks)] >= LOOK_PX

    def _lay_plants(self, t_s: float) -> None:
        """Show what fell, and what became darker since the last picture."""
        from agribot.sim.camera.lying import LOOK_STEP_S, LyingPlant

        states, lying = self._plants, []
        for index in states.fallen:
            age_s = t_s - states.find_fall_s(index)
            look = int(age_s / LOOK_STEP_S)
            if self._may_lie[index] and self._shown.get(index) != look:
                self._shown[index] = look
                way_rad, is_cut = float(states.way_rad[index]), not states.crushed_by[index]
                up = self._find_normal(index)
                lying.append(LyingPlant(index, way_rad, up, look * LOOK_STEP_S, is_cut))
        self._renderer.set_plants(lying)

    def _find_normal(self, index: int) -> Vec3:
        """Return the normal of the ground below a plant."""
        _, slope_x, slope_y = sample_grid(self._ground.make_grid(), *self._places_map_m[index])
        up = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        return -slope_x * up, -slope_y * up, up

    def add_obstacle(self, obstacle: Obstacle) -> None:
        """Let an obstacle stand in the pictures from now on."""
        from agribot.sim.camera import CameraRenderer

        obstacles = (*self._world.obstacles, obstacle)
        self._world = msgspec.structs.replace(self._world, obstacles=obstacles)
        self._renderer = CameraRenderer(self._world, self._visible, ground=self._ground)
        self._shown.clear()

    def shift_mount(self, left_m: float) -> None:
        """Move the camera to `left_m` left of its mount for all later pictures."""
        self._base_from_camera = transform((0.0, left_m, 0.0)) @ self._base_from_mount

    def _draw(
        self, base: FloatArray, noise_seed: int | None, wheel_angles_rad: list[float] | None
    ) -> Rendering:
        body = self._base_from_body
        return self._renderer.render(
            base @ self._base_from_camera,
            self._camera,
            noise_seed=noise_seed,
            map_from_body=None if body is None else base @ body,
            wheel_angles_rad=None if body is None else wheel_angles_rad,
        )

    def truth_mask(self, frame_index: int) -> ByteArray | None:
        """Return the true class ids of a recent frame, (height, width); None if it is too old."""
        return self._masks.get(frame_index)


def keep_drawable(robot: RobotSpec) -> RobotSpec:
    """Return the robot without the visuals whose meshes cannot be read; warn of each."""
    from agribot.sim.stl import find_mesh_file, read_stl

    def can_be_drawn(shape: Shape) -> bool:
        try:
            if shape.kind == "mesh":
                read_stl(find_mesh_file(shape.mesh))
        except DescriptionError as error:
            _LOG.warning("left out of the camera's picture: %s", error)
            return False
        return True

    links = tuple(
        msgspec.structs.replace(link, visuals=tuple(filter(can_be_drawn, link.visuals)))
        for link in robot.links
    )
    return msgspec.structs.replace(robot, links=links)
