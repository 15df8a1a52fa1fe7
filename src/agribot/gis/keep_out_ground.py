"""A field without the areas that must not be entered."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from agribot.autonomy.plan.coverage.area import FieldArea
from agribot.core.errors import MissionError
from agribot.core.facts import KeptOutEverywhere
from agribot.core.messages import MapPoint
from agribot.gis.ground import list_areas


def cut_keep_out(area: FieldArea, rings_map_m: Sequence[Sequence[MapPoint]]) -> FieldArea:
    """Cut areas out of a field; of what they part, the largest ground is the field.

    Raises: MissionError: they leave nothing of it.
    """
    import shapely

    outer = shapely.Polygon(area.boundary, area.holes)
    taken = shapely.union_all([shapely.make_valid(shapely.Polygon(ring)) for ring in rings_map_m])
    if not rings_map_m or not taken.intersects(outer):
        return area
    parts = sorted(list_areas(outer.difference(taken)), key=lambda part: -part.area)
    if not parts:
        raise MissionError(KeptOutEverywhere())
    left_out = area.left_out
    if len(parts) > 1:
        more_m2 = sum(part.area for part in parts[1:])
        said = f"field.keep_out: {more_m2:.1f} m2 are cut off from the rest of the field"
        left_out = "; ".join(line for line in (left_out, said) if line)
    return msgspec.structs.replace(
        area,
        boundary=tuple(parts[0].exterior.coords[:-1]),
        holes=tuple(tuple(ring.coords[:-1]) for ring in parts[0].interiors),
        left_out=left_out,
    )
