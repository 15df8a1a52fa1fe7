"""A correcting sensor that the robot has not: it measures how far a post of the field is away."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from agribot.autonomy.estimate.filter.ekf import YAW, X, Y
from agribot.autonomy.estimate.filter.gate import Gate
from agribot.autonomy.estimate.filter.history import Epoch
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.sensors.correction import Correction, Measurements
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.core.messages import SensorBatch


class PostSight(msgspec.Struct, frozen=True, kw_only=True):
    t_s: float
    post_map_m: tuple[float, float]
    range_m: float
    std_m: float = 0.02


class BatchWithPosts(SensorBatch, frozen=True, kw_only=True):
    posts: tuple[PostSight, ...] = ()


class PostRange(Correction[PostSight]):
    def __init__(self, pose: PoseFilter) -> None:
        super().__init__(pose)
        self._gate = Gate(4.0, 5, "post outlier", "post found again")

    def samples(self, batch: SensorBatch) -> Sequence[PostSight]:
        return batch.posts if isinstance(batch, BatchWithPosts) else ()

    def is_usable(self, sample: PostSight) -> bool:
        return sample.range_m > 0.0

    def measure(self, sample: PostSight, epoch: Epoch) -> Measurements:
        x, (then, now, _) = self.pose.ekf.x, epoch
        moved_x, moved_y = now.x_m - then.x_m, now.y_m - then.y_m
        dx = x[X] - moved_x - sample.post_map_m[0]
        dy = x[Y] - moved_y - sample.post_map_m[1]
        expected_m = math.hypot(dx, dy)
        away = (dx / expected_m, dy / expected_m)
        residual_m = sample.range_m - expected_m
        row = ((X, away[0]), (Y, away[1]), (YAW, away[0] * moved_y - away[1] * moved_x))
        yield Measurement(
            (residual_m,), (row,), sample.std_m**2, self._gate,
            opens=((X, residual_m**2), (Y, residual_m**2)),
        )  # fmt: skip
