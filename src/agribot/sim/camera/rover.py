"""The robot in its own picture: its parts as instances, placed anew for every frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from agribot.core.errors import DescriptionError
from agribot.core.geo import transform
from agribot.core.messages import WHEEL_NAMES, FloatArray, PlantClass, Vec3
from agribot.core.robot import RobotSpec, Shape
from agribot.sim.camera.arrays import Instances
from agribot.sim.camera.solids import build_shape_lods, make_flat_faced
from agribot.sim.flora.mesh import Mesh
from agribot.sim.flora.species import LODS
from agribot.sim.stl import read_stl

ResolveMesh = Callable[[str], Path]


class Rover:
    """Forms of a robot's visuals, and their poses for a pose of its body.

    Raises: DescriptionError: a mesh that cannot be read, or an unknown kind of shape.
    """

    def __init__(self, robot: RobotSpec, resolve_mesh: ResolveMesh) -> None:
        visuals = [(link.name, shape) for link in robot.links for shape in link.visuals]
        self.forms = [_build_lods(shape, resolve_mesh) for _link, shape in visuals]
        self._rgb = np.array([shape.rgba[:3] for _link, shape in visuals], np.float32)
        self._link_from_shape = [shape.origin.matrix() for _link, shape in visuals]
        self._body_from_link = [robot.body_from_link(link) for link, _shape in visuals]
        axes = {joint.child: joint.axis for joint in robot.joints}
        self._wheels = [
            (index, WHEEL_NAMES.index(link), axes[link])
            for index, (link, _shape) in enumerate(visuals)
            if link in WHEEL_NAMES
        ]

    def make_instances(self, first_form: int, layer: int) -> Instances:
        """Make an instance of each visual, not drawn (scale 0) until `place_parts` is called."""
        count = len(self.forms)
        return Instances(
            position=np.zeros((count, 3)),
            rotation=np.zeros((count, 3, 3), np.float32),
            scale=np.zeros(count, np.float32),
            form=np.arange(first_form, first_form + count),
            tint=self._rgb.reshape(count, 3),
            sun=np.ones(count, np.float32),
            layer=np.full(count, layer, np.int64),
            label=np.full(count, int(PlantClass.SOIL), np.uint8),
            id=np.full(count, -1, np.int32),
            solid=np.ones(count, np.uint8),
        )

    def compute_poses(
        self, map_from_body: FloatArray, wheel_angles_rad: Sequence[float] | None
    ) -> FloatArray:
        """Return `map_from_shape` of each visual, (n, 4, 4); wheels as in WHEEL_NAMES."""
        body_from_link = list(self._body_from_link)
        if wheel_angles_rad is not None:
            if len(wheel_angles_rad) != len(WHEEL_NAMES):
                raise DescriptionError(
                    f"{len(wheel_angles_rad)} wheel angles given; pass {len(WHEEL_NAMES)}, in the "
                    f"order {', '.join(WHEEL_NAMES)}"
                )
            for index, wheel, axis in self._wheels:
                body_from_link[index] = body_from_link[index] @ _make_rotation(
                    axis, wheel_angles_rad[wheel]
                )
        local = np.array(body_from_link).reshape(-1, 4, 4)
        return map_from_body @ local @ np.array(self._link_from_shape).reshape(-1, 4, 4)


def place_parts(things: Instances, first: int, map_from_shape: FloatArray) -> None:
    """Show the things from index `first` on at these poses, (n, 4, 4)."""
    things.position[first:] = map_from_shape[:, :3, 3]
    things.rotation[first:] = map_from_shape[:, :3, :3]
    things.scale[first:] = 1.0


def _build_lods(shape: Shape, resolve_mesh: ResolveMesh) -> tuple[Mesh, ...]:
    if shape.kind != "mesh":
        return build_shape_lods(shape)
    return (make_flat_faced(read_stl(resolve_mesh(shape.mesh)) * np.array(shape.size_m)),) * LODS


def _make_rotation(axis: Vec3, angle_rad: float) -> FloatArray:
    """Make the rotation about an axis, (4, 4)."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = transform((0.0, 0.0, 0.0))
    turned[:3, :3] += np.sin(angle_rad) * cross + (1.0 - np.cos(angle_rad)) * cross @ cross
    return turned
