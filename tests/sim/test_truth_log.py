"""What only the simulator knows stands in the events, and so on the operator's page."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import msgspec

from agribot.app.truth_log import TruthLog
from agribot.core.messages import PlantClass, TickRecord
from agribot.core.world import Plant, WorldSpec
from agribot.record.events import Event
from agribot.sim.plant_states import PlantStates
from agribot.sim.platform import SimPlatform
from agribot.sim.truth import Truth
from tests.record.record_samples import ticks


def _plant(x_m: float, kind: PlantClass) -> Plant:
    return Plant(
        species="sugar_beet", plant=kind, x_map_m=x_m, y_map_m=2.0, yaw_rad=0.0, size_m=0.1,
        seed=1, stem_radius_m=0.01,
    )  # fmt: skip


def truth_at_start() -> Truth:
    return Truth(t_s=0.0, x_map_m=0.0, y_map_m=0.0, yaw_map_rad=0.0, v_mps=0.0, yaw_rate_radps=0.0,
                 roll_rad=0.0, pitch_rad=0.0)  # fmt: skip


def off_by(record: TickRecord, t_s: float, off_m: float) -> TickRecord:
    """Return a tick of a robot whose position is off to the east, with a level of 0.5 m."""
    estimate = msgspec.structs.replace(
        record.estimate, x_map_m=off_m, y_map_m=0.0, ok=True, protection_m=0.5
    )
    batch = msgspec.structs.replace(record.batch, t_s=t_s)
    return msgspec.structs.replace(record, estimate=estimate, batch=batch)


def test_a_position_that_leaves_its_protection_level_is_an_event_once(meadow: WorldSpec) -> None:
    simulator = cast(SimPlatform, SimpleNamespace(plants=PlantStates(0), truth=truth_at_start))
    found: list[Event] = []
    log = TruthLog(simulator, meadow, found.append)
    (sample,) = ticks(1)
    for t_s, off_m in ((1.0, 0.4), (2.0, 0.62), (2.5, 0.7), (3.0, 0.4), (6.0, 0.8)):
        log(off_by(sample, t_s, off_m))
    assert [(event.t_s, event.kind, event.reason) for event in found] == [
        (2.0, "truth", "position 0.62 m off, above its protection level of 0.50 m"),
        (6.0, "truth", "position 0.80 m off, above its protection level of 0.50 m"),
    ]


def test_a_crop_that_is_sprayed_is_told_once_and_a_weed_is_not(meadow: WorldSpec) -> None:
    plants = (_plant(1.0, PlantClass.WEED), _plant(3.25, PlantClass.CROP))
    states = PlantStates(len(plants))
    simulator = cast(SimPlatform, SimpleNamespace(plants=states, truth=truth_at_start))
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
