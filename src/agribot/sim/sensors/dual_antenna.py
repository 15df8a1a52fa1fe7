"""Heading from two antennas: the direction of the line between them."""

from __future__ import annotations

import numpy as np

from agribot.core.geo import wrap_rad
from agribot.core.messages import FloatArray, GnssHeading
from agribot.sim.attitude import read_roll_pitch_yaw
from agribot.sim.random_streams import NormalRows
from agribot.sim.sensors.gnss import HectorReceiver, Receiver
from agribot.sim.sensors.presets import HeadingErrors


class DualAntenna:
    """Heading of two antennas; no sample while their receiver has no fixed solution."""

    def __init__(
        self, errors: HeadingErrors, receiver: Receiver | HectorReceiver, rng: np.random.Generator
    ) -> None:
        self._std_rad = errors.std_rad
        self._receiver = receiver
        self._normal = NormalRows(rng, 1)

    def sample(self, t_s: float, row: FloatArray) -> GnssHeading | None:
        """Return the reading for one row of the physics history, or None."""
        error_rad = self._std_rad * float(self._normal.take(1)[0, 0])
        if not self._receiver.is_fixed:
            return None
        yaw_rad = wrap_rad(read_roll_pitch_yaw(row)[2] + error_rad)
        return GnssHeading(t_s=t_s, yaw_map_rad=yaw_rad, std_rad=self._std_rad)
