"""A form of the page for the noise of simulated sensors; the same as `POST /api/v1/panels`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import msgspec

from agribot.ui.panels import Panels

TITLE = "Sensor noise"

Sensor = Literal["gnss", "gnss_velocity", "accel", "gyro", "mag"]


class NoiseChange(msgspec.Struct, frozen=True, kw_only=True):
    """Errors of one sensor in its unit (m, m/s, m/s^2, rad/s, T), beside those of its preset."""

    sensor: Sensor = "gnss"
    gaussian_noise: float = 0.0
    offset: float = 0.0
    drift: float = 0.0
    drift_frequency: float = 1.0 / 3600.0
    scale_error: float = 1.0


def add_noise_panel(
    panels: Panels,
    check: Callable[[str, str, float], None],
    tune: Callable[[str, str, float], None],
) -> None:
    """Add the form; `tune` gets every value of it, after `check` has taken all of them."""

    def submit(change: NoiseChange) -> str:
        values = msgspec.structs.asdict(change)
        sensor = values.pop("sensor")
        for do in (check, tune):
            for name, value in values.items():
                do(sensor, name, value)
        return f"{sensor}: from the next sample on"

    panels.form(NoiseChange, submit, title=TITLE)
