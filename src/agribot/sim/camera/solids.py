"""Meshes of the boxes, cylinders and spheres that obstacles are made of."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.core.errors import DescriptionError
from agribot.core.messages import FloatArray
from agribot.core.robot import Shape
from agribot.sim.flora.mesh import Mesh
from agribot.sim.flora.species import LODS

SIDES = (28, 18, 12, 8, 6)  # sides of round things, by level of detail


def build_shape_lods(shape: Shape) -> tuple[Mesh, ...]:
    """Build all levels of detail of a shape about its own origin.

    Raises: DescriptionError: the shape is a mesh or of an unknown kind.
    """
    if shape.kind == "box":
        return (_make_box(shape.size_m),) * LODS
    if shape.kind == "cylinder":
        return tuple(_make_cylinder(shape.size_m[0], shape.size_m[1], sides) for sides in SIDES)
    if shape.kind == "sphere":
        return tuple(_make_sphere(shape.size_m[0], sides) for sides in SIDES)
    raise DescriptionError(
        f"the camera cannot draw a shape of kind '{shape.kind}'; use box, cylinder or sphere"
    )


def make_flat_faced(triangles_m: FloatArray) -> Mesh:
    """Make a mesh of triangles (n, 3, 3), each with its own normal, without those of no area."""
    normal = np.cross(triangles_m[:, 1] - triangles_m[:, 0], triangles_m[:, 2] - triangles_m[:, 0])
    length = np.linalg.norm(normal, axis=1)
    kept = length > 0.0
    normal = np.repeat(normal[kept] / length[kept, None], 3, axis=0)
    vertices = triangles_m[kept].reshape(-1, 3)
    uv = np.tile([[0.2, 0.2], [0.8, 0.2], [0.5, 0.8]], (int(kept.sum()), 1))
    return _make_mesh(vertices, normal, uv, np.arange(len(vertices)).reshape(-1, 3))


def _make_grid_faces(rows: int, columns: int) -> npt.NDArray[np.int64]:
    """Make two triangles for each cell of a grid of (rows + 1) x (columns + 1) vertices."""
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)[None, :]).ravel()
    b, c, d = a + 1, a + columns + 1, a + columns + 2
    return np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)])


def _make_mesh(
    vertices: FloatArray, normals: FloatArray, uv: FloatArray, faces: npt.NDArray[np.int64]
) -> Mesh:
    single = np.float32
    return Mesh(
        vertices.astype(single), normals.astype(single), uv.astype(single),
        np.ones(len(vertices), single), faces.astype(np.int32),
    )  # fmt: skip


def _make_box(size_m: tuple[float, float, float]) -> Mesh:
    square = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]], dtype=float)
    vertices, normals = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            corner = np.insert(square, axis, sign, axis=1)
            vertices.append(corner * np.array(size_m) / 2)
            normals.append(np.tile(np.eye(3)[axis] * sign, (4, 1)))
    uv = np.tile(square * 0.5 + 0.5, (6, 1))
    faces = (np.array([[0, 1, 3], [0, 3, 2]])[None] + 4 * np.arange(6)[:, None, None]).reshape(
        -1, 3
    )
    return _make_mesh(np.concatenate(vertices), np.concatenate(normals), uv, faces)


def _make_cylinder(radius_m: float, length_m: float, sides: int) -> Mesh:
    angle = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    half = np.array([0.0, 0.0, length_m / 2])
    rim, count = ring * radius_m, sides + 1
    vertices = np.concatenate([rim - half, rim + half, rim - half, rim + half, [-half, half]])
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    normals = np.concatenate([ring, ring, -up, up, [-up[0], up[0]]])
    u = np.linspace(0.0, 1.0, count)
    side_uv = np.concatenate([np.stack([u, 0 * u], 1), np.stack([u, 1 + 0 * u], 1)])
    disc_uv = np.tile(ring[:, :2] * 0.5 + 0.5, (2, 1))
    uv = np.concatenate([side_uv, disc_uv, [[0.5, 0.5]] * 2])
    i = np.arange(sides)
    lids = [
        np.stack(
            [np.full(sides, 4 * count + lid), (2 + lid) * count + i, (2 + lid) * count + i + 1], 1
        )
        for lid in (0, 1)
    ]
    return _make_mesh(vertices, normals, uv, np.concatenate([_make_grid_faces(1, sides), *lids]))


def _make_sphere(radius_m: float, sides: int) -> Mesh:
    rows = max(4, sides // 2)
    polar, turn = np.meshgrid(
        np.linspace(0.0, np.pi, rows + 1), np.linspace(0.0, 2 * np.pi, sides + 1), indexing="ij"
    )
    normals = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1
    ).reshape(-1, 3)
    uv = np.stack([turn / (2 * np.pi), polar / np.pi], axis=-1).reshape(-1, 2)
    return _make_mesh(normals * radius_m, normals, uv, _make_grid_faces(rows, sides))
