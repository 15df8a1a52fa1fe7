"""Walkers in the picture: the parts of rigid figures that move together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.world import Obstacle, Walker
from agribot.sim.camera.arrays import Instances


class Figures:
    """The figures of walkers; their parts are instances from index `first` on.

    They cast no shadow: those on the ground are drawn once, for what stands still.
    """

    def __init__(self, walkers: Sequence[Walker], first: int) -> None:
        self._first = first
        self._owner = np.repeat(np.arange(len(walkers)), [len(w.shapes) for w in walkers])
        local = [shape.origin.matrix() for walker in walkers for shape in walker.shapes]
        self._walker_from_part = np.array(local).reshape(-1, 4, 4)

    def place(self, things: Instances, map_from_walker: Sequence[FloatArray]) -> None:
        """Put every walker at its pose, (4, 4)."""
        if len(self._owner):
            poses = np.array(map_from_walker)[self._owner] @ self._walker_from_part
            parts = slice(self._first, self._first + len(poses))
            things.position[parts], things.rotation[parts] = poses[:, :3, 3], poses[:, :3, :3]


def stand_at_start(walkers: Sequence[Walker]) -> tuple[Obstacle, ...]:
    """Make obstacles of walkers where they are at the beginning, on level ground."""
    made = []
    for walker in walkers:
        x_m, y_m, yaw_rad = walker.find_place(0.0)
        made.append(
            Obstacle(
                name=walker.name, kind=walker.kind, x_map_m=x_m, y_map_m=y_m, z_map_m=0.0,
                yaw_rad=yaw_rad, shapes=walker.shapes,
            )
        )  # fmt: skip
    return tuple(made)
