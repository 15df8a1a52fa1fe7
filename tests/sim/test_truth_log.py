"""What only the simulator knows stands in the events, and so on the operator's page."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import msgspec

from agribot.app.truth_log import TruthLog
from agribot.core.messages import PlantClass
from agribot.core.world import Plant, WorldSpec
from agribot.record.events import Event
from agribot.sim.plant_states import PlantStates
from agribot.sim.platform import SimPlatform
from tests.record.record_samples import ticks


def _plant(x_m: float, kind: PlantClass) -> Plant:
    return Plant(
        species="sugar_beet", plant=kind, x_map_m=x_m, y_map_m=2.0, yaw_rad=0.0, size_m=0.1,
        seed=1, stem_radius_m=0.01,
    )  # fmt: skip


def test_a_crop_that_is_sprayed_is_told_once_and_a_weed_is_not(meadow: WorldSpec) -> None:
    plants = (_plant(1.0, PlantClass.WEED), _plant(3.25, PlantClass.CROP))
    states = PlantStates(len(plants))
    simulator = cast(SimPlatform, SimpleNamespace(plants=states))
    told: list[Event] = []
    log = TruthLog(simulator, msgspec.structs.replace(meadow, plants=plants), told.append)
    first, *later = ticks(3)
    log(first)
    assert told == []
    states.spray(0, 1.2)
    states.spray(1, 1.2)
    for record in later:
        log(record)
    (event,) = told
    assert event.kind == "truth"
    assert event.reason == "crop plant sprayed on its heart: 3.25 m east, 2.00 m north"
