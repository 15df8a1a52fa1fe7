"""True ground under a boom: what gets wet, whatever the treatment believes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from agribot.autonomy.implements.treatment import Treatment
from agribot.autonomy.weeds.map import WeedMap
from agribot.core.config import WeedConfig
from agribot.core.implement.sprayer import SprayerSpec
from tests.autonomy.weeds.weed_field import add_sightings, make_estimate

BOOM = SprayerSpec(
    x_body_m=-0.3, section_count=8, section_spacing_m=0.1, section_width_m=0.1, latency_s=0.1
)
FINE = SprayerSpec(
    x_body_m=-0.35, section_count=27, section_spacing_m=0.04, section_width_m=0.04, latency_s=0.05
)
TICK_S = 0.02
JET_M = 0.03  # length of the spray's footprint along the way


@dataclass
class Field:
    """A boom over true plants: liquid leaves an open nozzle `latency_s` after its command."""

    sprayer: SprayerSpec = BOOM
    latency_s: float = BOOM.latency_s
    plants: dict[str, tuple[float, float]] = field(default_factory=dict)
    hit: dict[str, float] = field(default_factory=dict)
    wet_m2: float = 0.0
    closest_m: dict[str, float] = field(default_factory=dict)
    _commands: list[tuple[float, tuple[bool, ...]]] = field(default_factory=list)

    def step(
        self, t_s: float, pose: tuple[float, float, float], nozzles: tuple[bool, ...], step_m: float
    ) -> None:
        self._commands.append((t_s, nozzles))
        at_s = t_s - self.latency_s + 1e-9
        flowing = next((open_ for sent_s, open_ in self._commands[::-1] if sent_s <= at_s), ())
        half_m = self.sprayer.section_width_m / 2
        for y_m, is_open in zip(self.sprayer.section_y_body_m(), flowing, strict=False):
            if not is_open:
                continue
            self.wet_m2 += step_m * self.sprayer.section_width_m
            for name, place in self.plants.items():
                px, py = body_from_map(place, pose)
                x, y = px - self.sprayer.x_body_m, py - y_m
                gap_m = math.hypot(
                    max(abs(x) - max(step_m, JET_M) / 2, 0.0), max(abs(y) - half_m, 0.0)
                )
                self.closest_m[name] = min(gap_m, self.closest_m.get(name, math.inf))
                if gap_m == 0.0:
                    self.hit.setdefault(name, t_s)


def body_from_map(
    place_m: tuple[float, float], pose: tuple[float, float, float]
) -> tuple[float, float]:
    dx, dy = place_m[0] - pose[0], place_m[1] - pose[1]
    cos_yaw, sin_yaw = math.cos(pose[2]), math.sin(pose[2])
    return cos_yaw * dx + sin_yaw * dy, cos_yaw * dy - sin_yaw * dx


def make_map(
    weeds: Sequence[tuple[float, float]], crops: Sequence[tuple[float, float]] = ()
) -> WeedMap:
    weed_map = WeedMap(WeedConfig())
    add_sightings(weed_map, weeds, crops)
    return weed_map


def figure(treatment: Treatment, name: str) -> float:
    """What the implement reports of itself under this name."""
    return next(line.value for line in treatment.report() if line.name == name)


def drive_over(
    treatment: Treatment,
    weed_map: WeedMap,
    truth: Field,
    *,
    from_s: float = 10.0,
    v_mps: float = 0.4,
    way_m: float = 3.0,
    yaw_rate_radps: float = 0.0,
    tool_on: bool = True,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> float:
    """Drive a straight line or an arc; returns the time at its end."""
    x, y, yaw = start
    ticks = round(way_m / abs(v_mps) / TICK_S)
    for i in range(ticks):
        t_s = from_s + i * TICK_S
        estimate = make_estimate(t_s, x, y, yaw, v_mps=v_mps, yaw_rate_radps=yaw_rate_radps)
        command = treatment.step(estimate, weed_map, tool_on)
        truth.step(t_s, (x, y, yaw), command.sections_on, abs(v_mps) * TICK_S)
        middle = yaw + yaw_rate_radps * TICK_S / 2
        x += v_mps * TICK_S * math.cos(middle)
        y += v_mps * TICK_S * math.sin(middle)
        yaw += yaw_rate_radps * TICK_S
    return from_s + ticks * TICK_S
