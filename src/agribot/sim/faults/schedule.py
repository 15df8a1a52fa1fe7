"""When which fault begins and ends: `NAME[=VALUE]@T[~RISE][+SECONDS]`, read and checked."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError
from agribot.core.messages import WHEEL_NAMES
from agribot.core.platforms import find_platform
from agribot.core.suggestions import suggest_name
from agribot.sim.faults.table import FaultKind, Span, find_kind

SYNTAX = "NAME[=VALUE]@T[~RISE][+SECONDS]"
LONGEST_MISSION_S = 86_400.0  # a day; no battery lasts as long
ROUNDING_S = 1e-9
SHORTEST_CARRY_S = 1.0
CARRY_MPS = 0.5  # speed at which a tilt sensor is not deceived
CAMERA_PARTS = ("camera", "network")


class Fault(msgspec.Struct, frozen=True, kw_only=True):
    """One fault of a run, from `begin_s` until before `end_s` on the run's clock.

    `text` is how it was written; `number` and `wheel` are its value, 0 and "" where it has none.
    The number rises to its value in `rise_s`.
    """

    text: str
    kind: FaultKind
    begin_s: float
    end_s: float = math.inf
    number: float = 0.0
    wheel: str = ""
    rise_s: float = 0.0

    @property
    def name(self) -> str:
        return self.kind.name

    @property
    def handled_until_s(self) -> float | None:
        """Time when hands that move the robot let go of it; None where none do."""
        if self.kind.at_start:
            return self.begin_s
        carried_s = max(SHORTEST_CARRY_S, abs(self.number) / CARRY_MPS)
        return self.begin_s + carried_s if self.name == "carried" else None

    def is_on(self, t_s: float) -> bool:
        return self.begin_s - ROUNDING_S <= t_s < self.end_s - ROUNDING_S

    def find_number(self, t_s: float) -> float:
        """Find its number at a time, on the way from what is harmless to its value."""
        span = self.kind.value
        if not self.rise_s or not isinstance(span, Span) or span.harmless is None:
            return self.number
        share = min(max((t_s - self.begin_s) / self.rise_s, 0.0), 1.0)
        return span.harmless + share * (self.number - span.harmless)


def parse_fault(text: str) -> Fault:
    """Read one fault.

    Raises: ConfigError: it is not of this form, or one of its parts cannot be.
    """
    what, at, when = text.partition("@")
    name, equals, value = what.strip().partition("=")
    kind = find_kind(name)
    if not at:
        raise ConfigError(f"fault {text}: it lacks a time; write it as {SYNTAX}")
    begin, plus, lasting = when.partition("+")
    begin, tilde, rising = begin.partition("~")
    begin_s = _read_seconds(text, begin)
    if not 0.0 <= begin_s < LONGEST_MISSION_S:
        raise ConfigError(
            f"fault {text}: no mission has the time {begin_s:g} s; write one from 0 to "
            f"{LONGEST_MISSION_S:g} s"
        )
    if kind.at_start and begin_s:
        raise ConfigError(f"fault {text}: {name} is one of the start; write it with @0")
    if kind.is_momentary and plus:
        raise ConfigError(f"fault {text}: {name} happens at once and does not end; leave out {plus}"
                          f"{lasting}")  # fmt: skip
    lasting_s = _read_seconds(text, lasting) if plus else math.inf
    if lasting_s <= 0.0:
        raise ConfigError(f"fault {text}: it lasts {lasting_s:g} s; write more than 0")
    number, wheel = _read_value(text, kind, value.strip() if equals else None)
    return Fault(
        text=text.strip(), kind=kind, begin_s=begin_s, end_s=begin_s + lasting_s,
        number=number, wheel=wheel, rise_s=_read_rise_s(text, kind, rising) if tilde else 0.0,
    )  # fmt: skip


def _read_rise_s(text: str, kind: FaultKind, word: str) -> float:
    """Read in how many seconds the value of a fault rises."""
    if not kind.can_rise:
        raise ConfigError(
            f"fault {text}: {kind.name} has no value that can rise; leave out ~{word}"
        )
    rise_s = _read_seconds(text, word)
    if rise_s <= 0.0:
        raise ConfigError(f"fault {text}: it rises in {rise_s:g} s; write more than 0")
    return rise_s


def read_faults(
    config: RunConfig, *, has_camera: bool = True, began_s: float = 0.0
) -> tuple[Fault, ...]:
    """Read and check the faults of a run's settings.

    A run that goes on with a job which is `began_s` old has them on its own clock: those that are
    over, or happened at once before, are left out.

    Raises: ConfigError: one of them is wrong, does not fit the run or never comes.
    """
    faults = tuple(parse_fault(text) for text in config.faults)
    for fault in faults:
        _check_fits(fault, config, has_camera)
        limit_s = config.duration_s
        if limit_s is not None and not began_s and fault.begin_s >= limit_s:
            raise ConfigError(
                f"fault {fault.text}: it never comes, the run ends after {limit_s:g} s; give it an "
                "earlier time, or raise duration_s"
            )
    later = (_move(fault, began_s) for fault in faults) if began_s else faults
    return tuple(fault for fault in later if fault is not None)


def refuse_faults_of(parts: Sequence[str], faults: Sequence[Fault], why: str) -> None:
    """Refuse faults of parts that are not there.

    Raises: ConfigError: there is one.
    """
    for fault in faults:
        if fault.kind.part in parts:
            raise ConfigError(f"fault {fault.text}: {why}")


def _check_fits(fault: Fault, config: RunConfig, has_camera: bool) -> None:
    if not find_platform(config.platform).is_simulated:
        raise ConfigError(
            f"fault {fault.text}: faults are those of the simulator, and platform = "
            f"{config.platform!r}; leave them out"
        )
    part = fault.kind.part
    if part in CAMERA_PARTS and not config.perception.enabled:
        raise ConfigError(
            f"fault {fault.text}: nothing looks, since perception.enabled is false; leave it out, "
            "or let the camera look"
        )
    if part in CAMERA_PARTS and not has_camera:
        raise ConfigError(f"fault {fault.text}: robot '{config.robot}' has no camera; leave it out")
    if part == "contactor" and not config.sim.contactors:
        raise ConfigError(
            f"fault {fault.text}: the robot has no contactor, since sim.contactors is 0; "
            "leave it out"
        )
    if part == "disk" and not config.record.enabled:
        raise ConfigError(
            f"fault {fault.text}: nothing is recorded, since record.enabled is false; leave it out"
        )


def _move(fault: Fault, began_s: float) -> Fault | None:
    begin_s, end_s = fault.begin_s - began_s, fault.end_s - began_s
    if end_s <= 0.0 or (fault.kind.is_momentary and begin_s < 0.0) or fault.kind.at_start:
        return None
    return msgspec.structs.replace(fault, begin_s=begin_s, end_s=end_s)


def _read_seconds(text: str, word: str) -> float:
    try:
        seconds = float(word)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise ConfigError(f"fault {text}: '{word}' is no time in seconds; write it as {SYNTAX}")
    return seconds


def _read_value(text: str, kind: FaultKind, word: str | None) -> tuple[float, str]:
    """Return the number and the wheel of a fault, which has at most one of them."""
    if kind.value is None:
        if word is not None:
            raise ConfigError(f"fault {text}: {kind.name} takes no value; leave out ={word}")
        return 0.0, ""
    wanted = describe_value(kind)
    if not word:
        raise ConfigError(
            f"fault {text}: {kind.name} lacks its value, {wanted}; such as {kind.name}="
            f"{kind.typical}"
        )
    if kind.value == "wheel":
        if word not in WHEEL_NAMES:
            raise ConfigError(
                f"fault {text}: no wheel '{word}'{suggest_name(word, WHEEL_NAMES)}; {wanted}"
            )
        return 0.0, word
    try:
        number = float(word)
    except ValueError:
        number = math.nan
    span = kind.value
    size = abs(number) if span.is_signed else number
    if not span.low <= size <= span.high:  # nan is in no span
        raise ConfigError(f"fault {text}: {kind.name} = {word} is out of range; give {wanted}")
    return number, ""


def describe_value(kind: FaultKind) -> str:
    """Say which values a fault takes; empty where it takes none."""
    if kind.value is None:
        return ""
    if not isinstance(kind.value, Span):
        return f"one of {', '.join(WHEEL_NAMES)}"
    span = kind.value
    unit = f" {span.unit}" if span.unit else ""
    sign = ", or as much below 0" if span.is_signed else ""
    return f"{span.low:g} to {span.high:g}{unit}{sign}"
