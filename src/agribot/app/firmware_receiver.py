"""The receiver beside real firmware: the simulated fixes as UBX on a line of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agribot.app.firmware_faults import LineNoise
from agribot.core.messages import SensorBatch
from agribot.drivers.gnss.receiver import ReceiverLink
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder
from agribot.drivers.gnss.ubx_writer import FRAMES_OF_FIX, write_fix, write_heading


class FirmwareReceiver:
    """Encode the simulated receiver's measurements as bytes and decode them again."""

    def __init__(self, latency_s: float, noise: LineNoise, now_s: Callable[[], float]) -> None:
        """`latency_s` is the simulated receiver's own, from epoch to arrival."""
        self._noise = noise
        self._refused: list[str] = []
        self._link = ReceiverLink(
            "receiver", ReceiverDecoder(self._refused.append), now_s, latency_s
        )

    def carry(self, batch: SensorBatch) -> None:
        """Send what the simulator measured over the line."""
        said = [(write_fix(fix), FRAMES_OF_FIX) for fix in batch.gnss]
        said += [(write_heading(heading), 1) for heading in batch.headings]
        for data, frames in said:
            self._link.feed(self._noise.carry(data, frames, batch.t_s), batch.t_s)

    def take(self, t_s: float) -> dict[str, tuple[Any, ...]]:
        """Take what the receiver said until `t_s`, by field of the batch."""
        return {"gnss": self._link.take_fixes(t_s), **self._link.take_more(t_s)}
