"""A weed map that a later run takes over."""

from __future__ import annotations

import msgspec

from agribot.autonomy.weeds.map import WeedMap
from agribot.autonomy.weeds.track import Track
from agribot.core.config import WeedConfig
from agribot.core.messages import PlantClass
from tests.mission.test_one_job import weed


def test_a_map_that_was_saved_goes_on_with_numbers_places_and_treatments() -> None:
    first, later = WeedMap(WeedConfig()), WeedMap(WeedConfig())
    first.restore([weed(4, 1.0, 2.0, None), weed(9, 3.0, 2.0, 12.5)])
    saved = msgspec.json.encode(first.tracks)
    later.restore(track.earlier(20.0) for track in msgspec.json.decode(saved, type=list[Track]))
    plants = {plant.id: plant for plant in later.weeds()}
    assert set(plants) == {4, 9}
    assert plants[9].treated_s == -7.5 and plants[4].treated_s is None
    assert plants[4].plant is PlantClass.WEED
    assert (plants[9].x_map_m, plants[9].y_map_m) == (3.0, 2.0)
    (here,) = later.inside(2.9, 1.9, 3.1, 2.1)
    assert here.id == 9
    fresh = weed(later._next_id, 5.0, 5.0, None)
    assert fresh.id == 10
