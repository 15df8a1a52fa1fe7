"""A camera on paper: the line of the row that truly lies under the robot, without pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.app.simulated_run import SimulatedRun
from agribot.autonomy.perception_host import NoPerception
from agribot.core.geo import wrap_rad
from agribot.core.messages import Row, RowLine, Scene, SensorBatch
from agribot.core.row_shape import project_on_row, row_length_m

LOOK_S, FAR_M, MAX_OFFSET_M = 0.1, 1.2, 0.6


class CameraOnPaper(NoPerception):
    """Sees the line of the row that truly lies under the robot, where one does."""

    def __init__(self, session: SimulatedRun, rows: Sequence[Row]) -> None:
        self._session, self._rows = session, rows
        self._next_s, self._index = 0.0, 0

    def step(self, batch: SensorBatch) -> tuple[Scene, ...]:
        if batch.t_s < self._next_s:
            return ()
        self._next_s, self._index = batch.t_s + LOOK_S, self._index + 1
        return (Scene(t_s=batch.t_s, ready_s=batch.t_s, frame_index=self._index, plants=(),
                      view_body_m=(), row_line=self._line(batch.t_s)),)  # fmt: skip

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
