"""The noise of a simulator's sensors as numbers that peers read and change while it runs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Protocol

from agribot.core.errors import ConfigError
from agribot.sim.sensors.tuning import NEUTRAL, SENSORS, check_tuning, find_range

NODE = "agribot_sensors"
PARAMETERS = tuple(NEUTRAL)

OnChange = Callable[[str, str, float], None]  # sensor, parameter, value


class TunedSimulator(Protocol):
    """A simulator whose sensors' errors can be changed while it runs."""

    def tune(self, sensor: str, parameter: str, value: float) -> None:
        """Change an error. Raises: ConfigError: a name or a value that cannot be."""
        ...

    def add_tuning_tap(self, tap: OnChange) -> None:
        """Call `tap` with every change."""
        ...


class SensorNoise:
    """The values of all sensors, kept together for all networks; any thread may change them.

    A change holds for all samples of the simulator from the next one on. Where peers may not
    change anything `is_open` is false. `report` gets each refusal.
    """

    def __init__(
        self,
        simulator: TunedSimulator,
        *,
        is_open: bool = True,
        report: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._simulator, self._is_open, self._report = simulator, is_open, report
        self._lock = threading.RLock()
        self._values = {sensor: dict(NEUTRAL) for sensor in SENSORS}
        self._listeners: list[OnChange] = []
        simulator.add_tuning_tap(self._note)

    def read(self, sensor: str) -> dict[str, float]:
        """Return the values of a sensor, by parameter."""
        with self._lock:
            return dict(self._values[sensor])

    def change(self, sensor: str, parameter: str, value: float, source: str) -> str:
        """Change a value; return why it is refused, or ""."""
        return self.change_all(sensor, {parameter: value}, source)

    def change_all(self, sensor: str, values: Mapping[str, float], source: str) -> str:
        """Change all of `values`, or none of them; return why they are refused, or ""."""
        if not self._is_open:
            return self.refuse(f"{source}: the noise of sensors is fixed; start with --allow-drive")
        try:
            for parameter, value in values.items():
                check_tuning(sensor, parameter, value)
        except ConfigError as error:
            return self.refuse(f"{source}: {error}")
        for parameter, value in values.items():
            self._set(sensor, parameter, value)
        return ""

    def _set(self, sensor: str, parameter: str, value: float) -> None:
        if self.read(sensor)[parameter] != value:
            self._simulator.tune(sensor, parameter, value)

    def _note(self, sensor: str, parameter: str, value: float) -> None:
        """Note a change, whatever its source, and pass it on."""
        with self._lock:
            self._values[sensor][parameter] = value
        for listener in self._listeners:
            listener(sensor, parameter, value)

    def listen(self, on_change: OnChange) -> None:
        """Call `on_change` with every change, in the thread of the peer that made it."""
        self._listeners.append(on_change)

    def refuse(self, why: str) -> str:
        """Report a refusal and return it."""
        self._report(why)
        return why


def describe(sensor: str, parameter: str) -> str:
    """Describe a parameter in a line."""
    smallest, largest = find_range(sensor, parameter)
    unit = SENSORS[sensor]
    about = {
        "gaussian_noise": f"standard deviation of white noise, {unit}",
        "offset": f"constant error, {unit}",
        "drift": f"standard deviation of a slow error, {unit}",
        "drift_frequency": "how fast the slow error changes, Hz",
        "scale_error": "factor, 1 is exact",
    }[parameter]
    return f"{about}; {smallest:g} to {largest:g}"
