"""Sections of an implement over the plants of a world: when they work, and what they pass over."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from agribot.core.errors import PlatformError
from agribot.core.implement.spec import ImplementSpec
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.world import WorldSpec
from agribot.sim.footprints import Footprints, build_plant_grid, list_places_m, mark_swept

SAME_TIME_S = 1e-9

Mask = npt.NDArray[np.bool_]


class DelayedSections:
    """Sections that follow a command `latency_s` after it was given."""

    def __init__(self, spec: ImplementSpec) -> None:
        self._spec = spec
        self._off = self._wanted = (False,) * spec.section_count
        self._pending: deque[tuple[float, tuple[bool, ...]]] = deque()
        self.is_on: Mask = np.zeros(spec.section_count, dtype=bool)

    def command(self, t_s: float, sections_on: tuple[bool, ...]) -> None:
        """Switch the sections after the latency; an empty tuple switches all of them off.

        Raises: PlatformError: the number of sections is not that of the robot.
        """
        wanted, words = sections_on or self._off, self._spec.sections
        if len(wanted) != len(self._off):
            raise PlatformError(
                f"command for {len(wanted)} {words}; the robot has {len(self._off)}, "
                "as its description says"
            )
        if wanted != self._wanted:
            self._wanted = wanted
            self._pending.append((t_s + self._spec.latency_s, wanted))

    def advance(self, t_s: float) -> None:
        """Let every command take effect that is due at `t_s`."""
        while self._pending and self._pending[0][0] <= t_s + SAME_TIME_S:
            self.is_on[:] = self._pending.popleft()[1]


class SectionSwath:
    """The ground under the sections, and those plants of a world that they touch.

    `length_m` is how far along the way a section works at once; a plant at `places_m` (N, 2) is
    touched when its disc of `radius_m` (N,) meets that ground. `index` (N,) are the plants' numbers
    in the world.
    """

    def __init__(
        self,
        spec: ImplementSpec,
        places_m: FloatArray,
        radius_m: FloatArray,
        length_m: float,
        base_height_m: float,
        index: Sequence[int] | None = None,
    ) -> None:
        self._index = range(len(places_m)) if index is None else index
        self._grid = build_plant_grid(places_m, radius_m)
        self._hit_s = np.full(len(places_m), np.nan)
        self._feet = Footprints(
            np.array([(spec.x_body_m, y_m) for y_m in spec.section_y_body_m()]),
            length_m / 2.0,
            spec.section_width_m / 2.0,
            base_height_m,
        )

    @classmethod
    def over(
        cls,
        spec: ImplementSpec,
        world: WorldSpec,
        wanted: PlantClass,
        length_m: float,
        base_height_m: float,
    ) -> SectionSwath:
        """Sections over the stems of all plants of a class."""
        index = [i for i, plant in enumerate(world.plants) if plant.plant == wanted]
        plants = [world.plants[i] for i in index]
        radius_m = np.array([plant.stem_radius_m for plant in plants], dtype=float)
        return cls(spec, list_places_m(plants), radius_m, length_m, base_height_m, index)

    def sweep(self, t_s: float, before: FloatArray, after: FloatArray, is_on: Mask) -> float:
        """Work the ground between two rows of the physics history; returns its area in m2."""
        return mark_swept(before, after, self._feet, is_on, self._grid, self._hit_s, t_s)

    @property
    def touched(self) -> dict[int, float]:
        """Index into the world's plants -> time of the first touch."""
        hit = np.flatnonzero(~np.isnan(self._hit_s))
        return {self._index[int(i)]: float(self._hit_s[i]) for i in hit}
