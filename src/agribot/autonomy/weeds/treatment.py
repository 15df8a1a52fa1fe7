"""Spot spraying: which nozzles are open now, so that the mapped weeds get hit and no crop does.

Crop is spared twice: around the stems in the map, and wherever the last frames showed its leaves,
so that a closed row, whose plants cannot be told apart, is spared as well. Only leaves of a plant
that stands alone in the map may be sprayed, up to its stem: weeds grow at their tips.

A nozzle answers `latency_s` after its command, so a command is about where the boom will be
then. What really flowed is the command of `latency_s` ago: a weed counts as treated only when
that nozzle passed over it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

import msgspec

from agribot.autonomy.weeds.map import WeedMap
from agribot.autonomy.weeds.no_spray import Disc
from agribot.autonomy.weeds.track import Track
from agribot.core.config import TreatmentConfig
from agribot.core.messages import Estimate, ImplementCommand, OperatorEvent, PlantClass
from agribot.core.robot import SprayerSpec

MIN_SPEED_MPS = 0.05  # slower, a nozzle would flood the spot that it stands over
CROP_STEM_M = 0.02  # radius of a young stem
STEM_MARGIN_M = 0.03  # half the spray's length on the ground, and how well a crop is placed
# Off leaves it is half that length and a cell of the no-spray area.
LEAF_MARGIN_M = 0.03
# Leaf tips of a plant reach so much farther than a disc of its area.
LEAVES_RATIO, MAX_LEAVES_M = 2.0, 0.45
HIT_M = 0.015  # a flat fan wets a line a few centimetres long: so near to its middle is a hit
SAME_TIME_S = 1e-9
MAX_STEP_S = 0.1  # a longer silence between ticks is not credited as spraying

Placed = tuple[Track, float, float]  # with x ahead of the boom and y, body frame, metres


class Treatment:
    """Call `step` every tick, tool on or off."""

    def __init__(self, config: TreatmentConfig, sprayer: SprayerSpec | None) -> None:
        self._config = config
        self._sprayer = sprayer
        self._y_body_m = sprayer.nozzle_y_body_m() if sprayer else ()
        self._closed = (False,) * len(self._y_body_m)
        self._commands: deque[tuple[float, tuple[bool, ...]]] = deque()
        self._finishing: set[int] = set()
        self._last_t_s: float | None = None
        self.weeds_treated = 0
        self.sprayed_m2 = 0.0
        self.passed_m2 = 0.0  # what a boom that is always open would have sprayed

    def listen(self, events: Iterable[OperatorEvent]) -> None:
        """Switch the treatment on or off under way, when an operator sets it."""
        for event in events:
            if event.action == "set" and event.text == "treatment.enabled":
                is_on = event.value != 0.0
                self._config = msgspec.structs.replace(self._config, enabled=is_on)

    def step(self, estimate: Estimate, weed_map: WeedMap, tool_on: bool) -> ImplementCommand:
        """The state of each nozzle from left to right; empty without a sprayer."""
        sprayer = self._sprayer
        if sprayer is None:
            return ImplementCommand()
        active = self._config.enabled and tool_on and self._may_spray(estimate)
        flowing = self._flowing(estimate.t_s - sprayer.latency_s)
        step_m = self._step_m(estimate)
        wanted = self._closed
        if active or any(flowing):
            near = self._near_boom(estimate, weed_map, sprayer)
            self._credit(near, flowing, step_m, weed_map, estimate.t_s)
            if active:
                self.passed_m2 += step_m * sprayer.nozzle_width_m * sprayer.nozzle_count
                opened = self._choose(_after(near, estimate, sprayer), step_m, sprayer)
                wanted = self._spare_leaves(opened, estimate, step_m, weed_map)
        self._commands.append((estimate.t_s, wanted))
        return ImplementCommand(nozzles_open=wanted)

    def _may_spray(self, estimate: Estimate) -> bool:
        return estimate.ok and abs(estimate.v_mps) >= MIN_SPEED_MPS

    def _step_m(self, estimate: Estimate) -> float:
        """Way since the last tick."""
        last_s, self._last_t_s = self._last_t_s, estimate.t_s
        step_s = 0.0 if last_s is None else estimate.t_s - last_s
        return abs(estimate.v_mps) * min(max(step_s, 0.0), MAX_STEP_S)

    def _flowing(self, t_s: float) -> tuple[bool, ...]:
        """The command in force at `t_s`; older ones are dropped."""
        commands = self._commands
        while len(commands) > 1 and commands[1][0] <= t_s + SAME_TIME_S:
            commands.popleft()
        if commands and commands[0][0] <= t_s + SAME_TIME_S:
            return commands[0][1]
        return self._closed

    def _near_boom(
        self, estimate: Estimate, weed_map: WeedMap, sprayer: SprayerSpec
    ) -> list[Placed]:
        """Weeds and confirmed crops that the boom can reach within its latency."""
        guard_m = 2.0 * (CROP_STEM_M + self._config.crop_guard_m)
        ahead_m = abs(estimate.v_mps) * sprayer.latency_s + self._config.margin_m + guard_m
        half_m = self._y_body_m[0] + sprayer.nozzle_width_m / 2.0 + guard_m
        cos_yaw, sin_yaw = math.cos(estimate.yaw_map_rad), math.sin(estimate.yaw_map_rad)
        x_map_m = estimate.x_map_m + cos_yaw * sprayer.x_body_m
        y_map_m = estimate.y_map_m + sin_yaw * sprayer.x_body_m
        # Half sides of the upright rectangle around the turned one, ahead_m by half_m.
        east_m = abs(cos_yaw) * ahead_m + abs(sin_yaw) * half_m
        north_m = abs(sin_yaw) * ahead_m + abs(cos_yaw) * half_m
        near: list[Placed] = []
        for track in weed_map.inside(
            x_map_m - east_m, y_map_m - north_m, x_map_m + east_m, y_map_m + north_m
        ):
            dx_m, dy_m = track.x_map_m - x_map_m, track.y_map_m - y_map_m
            x_m = cos_yaw * dx_m + sin_yaw * dy_m
            if abs(x_m) > ahead_m:
                continue
            if track.is_confirmed or track.plant == PlantClass.WEED:
                near.append((track, x_m, cos_yaw * dy_m - sin_yaw * dx_m))
        return near

    def _credit(
        self,
        near: list[Placed],
        flowing: tuple[bool, ...],
        step_m: float,
        weed_map: WeedMap,
        t_s: float,
    ) -> None:
        """Note what the open nozzles pass over."""
        open_y_m = [y for y, is_open in zip(self._y_body_m, flowing, strict=True) if is_open]
        if not open_y_m or self._sprayer is None:
            return
        width_m = self._sprayer.nozzle_width_m
        self.sprayed_m2 += step_m * width_m * len(open_y_m)
        hit_m = max(step_m, HIT_M)
        for track, x_m, y_m in near:
            if abs(x_m) > hit_m or track.plant != PlantClass.WEED:
                continue
            if any(abs(y_m - nozzle_m) <= width_m / 2.0 for nozzle_m in open_y_m):
                if track.treated_s is None:
                    self.weeds_treated += 1
                    self._finishing.add(track.id)
                weed_map.mark_treated(track, t_s)

    def _choose(self, near: list[Placed], step_m: float, sprayer: SprayerSpec) -> tuple[bool, ...]:
        """The nozzles whose footprint covers a weed to treat and keeps off every crop."""
        half_m = sprayer.nozzle_width_m / 2.0
        window_m = self._config.margin_m + step_m
        targets = [p for p in near if abs(p[1]) <= window_m and self._is_target(p[0])]
        self._finishing.intersection_update({track.id for track, _, _ in targets})
        if not targets:
            return self._closed
        crops = [(x, y) for track, x, y in near if track.plant == PlantClass.CROP]
        is_open = list(self._closed)
        for track, x_m, y_m in targets:
            spare_m = self._spare_m(x_m, y_m, crops)
            if spare_m is None:
                continue
            reach_m = half_m + min(self._config.margin_m, track.std_m)
            for index, nozzle_m in enumerate(self._y_body_m):
                if abs(y_m - nozzle_m) <= reach_m and not any(
                    math.hypot(cx, max(abs(cy - nozzle_m) - half_m, 0.0)) < spare_m
                    for cx, cy in crops
                ):
                    is_open[index] = True
        return tuple(is_open)

    def _spare_leaves(
        self, is_open: tuple[bool, ...], estimate: Estimate, step_m: float, weed_map: WeedMap
    ) -> tuple[bool, ...]:
        """Shut every nozzle that would wet leaves of crop, but for those of a plant by itself.

        Such a plant is in the map, and its stem is spared.
        """
        sprayer = self._sprayer
        if sprayer is None or not any(is_open):
            return is_open
        way_m, turn_rad, course_rad = _way_in_latency(estimate, sprayer)
        yaw_rad = estimate.yaw_map_rad + turn_rad
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        course_map_rad = estimate.yaw_map_rad + course_rad
        x_m = estimate.x_map_m + way_m * math.cos(course_map_rad) + cos * sprayer.x_body_m
        y_m = estimate.y_map_m + way_m * math.sin(course_map_rad) + sin * sprayer.x_body_m
        pose_m = min(estimate.pos_std_m, self._config.margin_m)
        half_x_m = LEAF_MARGIN_M + step_m + pose_m
        half_y_m = sprayer.nozzle_width_m / 2.0 + pose_m
        reach_m = half_x_m + self._y_body_m[0] + half_y_m + MAX_LEAVES_M
        no_spray = weed_map.no_spray
        crops = [
            Disc(track.x_map_m, track.y_map_m, _leaves_m(track))
            for track in weed_map.inside(x_m - reach_m, y_m - reach_m, x_m + reach_m, y_m + reach_m)
            if track.is_confirmed and track.plant == PlantClass.CROP
        ]
        known = [crop for crop in crops if no_spray.is_alone(crop)]
        return tuple(
            wet
            and not no_spray.covers(
                x_m - sin * left_m, y_m + cos * left_m, yaw_rad, half_x_m, half_y_m, known
            )
            for wet, left_m in zip(is_open, self._y_body_m, strict=True)
        )

    def _is_target(self, track: Track) -> bool:
        return (
            track.is_confirmed
            and track.plant == PlantClass.WEED
            and (track.treated_s is None or track.id in self._finishing)
        )

    def _spare_m(self, x_m: float, y_m: float, crops: list[tuple[float, float]]) -> float | None:
        """How far the spray for a weed here must stay from crops; None: leave the weed alone.

        A weed inside the guard ring of a crop may be one of its leaves. One clearly outside it,
        at twice the distance, may be sprayed up to the stem.
        """
        guard_m = CROP_STEM_M + self._config.crop_guard_m
        gap_m = min((math.hypot(cx - x_m, cy - y_m) for cx, cy in crops), default=math.inf)
        if gap_m < guard_m:
            return None
        return guard_m if gap_m < 2.0 * guard_m else CROP_STEM_M + STEM_MARGIN_M


def _leaves_m(track: Track) -> float:
    """How far the leaves of a crop in the map reach from its stem."""
    return min(LEAVES_RATIO * math.sqrt(track.area_m2 / math.pi), MAX_LEAVES_M)


def _way_in_latency(estimate: Estimate, sprayer: SprayerSpec) -> tuple[float, float, float]:
    """Distance, turn, and course against the heading now, until a command takes effect."""
    turn_rad = estimate.yaw_rate_radps * sprayer.latency_s
    way_m = estimate.v_mps * sprayer.latency_s
    return way_m, turn_rad, estimate.slip_rad + turn_rad / 2.0


def _after(near: list[Placed], estimate: Estimate, sprayer: SprayerSpec) -> list[Placed]:
    """The same plants seen from the boom one latency later."""
    way_m, turn_rad, course_rad = _way_in_latency(estimate, sprayer)
    from_x_m = sprayer.x_body_m - way_m * math.cos(course_rad)
    from_y_m = -way_m * math.sin(course_rad)
    cos_turn, sin_turn = math.cos(turn_rad), math.sin(turn_rad)
    return [
        (
            track,
            cos_turn * (x_m + from_x_m) + sin_turn * (y_m + from_y_m) - sprayer.x_body_m,
            cos_turn * (y_m + from_y_m) - sin_turn * (x_m + from_x_m),
        )
        for track, x_m, y_m in near
    ]
