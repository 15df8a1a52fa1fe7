"""How far from the robot a way may begin or end: looked at before anything is planned."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import TooFarAway
from agribot.core.messages import MapPoint


def check_reach(
    places_map_m: Sequence[MapPoint], here_map_m: MapPoint, config: MissionConfig
) -> None:
    """Refuse a way whose nearest place is too far from the robot; no places are near enough.

    Raises: MissionError: with the distance and the limit.
    """
    if not places_map_m:
        return
    away_m = min(math.dist(here_map_m, place) for place in places_map_m)
    limit_m = config.max_waypoint_distance_m
    if not away_m <= limit_m:
        raise MissionError(TooFarAway(away_m, limit_m))
