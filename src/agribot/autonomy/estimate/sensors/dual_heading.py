"""Heading of a second antenna as a correction of the pose."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.estimate.filter.ekf import YAW
from agribot.autonomy.estimate.filter.gate import Gate
from agribot.autonomy.estimate.filter.heading import circular_median
from agribot.autonomy.estimate.filter.history import Epoch
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.filter.sensor_ranges import MAX_YAW_STD_RAD
from agribot.autonomy.estimate.sensors.correction import Correction, Measurements
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.core.geo import wrap_rad
from agribot.core.messages import GnssHeading, SensorBatch

# Multipath bends the baseline for some seconds; the receiver's sigma covers single epochs only.
STD_FACTOR = 1.1
# Headings whose median is the first heading.
FIRST_HEADINGS = 5


class DualHeading(Correction[GnssHeading]):
    needs = None

    def __init__(self, pose: PoseFilter) -> None:
        super().__init__(pose)
        config = pose.config
        self._gate = Gate(config.gate_sigma, config.recover_after, "antenna heading outlier")
        self._first: list[float] = []

    def samples(self, batch: SensorBatch) -> Sequence[GnssHeading]:
        return batch.headings

    def is_usable(self, sample: GnssHeading) -> bool:
        return math.isfinite(sample.yaw_map_rad) and 0.0 < sample.std_rad <= MAX_YAW_STD_RAD

    def objection(self, sample: GnssHeading) -> str:
        return "of a frozen receiver" if self.pose.is_receiver_frozen else ""

    def measure(self, sample: GnssHeading, epoch: Epoch) -> Measurements:
        if not self.pose.first_heading.is_known:
            self._begin(sample, epoch)
            return
        turned_rad = epoch.now.yaw_rad - epoch.then.yaw_rad
        residual_rad = wrap_rad(sample.yaw_map_rad + turned_rad - self.pose.ekf.x[YAW])
        yield Measurement(
            (residual_rad,), (((YAW, 1.0),),), (STD_FACTOR * sample.std_rad) ** 2, self._gate,
            opens=((YAW, residual_rad**2),),
        )  # fmt: skip

    def _begin(self, sample: GnssHeading, epoch: Epoch) -> None:
        """Collect headings, each turned back to the start of the odometry; then set the yaw."""
        if self.pose.first_heading.is_compass_awaited:
            return
        self._first.append(wrap_rad(sample.yaw_map_rad - epoch.then.yaw_rad))
        if len(self._first) < FIRST_HEADINGS:
            return
        yaw_rad = circular_median(self._first) + epoch.now.yaw_rad
        self.pose.first_heading.begin(yaw_rad, (STD_FACTOR * sample.std_rad) ** 2, "second antenna")
