"""The tree of coordinate frames of one network, from its transforms."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable
from typing import Any

import numpy as np

from agribot.core.messages import FloatArray

MOST_FRAMES = 1000
_LONGEST_CHAIN = 64


class FrameTree:
    """The newest transform of each frame to its parent. Any thread may call.

    Names are without a leading slash, as in ROS 2.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._parents: dict[str, tuple[str, FloatArray]] = {}

    def add(self, transforms: Iterable[Any]) -> None:
        """Take geometry_msgs/TransformStamped; one that is not finite is left out."""
        for each in transforms:
            matrix = matrix_of(each.transform.translation, each.transform.rotation)
            child, parent = clean_name(each.child_frame_id), clean_name(each.header.frame_id)
            if matrix is not None and child and child != parent:
                self.set(parent, child, matrix)

    def set(self, parent: str, child: str, parent_from_child: FloatArray) -> None:
        """Set the transform (4, 4) of a frame; those above `MOST_FRAMES` are left out."""
        with self._lock:
            if child in self._parents or len(self._parents) < MOST_FRAMES:
                self._parents[child] = (parent, parent_from_child)

    @property
    def frames(self) -> tuple[str, ...]:
        """The names of all frames."""
        with self._lock:
            return tuple(sorted({*self._parents, *(p for p, _ in self._parents.values())}))

    def find(self, target: str, source: str) -> FloatArray | None:
        """Find the transform (4, 4) of points in `source` to `target`; None without one."""
        with self._lock:
            from_source, from_target = self._chain(source), self._chain(target)
        common = next((frame for frame in from_source if frame in from_target), None)
        if common is None:
            return None
        inverse: FloatArray = np.linalg.inv(from_target[common]).astype(np.float64)
        return inverse @ from_source[common]

    def _chain(self, frame: str) -> dict[str, FloatArray]:
        """List the frames above this one, each with the transform to it."""
        chain = {frame: np.eye(4)}
        while frame in self._parents and len(chain) < _LONGEST_CHAIN:
            parent, matrix = self._parents[frame]
            if parent in chain:
                break
            chain[parent] = matrix @ chain[frame]
            frame = parent
        return chain


def clean_name(frame: str) -> str:
    return frame.strip().lstrip("/")


def matrix_of(translation: Any, rotation: Any) -> FloatArray | None:
    """Make a transform (4, 4) of a vector and a quaternion; None where they are not finite.

    A quaternion of zeros, which many programs send, is no rotation.
    """
    x, y, z, w = (float(getattr(rotation, name)) for name in "xyzw")
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    place = [float(getattr(translation, name)) for name in "xyz"]
    if not math.isfinite(norm + sum(place)):
        return None
    matrix = np.eye(4)
    matrix[:3, 3] = place
    if norm > 0.0:
        x, y, z, w = x / norm, y / norm, z / norm, w / norm
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    return matrix
