"""Faults of the devices at the simulator's motor board, and of that board's program.

A board without a fault reports nothing here. Real firmware does, on `platform = "firmware"`,
where the same faults act at its pins.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

import msgspec

from agribot.core.facts import BoardHung, BoardStopped
from agribot.core.messages import BoardSample, ClearStop, SafetyInput, SensorBatch
from agribot.sim.faults.schedule import Fault

# Times of the firmware: its watchdog, and from its reset until it reports and is configured, s.
WATCHDOG_S, AWAY_S = 0.12, 0.2


class PressedButton:
    """The red button, which a board reads in every tick from the start on.

    `presses` are all of a run: there is one button.
    """

    def __init__(self, presses: Sequence[Fault]) -> None:
        self._presses = presses

    def alter(self, batch: SensorBatch) -> SensorBatch:
        is_pressed = any(press.is_on(batch.t_s) for press in self._presses)
        report = BoardSample(t_s=batch.t_s, inputs=("red button",), is_button_pressed=is_pressed)
        return msgspec.structs.replace(batch, board=(*batch.board, report))


class SilentInputs:
    """A board that reported its inputs in every tick stops reporting them; the rest goes on.

    `silences` are all of a run: there is one board.
    """

    def __init__(self, silences: Sequence[Fault]) -> None:
        self._silences = silences

    def alter(self, batch: SensorBatch) -> SensorBatch:
        report = BoardSample(t_s=batch.t_s, inputs=get_args(SafetyInput))
        batch = msgspec.structs.replace(batch, board=(report, *batch.board))
        if not any(silence.is_on(batch.t_s) for silence in self._silences):
            return batch
        heard = {"board": batch.board, "bumper": batch.bumper, "battery": batch.battery}
        return msgspec.structs.replace(batch, **hush_inputs(heard))


def hush_inputs(report: Mapping[str, tuple[Any, ...]]) -> dict[str, tuple[Any, ...]]:
    """Remove the safety inputs from what a board reports."""
    mute = (msgspec.structs.replace(one, inputs=()) for one in report["board"])
    return {"board": tuple(mute), "bumper": (), "battery": ()}


class SilentContactor:
    """The relay of the contactor is pulled from its socket: its state is not reported any more.

    The contactor opens, and the motors lose their power.
    """

    def __init__(self, fault: Fault) -> None:
        self._fault = fault

    def alter(self, batch: SensorBatch) -> SensorBatch:
        kept = tuple(sample for sample in batch.contactor if not self._fault.is_on(sample.t_s))
        return msgspec.structs.replace(batch, contactor=kept)


class UnpluggedImu:
    """The chip of IMU and magnetometer says nothing."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault

    def alter(self, batch: SensorBatch) -> SensorBatch:
        imu = tuple(sample for sample in batch.imu if not self._fault.is_on(sample.t_s))
        mag = tuple(sample for sample in batch.mag if not self._fault.is_on(sample.t_s))
        return msgspec.structs.replace(batch, imu=imu, mag=mag)


class HungBoard:
    """Its program hangs, is reset by its watchdog, and drives nothing until a person cleared it."""

    def __init__(self, fault: Fault) -> None:
        self._begin_s = fault.begin_s
        self._is_cleared = False

    def hears(self, t_s: float) -> bool:
        """Whether it hears commands."""
        return t_s < self._begin_s or self._is_cleared

    def is_off(self, t_s: float) -> bool:
        """Whether its outputs are; until its watchdog bites they are as they were."""
        return not self.hears(t_s) and t_s >= self._begin_s + WATCHDOG_S

    def alter(self, batch: SensorBatch) -> SensorBatch:
        away_s = batch.t_s - self._begin_s
        if away_s < 0.0 or self._is_cleared:
            return batch
        if away_s < AWAY_S:
            return msgspec.structs.replace(batch, wheels=())
        self._is_cleared = any(isinstance(event.request, ClearStop) for event in batch.requests)
        report = BoardSample(t_s=batch.t_s) if self._is_cleared else _make_reset_report(batch.t_s)
        return msgspec.structs.replace(batch, board=(*batch.board, report))


def _make_reset_report(t_s: float) -> BoardSample:
    return BoardSample(
        t_s=t_s,
        stop=BoardStopped(("began",)),
        fault=BoardHung(),
    )
