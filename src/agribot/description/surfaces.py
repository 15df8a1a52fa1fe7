"""The look and the friction of a world's ground, from its planes and terrain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.world import GripPatch, GroundTile, HeightField
from agribot.description.elements import SourceFile
from agribot.description.sdf_models import HeightMap, Patch

SAME_HEIGHT_M = 1e-6
WHEEL_REACH_M = 0.2  # about the radius of a large rover's wheel
Rectangle = tuple[float, float, float, float]  # least x and y, greatest x and y
LyingPatch = tuple[FloatArray, Patch]  # map_from_patch (4, 4), and the patch


class Surfaces:
    """The ground of one world; every patch and relief comes with the pose of its model."""

    def __init__(
        self,
        patches: Sequence[tuple[FloatArray, Patch]],
        reliefs: Sequence[tuple[FloatArray, HeightMap]],
        terrain: HeightField | None,
        source: SourceFile,
    ) -> None:
        self._patches = patches
        self._reliefs = reliefs
        self._terrain = terrain
        self._source = source

    def list_tiles(self) -> tuple[GroundTile, ...]:
        """List the visible tiles of the ground; where none is visible, the solid ones.

        Raises: DescriptionError: the world has no ground.
        """
        tiles = [] if self._terrain is None else [_make_terrain_tile(self._terrain)]
        if not self._patches and not tiles:
            raise self._source.fail(
                "ground", "the world has no ground; add a model with a <plane>, see empty.world"
            )
        visible = [pair for pair in self._patches if pair[1].visible] or self._patches
        return tuple(tiles + [self._make_tile(frame, patch) for frame, patch in visible])

    def find_friction(self) -> tuple[float, tuple[GripPatch, ...]]:
        """Return the friction of the ground, and the patches on it that have their own.

        The ground is the terrain, else the largest solid plane. Of patches that overlap the
        upper one counts, and of those at one height the later one.
        """
        if self._terrain is not None:
            felt = [relief.friction_ratio for _, relief in self._reliefs if not relief.visible]
            return next(iter(felt), 1.0), ()
        solid = self._find_within_reach()
        if not solid:
            return 1.0, ()
        base = max(solid, key=lambda pair: pair[1].size_m[0] * pair[1].size_m[1])
        lowest_m = _read_height_m(base) - SAME_HEIGHT_M
        above = [pair for pair in solid if pair is not base and _read_height_m(pair) >= lowest_m]
        above.sort(key=_read_height_m)
        ratio = base[1].friction_ratio
        if all(patch.friction_ratio == ratio for _, patch in above):
            return ratio, ()
        return ratio, tuple(_make_grip_patch(pose, patch) for pose, patch in above)

    def _find_within_reach(self) -> list[LyingPatch]:
        """Return the planes that wheels can touch: no roof above the ground, no sea far below.

        Without terrain the robot drives at height 0; in a world without a plane there, the
        nearest plane is its ground.
        """
        solid = [
            (frame @ patch.model_from_patch, patch)
            for frame, patch in self._patches
            if not patch.visible
        ]
        level_m = min(map(_read_height_m, solid), key=abs, default=0.0)
        return [pair for pair in solid if abs(_read_height_m(pair) - level_m) <= WHEEL_REACH_M]

    def _make_tile(self, map_from_model: FloatArray, patch: Patch) -> GroundTile:
        map_from_patch = map_from_model @ patch.model_from_patch
        if min(abs(map_from_patch[0, 0]), abs(map_from_patch[1, 0])) > 1e-3:
            self._source.warn(
                f"{patch.surface} ground is not laid East to North; its bounding box is used"
            )
        x_min, y_min, x_max, y_max = _find_bounds(map_from_patch, patch)
        return GroundTile(
            surface=patch.surface, x_min_m=x_min, y_min_m=y_min, x_max_m=x_max, y_max_m=y_max
        )


def _read_height_m(lying: LyingPatch) -> float:
    return float(lying[0][2, 3])


def _find_bounds(map_from_patch: FloatArray, patch: Patch) -> Rectangle:
    """Return the bounds of a patch along the axes of the map."""
    half = np.array(patch.size_m) / 2.0
    corners = np.array([[x, y, 0.0, 1.0] for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    at_m = (map_from_patch @ corners.T)[:2]
    x_min, y_min, x_max, y_max = np.round((*at_m.min(axis=1), *at_m.max(axis=1)), 9).tolist()
    return x_min, y_min, x_max, y_max


def _make_grip_patch(map_from_patch: FloatArray, patch: Patch) -> GripPatch:
    x_min, y_min, x_max, y_max = _find_bounds(map_from_patch, patch)
    return GripPatch(
        friction_ratio=patch.friction_ratio,
        x_min_m=x_min, y_min_m=y_min, x_max_m=x_max, y_max_m=y_max,
    )  # fmt: skip


def _make_terrain_tile(terrain: HeightField) -> GroundTile:
    rows, columns = terrain.height_m.shape
    return GroundTile(
        surface="soil",
        x_min_m=terrain.x_min_m,
        y_min_m=terrain.y_min_m,
        x_max_m=terrain.x_min_m + (columns - 1) * terrain.resolution_m,
        y_max_m=terrain.y_min_m + (rows - 1) * terrain.resolution_m,
    )
