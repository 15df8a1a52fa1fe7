"""The table of faults: what can go wrong in the simulated world, by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import msgspec

from agribot.core.errors import ConfigError
from agribot.core.facts import Part
from agribot.core.messages import WHEEL_NAMES
from agribot.core.plugins import FAULTS as GROUP
from agribot.core.plugins import find_plugin, list_names
from agribot.core.suggestions import suggest_name


class Span(msgspec.Struct, frozen=True, kw_only=True):
    """A number that a fault takes, in `unit`; the ends belong to it.

    `is_signed` lets it be negative by as much; it is then never 0. From `harmless`, which does
    nothing, the number of a fault may rise slowly; None: it is there at once.
    """

    unit: str
    low: float
    high: float
    is_signed: bool = False
    harmless: float | None = None


class FaultKind(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the table.

    `value` is the number that it takes, "wheel" for the name of one, or None. `typical` is a value
    to start from. A momentary fault happens at once and has no end, one `at_start` happens at
    time 0 only. A reason that names nothing but parts of `named_as` names
    the part at fault; without any, its own.
    """

    name: str
    part: Part
    about: str
    named_as: tuple[Part, ...] = ()
    value: Span | Literal["wheel"] | None = None
    typical: str = ""
    is_momentary: bool = False
    at_start: bool = False

    @property
    def accepted(self) -> tuple[Part, ...]:
        """The parts by which the robot may call this fault."""
        return self.named_as or (self.part,)

    @property
    def can_rise(self) -> bool:
        """Whether it may begin slowly."""
        return isinstance(self.value, Span) and self.value.harmless is not None


class FaultPlugin(NamedTuple):
    """A fault of an installed package, an entry point of the group `agribot.faults`.

    `make` gets the `Fault` and the `FaultMaterial` of `sim.faults.layer`, and `settings` where it
    has some, and returns what alters the batches.
    """

    kind: FaultKind
    make: Callable[..., Any]
    settings: type[msgspec.Struct] | None = None


_MOTOR: tuple[Part, ...] = ("motors", "wheels")
FAULTS = (
    FaultKind(name="gnss.outage", part="gnss",
              about="the receiver sends nothing"),
    FaultKind(name="gnss.jump", part="gnss", typical="2",
              value=Span(unit="m", low=0.01, high=1e6, harmless=0.0),
              about="all fixes are off by this, in a direction of the seed; status as before"),
    FaultKind(name="gnss.wrong_fix", part="gnss", typical="0.5",
              value=Span(unit="m", low=0.01, high=1e3, harmless=0.0),
              about="all fixes are off by this, while status and sigma are those of RTK fixed"),
    FaultKind(name="gnss.drift", part="gnss", typical="0.05",
              value=Span(unit="m/s", low=1e-4, high=100.0),
              about="fixes move off at this speed, in a direction of the seed; velocity is right"),
    FaultKind(name="gnss.frozen", part="gnss",
              about="the receiver repeats its last fix and its velocity, with new time stamps"),
    FaultKind(name="gnss.scatter", part="gnss", typical="5",
              value=Span(unit="", low=1.0, high=1e3, harmless=1.0),
              about="positions scatter by this multiple of the sigma that the receiver reports"),
    FaultKind(name="gnss.velocity", part="gnss", typical="10",
              value=Span(unit="", low=1.0, high=1e3, harmless=1.0),
              about="the velocity noise is this multiple of the sigma that the receiver reports"),
    FaultKind(name="mag.motor", part="compass",
              about="the magnetometer feels the motors: 2 uT for each Nm at the wheels"),
    FaultKind(name="mag.offset", part="compass", typical="15",
              value=Span(unit="uT", low=0.1, high=1e4, harmless=0.0),
              about="a magnet on the robot: a horizontal field in a direction of the seed"),
    FaultKind(name="imu.bias", part="imu", typical="0.05",
              value=Span(unit="rad/s", low=1e-5, high=10.0, is_signed=True, harmless=0.0),
              about="the gyro's yaw rate is off by this"),
    FaultKind(name="imu.frozen", part="imu",
              about="the IMU repeats its last numbers, with new time stamps"),
    FaultKind(name="imu.late", part="imu", typical="0.25",
              value=Span(unit="s", low=0.01, high=60.0, harmless=0.0),
              about="samples of the IMU arrive so late, with true time stamps"),
    FaultKind(name="imu.unplugged", part="imu", named_as=("imu", "compass"),
              about="the chip of IMU and magnetometer has no contact, and says nothing"),
    FaultKind(name="wheels.stuck", part="wheels", value="wheel",
              typical=WHEEL_NAMES[3],
              about="the encoder of the wheel counts nothing; what it missed is lost"),
    FaultKind(name="wheels.reversed", part="wheels",
              about="all four encoders count backwards"),
    FaultKind(name="motor.dead", part="motors", named_as=_MOTOR, value="wheel",
              typical=WHEEL_NAMES[3],
              about="the motor has no torque, its wheel rolls freely"),
    FaultKind(name="motor.weak", part="motors", named_as=_MOTOR, typical="0.05",
              value=Span(unit="", low=0.0, high=1.0, harmless=1.0),
              about="one motor, drawn from the seed, gives at most this share of its torque"),
    FaultKind(name="motor.runaway", part="motors", named_as=_MOTOR,
              about="the board drives ahead at full speed, whatever the command"),
    FaultKind(name="soil.mud", part="ground",
              typical="0.1", value=Span(unit="", low=0.01, high=1.0, harmless=1.0),
              about="the ground within 2 m has this share of its strength and friction"),
    FaultKind(name="camera.black", part="camera", about="all pixels are black"),
    FaultKind(name="camera.frozen", part="camera",
              about="the pixels repeat, the time stamps go on"),
    FaultKind(name="camera.flipped", part="camera",
              about="the picture is upside down"),
    FaultKind(name="camera.mirrored", part="camera",
              about="left and right are swapped in the picture"),
    FaultKind(name="camera.shifted", part="camera", typical="0.2",
              value=Span(unit="m", low=1e-3, high=2.0, is_signed=True),
              about="the camera's mount is knocked to the left by this"),
    FaultKind(name="camera.creeping", part="camera", typical="0.02",
              value=Span(unit="m/s", low=1e-4, high=1.0, is_signed=True),
              about="the camera's mount slides to the left at this speed"),
    FaultKind(name="camera.late", part="camera", typical="1",
              value=Span(unit="s", low=0.01, high=60.0),
              about="frames arrive so late, with true time stamps"),
    FaultKind(name="camera.off", part="camera", about="no frames come"),
    FaultKind(name="network.hung", part="network", named_as=("network", "camera"),
              about="the network never answers"),
    FaultKind(name="bumper.contact", part="bumper",
              about="the bumper in front says that it touches something"),
    FaultKind(name="button.pressed", part="button",
              about="somebody presses the red button"),
    FaultKind(name="inputs.silent", part="inputs", named_as=("inputs", "button"),
              about="the board stops reporting red button, bumper, battery and motors, if the "
                    "robot must have them (`safety.must_report`)"),
    FaultKind(name="contactor.silent", part="contactor",
              about="the contactor's relay is pulled out: it opens and reports nothing"),
    FaultKind(name="contactor.welded", part="contactor",
              about="one contactor is welded: it stays closed on every command"),
    FaultKind(name="obstacle.unmapped", part="robot", named_as=("bumper",),
              is_momentary=True,
              about="a pole stands 2 m ahead of the robot, in the physics and in the picture"),
    FaultKind(name="battery.empty", part="battery",
              about="the charge falls to 5 %, and the voltage with it"),
    FaultKind(name="clock.step", part="clock", typical="2",
              value=Span(unit="s", low=1e-3, high=1e6, is_signed=True),
              about="the clock jumps: all time stamps are off by this"),
    FaultKind(name="link.noise", part="link",
              typical="0.05", value=Span(unit="", low=1e-4, high=1.0, harmless=0.0),
              about="of the samples of board and receivers this share is lost or has a false bit"),
    FaultKind(name="board.silent", part="motors", named_as=_MOTOR,
              about="no wheel samples come, and commands are not heard"),
    FaultKind(name="board.hung", part="motors", named_as=_MOTOR, is_momentary=True,
              about="the board's program hangs, until its watchdog resets it"),
    FaultKind(name="program.stalled", part="program", typical="3",
              value=Span(unit="s", low=0.1, high=60.0), is_momentary=True,
              about="the robot's program stalls for this time, and the board receives nothing"),
    FaultKind(name="disk.full", part="disk",
              about="the disk has no room left for the recording"),
    FaultKind(name="start.aside", part="start", typical="0.3",
              value=Span(unit="m", low=1e-3, high=100.0, is_signed=True),
              is_momentary=True, at_start=True,
              about="the robot stands to the left of its start by this"),
    FaultKind(name="start.turned", part="start", typical="20",
              value=Span(unit="deg", low=0.01, high=180.0, is_signed=True),
              is_momentary=True, at_start=True,
              about="the robot stands turned by this at its start, counter-clockwise"),
    FaultKind(name="robot.tipped", part="robot", typical="40",
              value=Span(unit="deg", low=1.0, high=50.0),
              about="the robot's front is lifted, in 2 s, until it is tilted by this"),
    FaultKind(name="carried", part="robot", named_as=("robot", "start"), typical="0.5",
              value=Span(unit="m", low=1e-3, high=100.0, is_signed=True), is_momentary=True,
              about="the robot is lifted, moved to its left by this and set down: in a second, or "
                    "2 s for each metre"),
    FaultKind(name="crop.gap", part="crop", typical="5",
              value=Span(unit="m", low=0.1, high=1000.0), is_momentary=True, at_start=True,
              about="in every row this length of crop is missing, from a place of the seed on"),
)  # fmt: skip
_BY_NAME = {kind.name: kind for kind in FAULTS}
BUILT_IN = frozenset(_BY_NAME)


def find_kind(name: str) -> FaultKind:
    """Find a fault by its name.

    Raises: ConfigError: no fault has this name.
    """
    if name in _BY_NAME:
        return _BY_NAME[name]
    installed = find_plugin(GROUP, name) if name else None
    if installed is None:
        known = [*_BY_NAME, *list_names(GROUP)]
        raise ConfigError(
            f"unknown fault '{name}'{suggest_name(name, known)}; known: {', '.join(known)}"
        )
    kind: FaultKind = installed.kind
    return kind
