"""`plot`: keeps heading, distance and drive over time, for a figure and a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from agribot.core import topics
from agribot.core.topics import Topic
from agribot.ros.nodes.stage import EndlessStage, OutgoingMessage

MAX_SAMPLES = 200_000  # samples of one topic: hours at 20 Hz

SERIES = {
    topics.HEADING_RAW.name: "heading_raw_deg",
    topics.HEADING_FILTERED.name: "heading_filtered_deg",
    topics.ANGLE.name: "heading_error_deg",
    topics.DISTANCE.name: "distance_m",
    topics.BEARING.name: "bearing_deg",
}


class Plot(EndlessStage):
    """`series` maps a name with its unit to (t_s, value), by the runner's clock from zero."""

    inputs = (
        topics.HEADING_RAW, topics.HEADING_FILTERED, topics.ANGLE, topics.DISTANCE,
        topics.BEARING, topics.CMD_VEL,
    )  # fmt: skip
    outputs = ()

    def __init__(self) -> None:
        names = (*SERIES.values(), "v_mps", "yaw_rate_radps")
        self.series: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
        self._start_s = math.nan

    def receive(self, topic: Topic, message: Any, t_s: float) -> Sequence[OutgoingMessage]:
        if math.isnan(self._start_s):
            self._start_s = t_s
        if topic is topics.CMD_VEL:
            self._keep("v_mps", t_s, message.linear.x)
            self._keep("yaw_rate_radps", t_s, message.angular.z)
        else:
            self._keep(SERIES[topic.name], t_s, message.data)
        return ()

    def _keep(self, name: str, t_s: float, value: float) -> None:
        samples = self.series[name]
        if math.isfinite(value) and len(samples) < MAX_SAMPLES:
            samples.append((t_s - self._start_s, float(value)))
