"""What became of the plants of a world in all runs of a job."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

from agribot.core.messages import PlantClass, Row
from agribot.core.world import Plant
from agribot.sim.plant_judge import is_in_strips
from agribot.sim.plant_states import PlantStates
from agribot.sim.safety_judge import Crush
from agribot.sim.scores import CrushedCount, RefereeState
from agribot.sim.underside import Part


class PlantSource(Protocol):
    """The part of a simulator that knows what this run did to plants, by their index."""

    @property
    def crushed(self) -> set[int]: ...
    @property
    def brushed(self) -> set[int]: ...
    @property
    def plants(self) -> PlantStates: ...
    @property
    def treated(self) -> dict[int, float]: ...
    @property
    def wet_leaves(self) -> dict[int, float]: ...
    @property
    def offsets_m(self) -> dict[int, float]: ...
    @property
    def looks(self) -> Mapping[int, int]: ...
    def restore_plants(self, crushed_by: Mapping[int, Part], treated: Sequence[int]) -> None: ...


class JobPlants:
    """Plants by their index in the world; `restore` adds what earlier runs of the job did."""

    def __init__(self, source: PlantSource, plants: Sequence[Plant]) -> None:
        self._source, self._plants = source, plants
        self._before: RefereeState | None = None

    def restore(self, before: RefereeState) -> None:
        """Continue the field of an earlier run, which has the same plants."""
        self._before = before
        self._source.restore_plants(self.crushed_by, before.treated)

    @property
    def crushed_by(self) -> dict[int, Part]:
        """Crushed crops and what crushed each first."""
        by = self._source.plants.crushed_by
        now = {index: Part(by[index]) for index in self._source.crushed}
        before = self._before
        if before is None:
            return now
        wheel = (Part.WHEEL,) * len(before.crushed)
        return now | dict(zip(before.crushed, map(Part, before.crushed_by or wheel), strict=True))

    def list_crushes(self) -> list[tuple[int, Crush]]:
        """List the crops that this run crushed, when and by what."""
        states = self._source.plants
        times = [(index, float(states.crushed_s[index])) for index in self._source.crushed]
        return [
            (index, Crush(t_s=t_s, by=Part(states.crushed_by[index]).name.lower()))
            for index, t_s in times
            if t_s > 0.0  # those of earlier runs lie from the beginning
        ]

    def count_crushed(self) -> CrushedCount:
        by = list(self.crushed_by.values())
        return CrushedCount(**{part.name.lower(): by.count(part) for part in Part})

    @property
    def brushed(self) -> set[int]:
        brushed = self._source.brushed.union(self._before.brushed if self._before else ())
        return brushed - set(self.crushed_by)

    @property
    def treated(self) -> set[int]:
        return set(self._source.treated).union(self._before.treated if self._before else ())

    def count_treated(
        self, kind: PlantClass, strips: Sequence[Row] | None = None, pitch_m: float = 0.0
    ) -> int:
        """Count the plants that the implement worked on, in `strips` only if given."""
        treated = [self._plants[index] for index in self.treated]
        return sum(
            p.plant == kind
            and (strips is None or is_in_strips(p.x_map_m, p.y_map_m, strips, pitch_m))
            for p in treated
        )

    @property
    def wet_leaves(self) -> dict[int, float]:
        """Wet shares of leaf area; those of an earlier run count where they are more."""
        before = self._before.wet_leaves if self._before else {}
        now = self._source.wet_leaves
        return {i: max(before.get(i, 0.0), now.get(i, 0.0)) for i in sorted({*before, *now})}

    def compute_wet_ratio(self, strips: Sequence[Row], pitch_m: float) -> float | None:
        """Return the mean share of leaf area of the crops along rows that got wet."""
        wet = self.wet_leaves
        shares = [
            wet.get(index, 0.0)
            for index, plant in enumerate(self._plants)
            if plant.plant == PlantClass.CROP
            and is_in_strips(plant.x_map_m, plant.y_map_m, strips, pitch_m)
        ]
        return sum(shares) / len(shares) if shares else None

    @property
    def offsets_m(self) -> dict[int, float]:
        """Least distance of the tool from each plant that it worked on."""
        before = self._before.offsets_m if self._before else {}
        now = self._source.offsets_m
        far = math.inf
        return {i: min(before.get(i, far), now.get(i, far)) for i in sorted({*before, *now})}

    @property
    def looks(self) -> dict[int, int]:
        """Count of pictures that showed each plant well enough to be seen."""
        before = self._before.looks if self._before else {}
        now = self._source.looks
        return {i: before.get(i, 0) + now.get(i, 0) for i in sorted({*before, *now})}
