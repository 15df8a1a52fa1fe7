"""When the contactor takes the motors' power, and when it may give it back.

It stops a motor board that ignores its commands. Motors without power do not brake: the robot rolls
out, and keeps rolling downhill.
"""

from __future__ import annotations

import math

from agribot.core.facts import (
    ContactorInTrouble,
    ContactorSilent,
    ContactorStaysClosed,
    ContactorStaysOpen,
    ContactorWelded,
    Fact,
    MotorsUnpowered,
    WheelsTurnUnpowered,
)
from agribot.core.messages import ContactorSample, SensorBatch

REST_RADPS, REST_S = 0.2, 0.5  # wheels no faster than this for this time stand
# A contactor that opened has let go by then, and a wheel that nothing drives is slower.
OPENING_S, SLOWER_RATIO = 1.0, 0.8
CLOSING_S = 1.0  # time after which a contactor commanded to close is closed
BLIND_S = 1.0  # longest gap in reports of a stopped robot's wheels; after it they count as turning


class PowerCut:
    """One call of `update` a tick; `is_cut` is the contactor's command.

    A robot that begins stopped begins without power. Power stays cut until the stop is cleared, all
    wheels stand and, with two contactors, both have opened. If no contactor ever reported, nothing
    is cut.
    """

    def __init__(self, timeout_s: float) -> None:
        """`timeout_s` is how long a contactor may be silent."""
        self._timeout_s = timeout_s
        self._last: ContactorSample | None = None
        self._t_s = self._heard_s = self._cut_s = self._seen_s = -math.inf
        self._rest_s = math.inf  # since when the wheels stand
        self._open_s = math.inf  # since when it is open though it is to be closed
        self._fastest_radps = self._cut_radps = 0.0
        self.is_cut = False

    @property
    def is_there(self) -> bool:
        """Whether a contactor has spoken."""
        return self._last is not None

    @property
    def has_power(self) -> bool:
        """Whether the motors are fed, as far as the contactor says."""
        return self._last is None or self._last.is_closed

    def update(
        self,
        batch: SensorBatch,
        fastest_radps: float | None,
        demand: Fact | None,
        *,
        is_stopped: bool,
    ) -> None:
        """Take in a tick: the fastest wheel (None: not seen), and why power is to be cut."""
        is_first = not self.is_there
        t_s = self._t_s = batch.t_s
        if batch.contactor:
            self._last, self._heard_s = batch.contactor[-1], t_s
        self._see(fastest_radps)
        if self._last is None:
            return
        demand = demand or self._find_deafness()
        begins_stopped = is_first and is_stopped
        is_blind = is_stopped and t_s - self._seen_s > BLIND_S
        if not self.is_cut and (demand is not None or begins_stopped or is_blind):
            self.is_cut, self._cut_s, self._cut_radps = True, t_s, self._fastest_radps
        elif self.is_cut and self.is_at_rest:
            self.is_cut = demand is not None or is_stopped or self.find_weld() is not None
        is_wrongly_open = not (self.is_cut or self._last.is_closed)
        self._open_s = min(self._open_s, t_s) if is_wrongly_open else math.inf

    @property
    def is_at_rest(self) -> bool:
        """Whether all wheels are seen to stand."""
        return self._t_s - self._rest_s >= REST_S

    def still_turns(self) -> WheelsTurnUnpowered | None:
        """Find a robot without power whose wheels are seen to turn."""
        if not self.is_cut or math.isfinite(self._rest_s) or self._t_s - self._seen_s > BLIND_S:
            return None
        return WheelsTurnUnpowered(self._fastest_radps)

    def fault(self) -> Fact | None:
        """Find a contactor that does not obey its command, or does not answer."""
        last = self._last
        if last is None:
            return None
        if (deafness := self._find_deafness()) is not None:
            return deafness
        if self.does_not_open:
            return ContactorStaysClosed(is_reported=last.is_closed)
        return ContactorStaysOpen() if self._t_s - self._open_s > CLOSING_S else None

    def find_weld(self) -> ContactorWelded | None:
        """Find one of two contactors that stayed closed when both were commanded to open."""
        is_welded = self._last is not None and self._has_had_time and self._last.is_one_closed
        return ContactorWelded() if is_welded else None

    def _find_deafness(self) -> ContactorSilent | ContactorInTrouble | None:
        """Find a contactor that is silent, or whose driver cannot reach it."""
        silent_s = self._t_s - self._heard_s
        if not silent_s <= self._timeout_s:
            return ContactorSilent(silent_s, self._timeout_s)
        fault = self._last.fault if self._last is not None else None
        return None if fault is None else ContactorInTrouble(cause=fault)

    def waiting(self) -> Fact | None:
        """Find motors that have no power yet."""
        last = self._last
        if last is None or (last.is_closed and not self.is_cut):
            return None
        return self.find_weld() or MotorsUnpowered()

    @property
    def does_not_open(self) -> bool:
        """Whether the contactor reports it, or wheels turn on as if driven."""
        if self._last is None or not self._has_had_time:
            return False
        is_driven = self._fastest_radps > max(SLOWER_RATIO * self._cut_radps, 3.0 * REST_RADPS)
        return self._last.is_closed or is_driven

    @property
    def _has_had_time(self) -> bool:
        """Whether a contactor that was commanded to open had the time to."""
        return self.is_cut and self._t_s - self._cut_s > OPENING_S

    def _see(self, fastest_radps: float | None) -> None:
        if fastest_radps is None:
            if self._t_s - self._seen_s > BLIND_S:
                self._rest_s = math.inf
            return
        self._seen_s, self._fastest_radps = self._t_s, fastest_radps
        self._rest_s = min(self._rest_s, self._t_s) if fastest_radps <= REST_RADPS else math.inf
