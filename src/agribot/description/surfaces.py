"""What the ground of a world looks like and how it grips, from the planes and terrain it has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.world import GripPatch, GroundTile, HeightField
from agribot.description.elements import Source
from agribot.description.sdf_models import Patch, Relief

SAME_HEIGHT_M = 1e-6
WHEEL_REACH_M = 0.2  # about the radius of a large rover's wheel
Rectangle = tuple[float, float, float, float]  # least x and y, greatest x and y
Lying = tuple[FloatArray, Patch]  # a patch, and where its middle lies in the map


class Surfaces:
    """The ground of one world; every patch and relief comes with the pose of its model."""

    def __init__(
        self,
        patches: Sequence[tuple[FloatArray, Patch]],
        reliefs: Sequence[tuple[FloatArray, Relief]],
        terrain: HeightField | None,
        source: Source,
    ) -> None:
        self._patches = patches
        self._reliefs = reliefs
        self._terrain = terrain
        self._source = source

    def tiles(self) -> tuple[GroundTile, ...]:
        """What is seen of the ground; where nothing is to be seen, what is felt.

        Raises: DescriptionError: the world has no ground.
        """
        tiles = [] if self._terrain is None else [_terrain_tile(self._terrain)]
        if not self._patches and not tiles:
            raise self._source.fail(
                "ground", "the world has no ground; add a model with a <plane>, see empty.world"
            )
        visible = [pair for pair in self._patches if pair[1].visible] or self._patches
        return tuple(tiles + [self._tile(frame, patch) for frame, patch in visible])

    def friction(self) -> tuple[float, tuple[GripPatch, ...]]:
        """Friction of the ground at large, and the patches that lie on it with their own.

        The ground at large is the terrain, else the largest plane that is felt. Of patches that
        overlap the upper one is felt, and of those at one height the later one.
        """
        if self._terrain is not None:
            felt = [relief.friction_ratio for _, relief in self._reliefs if not relief.visible]
            return next(iter(felt), 1.0), ()
        solid = self._within_reach()
        if not solid:
            return 1.0, ()
        base = max(solid, key=lambda pair: pair[1].size_m[0] * pair[1].size_m[1])
        lowest_m = _height_m(base) - SAME_HEIGHT_M
        above = [pair for pair in solid if pair is not base and _height_m(pair) >= lowest_m]
        above.sort(key=_height_m)
        ratio = base[1].friction_ratio
        if all(patch.friction_ratio == ratio for _, patch in above):
            return ratio, ()
        return ratio, tuple(_grip_patch(pose, patch) for pose, patch in above)

    def _within_reach(self) -> list[Lying]:
        """Planes that wheels can touch, neither a roof above the ground nor a sea far below.

        Without terrain the robot drives at height 0; a world that has its ground elsewhere means
        the plane that is nearest to it.
        """
        solid = [
            (frame @ patch.model_from_patch, patch)
            for frame, patch in self._patches
            if not patch.visible
        ]
        level_m = min(map(_height_m, solid), key=abs, default=0.0)
        return [pair for pair in solid if abs(_height_m(pair) - level_m) <= WHEEL_REACH_M]

    def _tile(self, map_from_model: FloatArray, patch: Patch) -> GroundTile:
        map_from_patch = map_from_model @ patch.model_from_patch
        if min(abs(map_from_patch[0, 0]), abs(map_from_patch[1, 0])) > 1e-3:
            self._source.warn(
                f"{patch.surface} ground is not laid East to North; its bounding box is used"
            )
        x_min, y_min, x_max, y_max = _rectangle(map_from_patch, patch)
        return GroundTile(
            surface=patch.surface, x_min_m=x_min, y_min_m=y_min, x_max_m=x_max, y_max_m=y_max
        )


def _height_m(lying: Lying) -> float:
    return float(lying[0][2, 3])


def _rectangle(map_from_patch: FloatArray, patch: Patch) -> Rectangle:
    """Bounds of a patch along the axes of the map."""
    half = np.array(patch.size_m) / 2.0
    corners = np.array([[x, y, 0.0, 1.0] for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    at_m = (map_from_patch @ corners.T)[:2]
    x_min, y_min, x_max, y_max = np.round((*at_m.min(axis=1), *at_m.max(axis=1)), 9).tolist()
    return x_min, y_min, x_max, y_max


def _grip_patch(map_from_patch: FloatArray, patch: Patch) -> GripPatch:
    x_min, y_min, x_max, y_max = _rectangle(map_from_patch, patch)
    return GripPatch(
        friction_ratio=patch.friction_ratio,
        x_min_m=x_min, y_min_m=y_min, x_max_m=x_max, y_max_m=y_max,
    )  # fmt: skip


def _terrain_tile(terrain: HeightField) -> GroundTile:
    rows, columns = terrain.height_m.shape
    return GroundTile(
        surface="soil",
        x_min_m=terrain.x_min_m,
        y_min_m=terrain.y_min_m,
        x_max_m=terrain.x_min_m + (columns - 1) * terrain.resolution_m,
        y_max_m=terrain.y_min_m + (rows - 1) * terrain.resolution_m,
    )
