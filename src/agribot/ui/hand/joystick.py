"""Linux's joystick interface (`/dev/input/js*`) without I/O: bytes in, axes and buttons out."""

from __future__ import annotations

import struct

_EVENT = struct.Struct("=IhBB")  # time in ms, value, type, number (linux/joystick.h)
_BUTTON, _AXIS, _INIT = 0x01, 0x02, 0x80
_FULL = 32767.0


class JoystickState:
    """Feed it what the device sends, in pieces of any size."""

    def __init__(self) -> None:
        self.axes: dict[int, float] = {}
        self.buttons: dict[int, bool] = {}
        self._presses: set[int] = set()
        self._rest = b""

    def feed(self, data: bytes) -> None:
        data = self._rest + data
        whole = len(data) - len(data) % _EVENT.size
        self._rest = data[whole:]
        for _, value, kind, number in _EVENT.iter_unpack(data[:whole]):
            if kind & ~_INIT == _AXIS:
                self.axes[number] = max(value / _FULL, -1.0)
            elif kind & ~_INIT == _BUTTON:
                self.buttons[number] = bool(value)
                if value and not kind & _INIT:  # held since before we looked is no press
                    self._presses.add(number)

    def taken_presses(self) -> set[int]:
        """List the buttons that went down since the last call, let go again or not."""
        presses, self._presses = self._presses, set()
        return presses

    def axis(self, number: int, dead_zone: float) -> float:
        """In [-1, 1]; zero inside the dead zone and rising from zero at its edge."""
        value = self.axes.get(number, 0.0)
        size = (abs(value) - dead_zone) / (1.0 - dead_zone)
        return 0.0 if size <= 0.0 else (size if value > 0.0 else -size)
