"""A plant of the weed map, as recordings, pages and files of it show it."""

from __future__ import annotations

import msgspec

from agribot.messages import PlantClass


class MappedPlant(msgspec.Struct, frozen=True, kw_only=True):
    """Position, 2x2 covariance (row by row) and the evidence for it."""

    id: int
    plant: PlantClass
    x_map_m: float
    y_map_m: float
    cov_m2: tuple[float, float, float, float]
    area_m2: float
    confidence: float
    sightings: int
    first_seen_s: float
    last_seen_s: float
    treated_s: float | None = None
