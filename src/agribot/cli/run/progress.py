"""Progress of a run on stderr: a bar on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from agribot.cli.standard_error import write_words
from agribot.core.messages import GateStatus, TickRecord
from agribot.record.events import describe_checks

if TYPE_CHECKING:
    from agribot.autonomy.weeds.map import WeedMap

BAR_WIDTH = 24
BAR_EVERY_S = 0.5  # simulated
LINE_EVERY_S = 20.0
UNEXPLAINED_S = 3.0  # longest wait without an explanation


@contextmanager
def explain_wait(text: str, after_s: float = UNEXPLAINED_S) -> Iterator[None]:
    """Say on stderr what takes longer than this."""
    timer = threading.Timer(after_s, sys.stderr.write, [f"{text}\n"])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


class RunProgress:
    """A tap that shows row, speed, cross-track error and the weeds found until now."""

    def __init__(self, weed_map: WeedMap, stream: TextIO | None = None) -> None:
        self._weed_map = weed_map
        self._stream = sys.stderr if stream is None else stream
        self._is_terminal = self._stream.isatty()
        self._next_s = 0.0
        self._gate = GateStatus()

    def __call__(self, record: TickRecord) -> None:
        self._note_gate(record.status.gate)
        if record.batch.t_s < self._next_s:
            return
        self._next_s = record.batch.t_s + (BAR_EVERY_S if self._is_terminal else LINE_EVERY_S)
        line = self._format_line(record)
        write_words(self._stream, f"\r{line}\x1b[K" if self._is_terminal else f"{line}\n")

    def _note_gate(self, gate: GateStatus) -> None:
        """Print at once what the list before the start found, why it stopped, and what is wrong."""
        before, self._gate = self._gate, gate
        if gate is before:
            return
        if gate.checks and gate.checks is not before.checks:
            self.note(describe_checks(gate.checks))
        if gate.state == "stopped" != before.state:
            self.note(f"stopped: {gate.reason}")
        if gate.warning and not before.warning:
            self.note(gate.warning)

    def note(self, text: str) -> None:
        """Print a line of its own, above the bar."""
        write_words(self._stream, f"\r\x1b[K{text}\n" if self._is_terminal else f"{text}\n")

    def close(self) -> None:
        if self._is_terminal:
            write_words(self._stream, "\n")

    def _format_line(self, record: TickRecord) -> str:
        status = record.status
        done_ratio = min(status.s_m / status.length_m, 1.0) if status.length_m else 0.0
        bar = "#" * round(done_ratio * BAR_WIDTH)
        if status.row >= 0:
            where = f"row {status.row + 1}/{status.rows_total}"
        elif status.rows_total:
            where = f"{len(status.rows_done)}/{status.rows_total} rows"
        else:
            where = f"{status.waypoints_reached}/{status.waypoints_total} goals"
        cross_cm = f"{record.tracking.cross_track_m * 100:+5.1f}" if record.tracking else "    -"
        text = (
            f"[{bar:-<{BAR_WIDTH}}] {done_ratio:4.0%}  {record.batch.t_s:6.1f} s  {where:9}  "
            f"{record.estimate.v_mps:4.2f} m/s  cross-track {cross_cm} cm  "
            f"weeds {self._weed_map.weed_count:3d}  {status.state}"
        )
        why = record.reason or (status.reason if status.state != "running" else "")
        return f"{text} ({why})" if why else text
