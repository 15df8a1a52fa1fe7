"""The drive commands of `agribot sim`: one twist, a script, or live lines."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, Protocol, TextIO

from agribot.core.errors import ConfigError
from agribot.core.messages import DriveCommand
from agribot.core.table_text import read_text_file

MAX_SCRIPT_BYTES = 16_000_000


class DriveSource(Protocol):
    def at(self, t_s: float) -> DriveCommand | None:
        """Return the command of the tick that ends at `t_s`; None for no command."""
        ...


class NoTwist:
    """A source of no commands."""

    def at(self, t_s: float) -> DriveCommand | None:
        return None


class ConstantTwist:
    """The same twist in every tick."""

    def __init__(self, command: DriveCommand) -> None:
        self._command = command

    def at(self, t_s: float) -> DriveCommand | None:
        return self._command


class TimedTwist(NamedTuple):
    t_s: float
    command: DriveCommand


class TwistScript:
    """Twists at their simulated times, each sent once; with `hold` until the next one."""

    def __init__(self, twists: Iterable[TimedTwist], *, hold: bool = False) -> None:
        self._coming = deque(twists)
        self._hold = hold
        self._last: DriveCommand | None = None

    def at(self, t_s: float) -> DriveCommand | None:
        twist = None
        while self._coming and self._coming[0].t_s <= t_s:
            twist = self._coming.popleft().command
        if twist is not None:
            self._last = twist
        return self._last if self._hold else twist


class LiveTwists:
    """Twist lines as they arrive, the newest of each tick; with `hold` until the next one.

    A line that is no twist is reported to `complain` and passed over: a person who drives
    must not lose the robot to a typing error.
    """

    def __init__(self, stream: TextIO, complain: TextIO, *, hold: bool = False) -> None:
        self._stream, self._complain, self._hold = stream, complain, hold
        self._arrived: deque[DriveCommand] = deque()
        self._last: DriveCommand | None = None
        self._thread = threading.Thread(target=self._read_lines, name="twist lines", daemon=True)
        self._thread.start()

    def at(self, t_s: float) -> DriveCommand | None:
        twist = None
        while self._arrived:
            twist = self._arrived.popleft()
        if twist is not None:
            self._last = twist
        return self._last if self._hold else twist

    def _read_lines(self) -> None:
        for line in self._stream:
            numbers = _parse_numbers(line)
            if numbers is not None and not numbers:
                continue
            if numbers is None or len(numbers) != 2:
                self._complain.write(
                    f"passed over '{line.strip()[:60]}': a line is V YAW_RATE, m/s and rad/s\n"
                )
            else:
                self._arrived.append(DriveCommand(v_mps=numbers[0], yaw_rate_radps=numbers[1]))


def parse_constant(text: str) -> ConstantTwist:
    """Parse `V,YAW_RATE` in m/s and rad/s.

    Raises: ConfigError: not two finite numbers.
    """
    numbers = _parse_numbers(text)
    if numbers is None or len(numbers) != 2:
        raise ConfigError(
            f"--drive {text}: not two numbers; give forward speed and yaw rate in m/s and rad/s, "
            "as in --drive=0.4,0.1"
        )
    return ConstantTwist(DriveCommand(v_mps=numbers[0], yaw_rate_radps=numbers[1]))


def read_script(path: Path, *, hold: bool) -> TwistScript:
    """Read lines `T_S V YAW_RATE` of a file; spaces or commas between, # starts a comment.

    Raises: ConfigError: the file cannot be read, or a line is wrong; it names file and line.
    """
    try:
        if path.stat().st_size > MAX_SCRIPT_BYTES:
            raise ConfigError(f"--script {path}: more than {MAX_SCRIPT_BYTES} bytes; split it")
        lines = read_text_file(path).splitlines()
    except (OSError, ValueError) as error:
        raise ConfigError(f"--script {path}: cannot be read: {error}; check the path") from error
    twists = []
    for number, line in enumerate(lines, start=1):
        numbers = _parse_numbers(line)
        if numbers == []:
            continue
        if numbers is None or len(numbers) != 3:
            raise ConfigError(
                f"{path}:{number}: '{line.strip()[:60]}' is no command; write T_S V YAW_RATE "
                "in seconds, m/s and rad/s"
            )
        command = DriveCommand(v_mps=numbers[1], yaw_rate_radps=numbers[2])
        twists.append(TimedTwist(numbers[0], command))
    late = next((b for a, b in pairwise(twists) if b.t_s < a.t_s), None)
    if late is not None:
        raise ConfigError(
            f"{path}: the command at {late.t_s:g} s stands after a later one; sort them by time"
        )
    return TwistScript(twists, hold=hold)


def _parse_numbers(line: str) -> list[float] | None:
    """Parse the finite numbers of a line, without its comment; None for anything else."""
    try:
        numbers = [float(word) for word in line.partition("#")[0].replace(",", " ").split()]
    except ValueError:
        return None
    return numbers if all(math.isfinite(number) for number in numbers) else None
