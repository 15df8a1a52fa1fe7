"""Ground that no part of the robot may enter, as areas in the map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from agribot.core.keep_out import AreaTouch, BodyBox
from agribot.core.messages import FloatArray

Ring = Sequence[tuple[float, float]]
MOST_GROUPS = 16  # largest number of areas that a way leads around; the largest count


class KeepOut:
    """Areas whose corners are `rings_map_m`; where they overlap, both count."""

    def __init__(self, rings_map_m: Sequence[Ring]) -> None:
        import shapely

        self.rings_map_m = tuple(tuple(ring) for ring in rings_map_m)
        areas = np.array([shapely.make_valid(shapely.Polygon(ring)) for ring in self.rings_map_m])
        self._areas = areas
        self._tree = shapely.STRtree(areas)

    def find_touch(self, poses: FloatArray, body: BodyBox, within_m: float) -> AreaTouch | None:
        """Find where a body comes nearest, of `poses` (N, 3) that come nearer than `within_m`."""
        import shapely

        boxes = _draw_boxes(poses, body)
        near, areas = self._tree.query(boxes, predicate="dwithin", distance=within_m)
        if not len(near):
            return None
        away_m = np.asarray(shapely.distance(boxes[near], self._areas[areas]))
        first = int(np.argmin(away_m))
        place = self._areas[areas[first]].representative_point()
        return AreaTouch(int(near[first]), float(away_m[first]), (place.x, place.y))

    def list_rings_around(self, away_m: float) -> list[list[tuple[float, float]]]:
        """List the corners of an upright rectangle at this distance around each group of areas.

        They run counter-clockwise. Areas nearer to each other than twice that are one group.
        """
        import shapely

        grown = shapely.union_all(shapely.buffer(self._areas, away_m, quad_segs=2))
        groups = sorted(shapely.get_parts(grown).tolist(), key=lambda part: -part.area)
        rings = []
        for group in groups[:MOST_GROUPS]:
            west_m, south_m, east_m, north_m = group.bounds
            rings.append([(west_m, south_m), (east_m, south_m), (east_m, north_m),
                          (west_m, north_m)])  # fmt: skip
        return rings


def _draw_boxes(poses: FloatArray, body: BodyBox) -> npt.NDArray[np.object_]:
    """Draw the rectangle of the body at each pose, (N,)."""
    import shapely

    ahead = np.array([body.front_m, -body.rear_m, -body.rear_m, body.front_m])
    left = np.array([1.0, 1.0, -1.0, -1.0]) * body.half_width_m
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x_m, y_m = poses[:, :1] + cos * ahead - sin * left, poses[:, 1:2] + sin * ahead + cos * left
    return np.asarray(shapely.polygons(np.stack([x_m, y_m], axis=-1)))
