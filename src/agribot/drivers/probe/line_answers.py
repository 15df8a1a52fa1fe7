"""What speaks at a line, and the speakers that know it by its bytes: they read no line."""

from __future__ import annotations

from typing import Any, Literal, Protocol

import msgspec

from agribot.drivers.board.board_protocol import BAUD as OUR_BAUD

AnswerKind = Literal[
    "motor board", "imu board", "letter imu", "rosserial imu", "rosserial device", "receiver",
    "vesc", "odrive", "unknown", "silent",
]  # fmt: skip
Use = Literal["base", "imu", "gnss", ""]
# Default speeds of a run whose URI states none.
USUAL_BAUD: dict[Use, int] = {"base": 115_200, "imu": 57_600, "gnss": 38_400}


class LineAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """The device found at a line, and its use.

    `use` is the sensor of `--source` that it can be, `options` stand behind the question mark of
    its URI. `numbers` are what was counted and measured, by names with units. `is_good` is False
    where a run could not use it as it is; `advice` says what to do.
    """

    kind: AnswerKind
    detail: str
    baud: int = 0
    use: Use = ""
    options: tuple[tuple[str, str], ...] = ()
    advice: tuple[str, ...] = ()
    is_good: bool = True
    numbers: dict[str, Any] = {}

    def write_uri(self, path: str) -> str:
        """Write the URI that a run reads it by."""
        usual = USUAL_BAUD.get(self.use, 0)
        if self.kind == "motor board":
            usual = OUR_BAUD
        stated = {} if self.baud in (0, usual) else {"baud": str(self.baud)}
        options = {**stated, **dict(self.options)}
        words = "&".join(f"{name}={value}" for name, value in options.items())
        return f"serial:{path}" + (f"?{words}" if words else "")


class Speaker(Protocol):
    """One kind of device, by what it says from the opening of its line on."""

    @property
    def is_heard(self) -> bool:
        """Whether something came that only such a device says."""
        ...

    def feed(self, data: bytes, now_s: float) -> None:
        """Take what came until now, which may be nothing."""
        ...

    def take_to_send(self, now_s: float) -> bytes:
        """Make what it is to be asked now; nothing where that might harm."""
        ...

    def is_done(self, now_s: float) -> bool:
        """Whether it has said all that it will say."""
        ...

    def answer(self, baud: int) -> LineAnswer:
        """Say what it is."""
        ...
