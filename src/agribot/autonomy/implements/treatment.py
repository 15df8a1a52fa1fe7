"""The implement under the mission: whether it may work now, and what it then does."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec
import numpy as np

from agribot.autonomy.implements.kinds import fit_implement
from agribot.autonomy.implements.tool_frame import predict_tool
from agribot.autonomy.implements.zones import ZonedPlants, ZoneMap
from agribot.core.config import TreatmentConfig
from agribot.core.implement.kind import ReportLine
from agribot.core.implement.plants import PlantMap
from agribot.core.implement.spec import ImplementSpec
from agribot.core.messages import ChangeSetting, Estimate, ImplementCommand, RequestEvent

RATE = "rate_lpha"  # a setpoint of a command: litres per hectare, where a prescription states it


class Treatment:
    """Call `step` every tick, tool on or off; a robot without an implement has nothing to do."""

    def __init__(
        self,
        config: TreatmentConfig,
        spec: ImplementSpec | None,
        zones: ZoneMap | None = None,
        plugins: Mapping[str, Any] | None = None,
    ) -> None:
        """Take the implement of the robot, if it has one; it works in `zones` with a rate only.

        `plugins` are `RunConfig.plugins`.
        Raises: DescriptionError: its kind is not registered. ConfigError: its settings do not fit.
        """
        self._config, self._spec, self.zones = config, spec, zones
        self._implement = None if spec is None else fit_implement(spec, config, plugins)

    def apply_events(self, events: Iterable[RequestEvent]) -> None:
        """Switch the treatment on or off under way, when an operator sets it."""
        for event in events:
            request = event.request
            if isinstance(request, ChangeSetting) and request.setting == "treatment.enabled":
                is_on = request.value != 0.0
                self._config = msgspec.structs.replace(self._config, enabled=is_on)

    def step(self, estimate: Estimate, plants: PlantMap, tool_on: bool) -> ImplementCommand:
        """Decide what each section does, from left to right; none without an implement."""
        if self._implement is None:
            return ImplementCommand()
        may_work = self._config.enabled and tool_on and self._can_work(estimate)
        if self.zones is None:
            return self._implement.step(estimate, plants, may_work=may_work)
        zoned = ZonedPlants(plants, self.zones)
        command = self._implement.step(estimate, zoned, may_work=may_work)
        return self._add_rate(command, estimate, self.zones)

    def _add_rate(
        self, command: ImplementCommand, estimate: Estimate, zones: ZoneMap
    ) -> ImplementCommand:
        """Give a sprayer the rate of the zone at its tool point."""
        spec = self._spec
        if spec is None or not spec.wets_ground or not any(command.sections_on):
            return command
        tool = predict_tool(estimate, spec.x_body_m, spec.latency_s)
        place = np.array([tool.x_map_m]), np.array([tool.y_map_m])
        rate_lpha = float(zones.find_rates(*place)[0])
        if not rate_lpha > 0.0:  # the middle of the boom is in no zone, some section is
            return command
        return msgspec.structs.replace(command, setpoints={**command.setpoints, RATE: rate_lpha})

    def report(self) -> tuple[ReportLine, ...]:
        """Return the implement's figures of the run until now."""
        return () if self._implement is None else self._implement.report()

    def _can_work(self, estimate: Estimate) -> bool:
        spec = self._spec
        if spec is None or not estimate.ok or abs(estimate.v_mps) < spec.min_speed_mps:
            return False
        return spec.works_backwards or estimate.v_mps > 0.0
