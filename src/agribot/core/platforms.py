"""The platforms by name: what the setting `platform` chooses from."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

from agribot.core import extras
from agribot.core.errors import AgribotError, ConfigError
from agribot.core.messages import SafetyInput
from agribot.core.named_functions import find_function
from agribot.core.platform import Platform
from agribot.core.plugins import PLATFORMS, find_plugin, list_names
from agribot.core.suggestions import suggest_name

# Takes the settings of the run (`RunConfig`) and the robot (`RobotSpec`).
OpenPlatform = Callable[[Any, Any], Platform]

_HOW = "how to write one: docs/contribute/platform.md"


class PlatformKind(NamedTuple):
    """Opener of a platform, and its needs.

    `opener` takes the settings of a run and the robot, and returns a `Platform`; as a text it is
    "module:function", imported when it is wanted. It is None for the simulator, which also makes
    the world of the run. `extra` is the extra of the installation that it needs. A platform that
    `needs_arming` moves a real machine: it begins stopped, and remembers a stop. `must_report` are
    the safety inputs without which it stands.
    """

    opener: OpenPlatform | str | None
    extra: str = ""
    needs_arming: bool = False
    must_report: tuple[SafetyInput, ...] = ()

    @property
    def is_simulated(self) -> bool:
        return self.opener is None

    def find_opener(self) -> OpenPlatform:
        """Import what opens it.

        Raises: ConfigError: there is no such function, or the simulator opens itself. What it
            returns raises it where it opens no platform.
        """
        if self.opener is None:
            raise ConfigError("the simulator needs a world; open it with SimulatedRun")
        what = f"platform = {self.opener!r}"
        opener = find_function(self.opener, what)
        if not _takes_two(opener):
            raise ConfigError(
                f"{what} opens no platform: it does not take the settings of the run and the "
                f"robot; {_HOW}"
            )

        def open_platform(config: Any, robot: Any) -> Platform:
            try:
                platform: Platform = opener(config, robot)
            except Exception as error:
                if self in _KINDS.values() or isinstance(error, (AgribotError, OSError)):
                    raise
                raise ConfigError(
                    f"{what} failed: {type(error).__name__}: {error}; {_HOW}"
                ) from error
            _check_platform(platform, what)
            return platform

        return open_platform


def _check_platform(platform: Platform, what: str) -> None:
    lacks = [name for name in ("inbox", "read", "write", "close") if not hasattr(platform, name)]
    if lacks:
        raise ConfigError(
            f"{what} opens no platform but gives {type(platform).__name__}, which has no "
            f"{', '.join(lacks)}; {_HOW}"
        )


def _takes_two(opener: Callable[..., Any]) -> bool:
    """Return whether a function takes two arguments; true if its signature is unknown."""
    try:
        inspect.signature(opener).bind(None, None)
    except TypeError:
        return False
    except ValueError:
        return True
    return True


_KINDS: dict[str, PlatformKind] = {
    "sim": PlatformKind(opener=None, extra="sim"),
    # The simulator, whose motor board is real firmware.
    "firmware": PlatformKind(
        opener=None, extra="sim", must_report=("red button", "bumper", "battery", "motors")
    ),
    "hardware": PlatformKind(
        "agribot.drivers.hardware_platform:open_platform",
        extra="hardware",
        needs_arming=True,
        must_report=("red button", "motors"),
    ),
}


def register_platform(
    name: str,
    opener: OpenPlatform | str,
    extra: str = "",
    *,
    needs_arming: bool = False,
    must_report: tuple[SafetyInput, ...] = (),
) -> None:
    """Let `platform = "NAME"` in the settings of a run open this platform.

    One that `needs_arming` begins stopped, and stands without the inputs that it `must_report`.

    Raises: ConfigError: the name is taken.
    """
    if name in _KINDS:
        raise ConfigError(f"the platform {name!r} is registered already; choose another name")
    _KINDS[name] = PlatformKind(opener, extra, needs_arming, must_report)


def find_platform(name: str) -> PlatformKind:
    """Find a registered or installed platform, or take "my_robot:open_platform" at its word.

    Raises: ConfigError: none of these, or an installed one cannot be imported.
    """
    if name in _KINDS:
        return _KINDS[name]
    if ":" in name:
        return PlatformKind(opener=name)
    installed = find_plugin(PLATFORMS, name)
    if installed is not None:
        is_kind = isinstance(installed, PlatformKind)
        _KINDS[name] = installed if is_kind else PlatformKind(opener=installed)
        return _KINDS[name]
    known = [*_KINDS, *list_names(PLATFORMS)]
    raise ConfigError(
        f"platform = {name!r}{suggest_name(name, known)}; known: {', '.join(known)}; "
        "or name your own as module:function"
    )


def runs_in_real_time(name: str) -> bool:
    """Whether time goes on while the robot's program thinks: on everything but the simulator."""
    kind = _KINDS.get(name)
    return kind is None or not kind.is_simulated


def list_must_report(name: str) -> tuple[SafetyInput, ...]:
    """List the safety inputs of a platform; none of one that only its recording knows."""
    kind = _KINDS.get(name)
    return () if kind is None else kind.must_report


def require_platform(name: str) -> PlatformKind:
    """Find a platform and refuse one whose packages are not installed.

    Raises: ConfigError: the name is unknown, or its extra is missing.
    """
    kind = find_platform(name)
    if kind.extra:
        extras.require(kind.extra, f"platform = {name!r}")
    return kind
