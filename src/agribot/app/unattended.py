"""An unattended run does not wait for ever for an operator to let it go on."""

from __future__ import annotations

from agribot.core.messages import TickRecord

INTERRUPTED = "interrupted by the operator"  # reason of a run that Ctrl-C or a signal ended


class Unattended:
    """A tap; `is_attended` is set where a person can clear a stop, on a page or over a bridge."""

    def __init__(self, limit_s: float) -> None:
        self.is_attended = False
        self._limit_s = limit_s
        self._stopped = self._held = ""
        self._since_s = self._t_s = 0.0

    def __call__(self, record: TickRecord) -> None:
        self._t_s = record.batch.t_s
        if not (self._stopped or self._held):
            self._since_s = self._t_s
        self._stopped, self._held = record.status.stopped, record.status.held

    @property
    def why_ended(self) -> str:
        """Empty while the run may go on."""
        why = self._stopped or self._held
        if self.is_attended or not why or self._t_s - self._since_s < self._limit_s:
            return ""
        lacking = "cleared the stop" if self._stopped else "resumed the mission"
        return f"{why}; no operator {lacking} for {self._limit_s:g} s"
