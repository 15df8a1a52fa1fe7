"""Leaves as curved strips, and the meshes with normals and tones that are built from them.

A leaf is a midrib that leaves its base at an angle and bends down, with a blade of varying
width folded about it. The same fine midrib serves all levels of detail, so that a plant keeps
its outline when the level changes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray

FINE_POINTS = 25  # points of the midrib from which every level of detail is taken
Profile = Callable[[FloatArray], FloatArray]


class Mesh(NamedTuple):
    """Triangles: vertices, unit normals (N, 3), uv (N, 2), tone (N,), faces (M, 3).

    `uv` is u across a leaf and v from its base to its tip, `tone` a factor on the brightness.
    """

    vertices_m: npt.NDArray[np.float32]
    normals: npt.NDArray[np.float32]
    uv: npt.NDArray[np.float32]
    tone: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]

    def scale(self, factor: float) -> Mesh:
        return self._replace(vertices_m=(self.vertices_m * np.float32(factor)))

    @property
    def height_m(self) -> float:
        return float(self.vertices_m[:, 2].max())


class Leaves(NamedTuple):
    """Leaves of one kind; every field is (n,), `base` (n, 3). Lengths in units of the plant.

    `pitch_rad` is the angle over the horizontal at the base, `curl_rad` how much it drops to
    the tip, `fold` and `wave` are ratios of the half width, `petiole` (one number for all) is
    the share of the length without blade.
    """

    length: FloatArray
    width: FloatArray
    pitch_rad: FloatArray
    curl_rad: FloatArray
    yaw_rad: FloatArray
    fold: FloatArray
    twist_rad: FloatArray
    wave: FloatArray
    phase_rad: FloatArray
    tone: FloatArray
    base: FloatArray
    petiole: float
    profile: Profile


class _Edges(NamedTuple):
    """Left edge, midrib and right edge of the leaves at the stations, each (n, s, 3)."""

    left: FloatArray
    middle: FloatArray
    right: FloatArray


def _compute_widths(leaves: Leaves, along: FloatArray) -> FloatArray:
    """Return the half widths at the stations `along` (s,), (n, s)."""
    blade = np.clip((along - leaves.petiole) / (1.0 - leaves.petiole), 0.0, 1.0)
    shape = np.where(along < leaves.petiole, 0.0, leaves.profile(blade))
    return 0.5 * leaves.width[:, None] * np.maximum(shape, 0.07)


def _trace_edges(leaves: Leaves, stations: npt.NDArray[np.int64]) -> _Edges:
    along = np.linspace(0.0, 1.0, FINE_POINTS)
    angle = leaves.pitch_rad[:, None] - leaves.curl_rad[:, None] * along**1.3
    step = leaves.length[:, None] / (FINE_POINTS - 1)
    between = 0.5 * (angle[:, 1:] + angle[:, :-1])
    start = np.zeros((len(leaves.length), 1))
    x = np.hstack([start, np.cumsum(np.cos(between) * step, axis=1)])[:, stations]
    z = np.hstack([start, np.cumsum(np.sin(between) * step, axis=1)])[:, stations]
    angle, along = angle[:, stations], along[stations]
    half = _compute_widths(leaves, along)
    turn = leaves.twist_rad[:, None] * along
    up = np.stack([-np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)
    side = np.sin(turn)[..., None] * up
    side[..., 1] += np.cos(turn)
    middle = np.stack([x, np.zeros_like(x), z], axis=-1)
    ripple = leaves.wave[:, None] * np.sin(9.0 * along + leaves.phase_rad[:, None])
    lift_left = (half * (leaves.fold[:, None] + ripple))[..., None] * up
    lift_right = (half * (leaves.fold[:, None] - ripple))[..., None] * up
    across = half[..., None] * side
    placed = (_place_points(leaves, part) for part in (middle + across + lift_left, middle,
                                                 middle - across + lift_right))  # fmt: skip
    return _Edges(*placed)


def find_on_midrib(leaves: Leaves, along: float) -> tuple[FloatArray, FloatArray]:
    """Return the points at a share of each leaf's length, (n, 3), and its pitch there, (n,)."""
    at = np.linspace(0.0, along, FINE_POINTS)
    angle = leaves.pitch_rad[:, None] - leaves.curl_rad[:, None] * at**1.3
    step = along * leaves.length[:, None] / (FINE_POINTS - 1)
    between = 0.5 * (angle[:, 1:] + angle[:, :-1])
    out = np.sum(np.cos(between) * step, axis=1)
    points = [out, np.zeros_like(out), np.sum(np.sin(between) * step, axis=1)]
    return _place_points(leaves, np.stack(points, axis=-1)[:, None, :])[:, 0], angle[:, -1]


def _place_points(leaves: Leaves, points: FloatArray) -> FloatArray:
    """Turn points (n, s, 3) by each leaf's yaw and move them to its base."""
    cos, sin = np.cos(leaves.yaw_rad)[:, None], np.sin(leaves.yaw_rad)[:, None]
    x, y = points[..., 0], points[..., 1]
    turned = np.stack([cos * x - sin * y, sin * x + cos * y, points[..., 2]], axis=-1)
    placed: FloatArray = turned + leaves.base[:, None, :]
    return placed


def build_leaf_strips(leaves: Leaves, segments: int) -> Mesh:
    """Build folded strips of `segments` pairs of quads, the petiole being one of them."""
    first = round(leaves.petiole * (FINE_POINTS - 1))
    blade = np.linspace(first, FINE_POINTS - 1, segments + (first == 0)).round().astype(np.int64)
    stations = blade if first == 0 else np.concatenate([[0], blade])
    edges = _trace_edges(leaves, stations)
    count, size = len(leaves.length), len(stations)
    vertices = np.stack(edges, axis=2).reshape(-1, 3)
    u, v = np.meshgrid([0.04, 0.5, 0.96], stations / (FINE_POINTS - 1.0))
    uv = np.tile(np.stack([u, v], axis=-1).reshape(-1, 2), (count, 1))
    quads = []
    for row in range(size - 1):
        for column in (0, 1):
            a = 3 * row + column
            quads += [[a, a + 1, a + 4], [a, a + 4, a + 3]]
    faces = (np.array(quads)[None] + (np.arange(count) * 3 * size)[:, None, None]).reshape(-1, 3)
    return _finish_mesh(vertices, uv, np.repeat(leaves.tone, 3 * size), faces)


def build_leaf_triangles(leaves: Leaves, widen: float) -> Mesh:
    """Build one triangle for each leaf, from the broad part of the blade to the tip."""
    first = round(leaves.petiole * (FINE_POINTS - 1))
    stations = np.array([round(0.8 * first + 0.2 * (FINE_POINTS - 1)), FINE_POINTS - 1])
    edges = _trace_edges(leaves._replace(width=leaves.width * widen), stations)
    corners = (edges.left[:, 0], edges.right[:, 0], edges.middle[:, 1])
    count, v = len(leaves.length), stations / (FINE_POINTS - 1.0)
    uv = np.tile([[0.1, v[0]], [0.9, v[0]], [0.5, v[1]]], (count, 1))
    faces = np.arange(3 * count).reshape(-1, 3)
    vertices = np.stack(corners, axis=1).reshape(-1, 3)
    return _finish_mesh(vertices, uv, np.repeat(leaves.tone, 3), faces)


def build_leaf_rhombi(leaves: Leaves, widen: float, *, folded: bool = False) -> Mesh:
    """Build two triangles for each leaf (base of the blade, widest place, tip), four if folded."""
    first = round(leaves.petiole * (FINE_POINTS - 1))
    stations = np.array([first, round(0.55 * first + 0.45 * (FINE_POINTS - 1)), FINE_POINTS - 1])
    edges = _trace_edges(leaves._replace(width=leaves.width * widen), stations)
    corners = [edges.middle[:, 0], edges.left[:, 1], edges.right[:, 1], edges.middle[:, 2]]
    v = stations / (FINE_POINTS - 1.0)
    uv = [[0.5, v[0]], [0.1, v[1]], [0.9, v[1]], [0.5, v[2]]]
    corner = np.array([[0, 2, 1], [1, 2, 3]])
    if folded:
        corners.append(edges.middle[:, 1])
        uv.append([0.5, v[1]])
        corner = np.array([[0, 4, 1], [0, 2, 4], [1, 4, 3], [4, 2, 3]])
    vertices = np.stack(corners, axis=1).reshape(-1, 3)
    count, size = len(leaves.length), len(corners)
    faces = (corner[None] + (np.arange(count) * size)[:, None, None]).reshape(-1, 3)
    return _finish_mesh(vertices, np.tile(uv, (count, 1)), np.repeat(leaves.tone, size), faces)


def compute_vertex_normals(vertices: FloatArray, faces: npt.NDArray[np.int64]) -> FloatArray:
    """Average the normals of the faces (M, 3) around each vertex (N, 3) to unit normals (N, 3)."""
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    total = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(total, faces[:, k], normal)
    unit: FloatArray = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)
    return unit


def _finish_mesh(
    vertices: FloatArray, uv: FloatArray, tone: FloatArray, faces: npt.NDArray[np.int64]
) -> Mesh:
    normals = compute_vertex_normals(vertices, faces)
    single = np.float32
    return Mesh(
        vertices.astype(single), normals.astype(single), uv.astype(single), tone.astype(single),
        faces.astype(np.int32),
    )  # fmt: skip


def merge_meshes(parts: Sequence[Mesh]) -> Mesh:
    """Merge several meshes into one."""
    start = np.cumsum([0] + [len(part.vertices_m) for part in parts[:-1]])
    faces = [part.faces + np.int32(first) for part, first in zip(parts, start, strict=True)]
    return Mesh(
        vertices_m=np.concatenate([part.vertices_m for part in parts]),
        normals=np.concatenate([part.normals for part in parts]),
        uv=np.concatenate([part.uv for part in parts]),
        tone=np.concatenate([part.tone for part in parts]),
        faces=np.concatenate(faces),
    )
