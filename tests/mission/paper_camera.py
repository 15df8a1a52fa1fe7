"""A camera on paper: the line of the row that truly lies under the robot, without pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agribot.app.simulated_run import SimulatedRun
from agribot.autonomy.perception_host import NoPerception
from agribot.core.geo import wrap_rad
from agribot.core.messages import CropCover, FloatArray, Row, RowLine, Scene, SensorBatch
from agribot.core.pose import Pose2
from agribot.core.row_shape import project_on_row, row_length_m
from tests.autonomy.estimate.paper_cover import Mask, cover_from

LOOK_S, FAR_M, MAX_OFFSET_M, HALF_ROW_M = 0.1, 1.2, 0.6, 0.1


class CameraOnPaper(NoPerception):
    """Sees the line of the row that truly lies under the robot, where one does.

    With `has_cover` it also sees crop beside that row.
    """

    def __init__(
        self, session: SimulatedRun, rows: Sequence[Row], *, has_cover: bool = False
    ) -> None:
        self._session, self._rows, self._has_cover = session, rows, has_cover
        self._next_s, self._index = 0.0, 0

    def step(self, batch: SensorBatch) -> tuple[Scene, ...]:
        if batch.t_s < self._next_s:
            return ()
        self._next_s, self._index = batch.t_s + LOOK_S, self._index + 1
        t_s = batch.t_s
        return (Scene(t_s=t_s, ready_s=t_s, frame_index=self._index, plants=(), view_body_m=(),
                      row_line=self._line(t_s), crop_cover=self._cover()),)  # fmt: skip

    def _cover(self) -> CropCover | None:
        truth = self._session.simulator.truth()
        pose = Pose2(truth.x_map_m, truth.y_map_m, truth.yaw_map_rad)
        return cover_from(pose, self._grows) if self._has_cover else None

    def _grows(self, x_map_m: FloatArray, y_map_m: FloatArray) -> Mask:
        crop = np.zeros(np.broadcast(x_map_m, y_map_m).shape, dtype=bool)
        for row in self._rows:
            along_m, left_m, _ = project_on_row(row, x_map_m, y_map_m)
            is_along = (along_m > 0.0) & (along_m < row_length_m(row))
            crop |= is_along & (np.abs(left_m) < HALF_ROW_M)
        return crop

    def _line(self, t_s: float) -> RowLine | None:
        truth = self._session.simulator.truth()
        for row in self._rows:
            along_m, left_m, yaw_rad = map(float, project_on_row(row, truth.x_map_m, truth.y_map_m))
            heading_rad = wrap_rad(truth.yaw_map_rad - yaw_rad)
            sign = 1.0 if math.cos(heading_rad) > 0.0 else -1.0
            ahead_m = along_m + sign * FAR_M
            if abs(left_m) > MAX_OFFSET_M or not 0.0 <= ahead_m <= row_length_m(row):
                continue
            turned_rad = heading_rad if sign > 0.0 else wrap_rad(heading_rad - math.pi)
            return RowLine(
                t_s=t_s, offset_m=sign * left_m, heading_rad=turned_rad, offset_std_m=0.015,
                heading_std_rad=0.012,
            )  # fmt: skip
        return None
