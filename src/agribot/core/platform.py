"""The small interface to a robot: a simulator, real hardware or a recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Any, Literal, Protocol, runtime_checkable

import msgspec

from agribot.core.facts import SourceHeard, SourceSilent
from agribot.core.messages import (
    DeviceNote,
    Inbox,
    RobotCommand,
    SensorBatch,
)

# Fields of a SensorBatch that may come from elsewhere.
Sensor = Literal["gnss", "imu", "mag", "wheels", "frames", "others", "contactor", "scans"]
SILENCE_S = 2.0


class Platform(Protocol):
    """The interface to a robot; nothing above it knows whether the robot is real.

    What people and programs ask of the robot lies in `inbox`; `read` empties it into the batch.
    """

    @property
    def inbox(self) -> Inbox: ...

    def read(self) -> SensorBatch:
        """Wait for the next tick and return what arrived since the last one.

        Raises: PlatformError: the robot does not answer any more.
        """
        ...

    def write(self, command: RobotCommand) -> None:
        """Send a command; it holds until the next one, or until the platform's own timeout."""
        ...

    def close(self) -> None:
        """Stop the wheels and the implement, and release everything. Safe to call twice."""
        ...


class TrueState(Protocol):
    """True pose of the robot, as only a simulator knows: the body frame in the map."""

    @property
    def x_map_m(self) -> float: ...
    @property
    def y_map_m(self) -> float: ...
    @property
    def yaw_map_rad(self) -> float: ...
    @property
    def v_mps(self) -> float: ...
    @property
    def yaw_rate_radps(self) -> float: ...


class SensorSource(Protocol):
    """One sensor that comes from elsewhere than the platform; `name` is its origin."""

    sensor: Sensor
    name: str

    def take(self, t_s: float) -> tuple[Any, ...]:
        """Take the samples since the last call, oldest first, stamped by the robot's clock."""
        ...

    def close(self) -> None: ...


@runtime_checkable
class SourceOfMore(SensorSource, Protocol):
    """A source whose device measures more than the one sensor, such as a receiver its heading."""

    def take_more(self, t_s: float) -> dict[str, tuple[Any, ...]]:
        """Take the rest since the last call, by field of the batch, the time of each set.

        It takes the place of what the platform has in these fields; `events` are added to its own.
        """
        ...


@runtime_checkable
class SourceThatActs(SensorSource, Protocol):
    """A source whose device also does something, such as a contactor."""

    def write(self, command: RobotCommand) -> None:
        """Do one's part of a command; must not wait for a line."""
        ...


class MixedPlatform:
    """A platform with some sensors from elsewhere; its own samples of these are dropped.

    A source without a sample for `SILENCE_S` is a fault, which the batch carries as a note.
    """

    def __init__(self, platform: Platform, sources: Sequence[SensorSource]) -> None:
        self._platform, self._sources = platform, tuple(sources)
        self._heard_s: dict[str, float] = {}
        self._silent: set[str] = set()

    @property
    def inbox(self) -> Inbox:
        return self._platform.inbox

    def read(self) -> SensorBatch:
        batch = self._platform.read()
        samples: dict[str, Any] = {}
        notes: list[DeviceNote] = []
        for source in self._sources:
            taken = source.take(batch.t_s)
            samples[source.sensor] = (*samples.get(source.sensor, ()), *taken)
            if isinstance(source, SourceOfMore):
                more = source.take_more(batch.t_s)
                notes += more.pop("notes", ())
                for field, found in more.items():
                    samples[field] = (*samples.get(field, ()), *found)
            notes += self._watch(source, batch.t_s, has_samples=bool(taken))
        return msgspec.structs.replace(batch, **samples, notes=(*notes, *batch.notes))

    def write(self, command: RobotCommand) -> None:
        for source in self._sources:
            if isinstance(source, SourceThatActs):
                source.write(command)
        self._platform.write(command)

    def close(self) -> None:
        """Close all of it; actuators come first, as a sensor whose line is lost takes its time.

        Each is closed, even if another one fails.
        """
        with ExitStack() as closing:  # the last one first
            acting = [source for source in self._sources if isinstance(source, SourceThatActs)]
            for source in self._sources:
                if source not in acting:
                    closing.callback(source.close)
            closing.callback(self._platform.close)
            for source in acting:
                closing.callback(source.close)

    def _watch(
        self, source: SensorSource, t_s: float, *, has_samples: bool
    ) -> Iterator[DeviceNote]:
        """Note when a source falls silent, and when it sends again."""
        name = f"{source.sensor} from {source.name}"
        last_s = self._heard_s.setdefault(name, t_s)
        if has_samples:
            self._heard_s[name] = t_s
        is_silent = not has_samples and t_s - last_s > SILENCE_S
        if is_silent == (name in self._silent) or not (is_silent or has_samples):
            return
        self._silent ^= {name}
        field, whose = source.sensor, source.name
        silence = SourceSilent(field, whose, t_s - last_s, SILENCE_S)
        yield DeviceNote(t_s=t_s, fact=silence if is_silent else SourceHeard(field, whose))
