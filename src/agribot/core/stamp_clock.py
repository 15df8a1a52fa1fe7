"""Stamps of another clock on the robot's clock, and samples that wait for their tick."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Generic, NamedTuple, TypeVar

import msgspec

Sample = TypeVar("Sample", bound=msgspec.Struct)
QUEUE_SAMPLES = 1000  # longest queue of samples; more lose the oldest

WINDOW_S = 2.0
# Largest age of a window's freshest message whose stamp is of the robot's clock.
SAME_CLOCK_S = 1.0
LONGEST_TICK_S = 0.1  # longest tick of a running process; after a longer one it was suspended
_AHEAD_S = 0.05  # rounding of stamps
DRIFT_RATIO = 1e-4  # drift of one crystal against another; a ceramic resonator drifts by more


class StampClock:
    """The clock of one source. Its offset follows from the quickest of the last messages.

    Stamps of a peer with the robot's time (/clock) are taken exactly; of another clock the
    shortest delay within `WINDOW_S` counts as zero, so that a step of that clock is followed
    within this time, and at once where it steps back by more, as of a receiver that was switched
    off. A message without a stamp has the time of its arrival. No time is in the
    future. Source: one-way synchronisation after Olson, "A passive solution to the sensor
    synchronization problem", IROS 2010, with a window in place of a drift model.
    """

    def __init__(self, *, is_of_its_own: bool = False) -> None:
        """`is_of_its_own` says that the stamps are never of the robot's clock, as of a board."""
        self._is_of_its_own = is_of_its_own
        self._delays: deque[tuple[float, float]] = deque()  # arrival, arrival minus stamp
        self._arrivals_s: deque[float] = deque()  # arrivals of messages without a stamp
        self._stamp_s = -math.inf

    def note_message(self, stamp_s: float, arrived_s: float) -> None:
        """Note a message's arrival; `arrived_s` is of the robot's clock."""
        if stamp_s == 0.0:
            self._arrivals_s.append(arrived_s)
            while arrived_s - self._arrivals_s[0] > WINDOW_S:
                self._arrivals_s.popleft()
            return
        back_s = self._stamp_s - stamp_s
        if back_s > (0.0 if self._is_of_its_own else WINDOW_S):
            self._delays.clear()  # the clock of the stamps began anew
        self._stamp_s = stamp_s
        self._delays.append((arrived_s, arrived_s - stamp_s))
        while arrived_s - self._delays[0][0] > WINDOW_S:
            self._delays.popleft()

    def convert_to_robot_s(self, stamp_s: float, arrived_s: float) -> float:
        """Return the capture time, on the robot's clock, of a message that was noted.

        Before the first one was, that of its arrival.
        Of several that come at once, such as after a pause of the network, note all first: the
        last of them was the quickest.
        """
        if stamp_s == 0.0 or not self._delays:
            return arrived_s
        shortest_s = min(delay_s for _, delay_s in self._delays)
        is_same = not self._is_of_its_own and -_AHEAD_S <= shortest_s <= SAME_CLOCK_S
        return min(stamp_s if is_same else stamp_s + shortest_s, arrived_s)

    @property
    def uncertainty_s(self) -> float:
        """Error of capture times, beside the shortest delay that there is at all.

        Of `n` delays that scatter by an exponential law, the shortest is longer than the least
        possible one by their mean excess over n - 1; the clocks drift apart for a window on top.
        Messages without a stamp have the times of their arrivals, which are off by as much as these
        scatter (`measure_scatter_s`). Infinite before there are enough. Source: Moon, Skelly and
        Towsley, "Estimation and removal of clock skew from network delay measurements", INFOCOM
        1999.
        """
        count = len(self._delays)
        if count < 2:
            return measure_scatter_s(list(self._arrivals_s))
        delays_s = [delay_s for _, delay_s in self._delays]
        excess_s = sum(delays_s) / count - min(delays_s)
        return excess_s / (count - 1) + WINDOW_S * DRIFT_RATIO


def measure_scatter_s(arrivals_s: list[float]) -> float:
    """Measure by how much messages of a steady device come late, from their intervals alone.

    Each interval is off by the difference of two delays, which for delays of an exponential law
    has their mean as its mean deviation. One that is a multiple of the usual, because messages in
    between were lost, counts as that. Infinite of fewer than three messages, and of a single heap.
    """
    intervals_s = [later - earlier for earlier, later in pairwise(arrivals_s)]
    if len(intervals_s) < 2:
        return math.inf
    usual_s = sorted(intervals_s)[len(intervals_s) // 2]
    if usual_s <= 0.0:  # they come in heaps
        usual_s = sum(intervals_s) / len(intervals_s)
    if usual_s <= 0.0:  # all in one heap: nothing is known of when they were sent
        return math.inf
    off_s = [abs(each - max(round(each / usual_s), 1) * usual_s) for each in intervals_s]
    return sum(off_s) / len(off_s)


class TickClock:
    """The robot's clock at any moment, also when its ticks are late.

    A loop that was suspended catches up: its ticks are then older than the moment they run at.
    The tick that was least late within `WINDOW_S` of running time counts as on time.
    """

    def __init__(self) -> None:
        self._leads: deque[tuple[float, float]] = deque()  # time at work, tick minus moment
        self._at_work_s = self._now_s = 0.0

    def note_tick(self, t_s: float, now_s: float) -> None:
        """Note that the tick of time `t_s` runs at the moment `now_s` of the monotonic clock."""
        if self._leads:
            self._at_work_s += min(now_s - self._now_s, LONGEST_TICK_S)
        self._now_s = now_s
        self._leads.append((self._at_work_s, t_s - now_s))
        while self._at_work_s - self._leads[0][0] > WINDOW_S:
            self._leads.popleft()

    def convert_to_robot_s(self, moment_s: float) -> float:
        """Return the robot's time at a moment of the monotonic clock; only after a first tick."""
        return moment_s + max(lead_s for _, lead_s in self._leads)


class _Arrival(NamedTuple):
    stamp_s: float
    arrived_s: float  # arrival by the monotonic clock
    sample: Any


class SampleQueue(Generic[Sample]):
    """Samples that a thread puts in on arrival, and the control loop takes at their time.

    `now_s` is the monotonic clock. A loop that catches up on lost time finds every sample in the
    tick in which it was captured. `latency_s` passes at least between capture and arrival; stamps
    of another clock cannot show that.
    """

    def __init__(
        self,
        now_s: Callable[[], float] = time.monotonic,
        *,
        latency_s: float = 0.0,
        is_of_its_own: bool = False,
        longest: int = QUEUE_SAMPLES,
        clock: StampClock | None = None,
    ) -> None:
        """`is_of_its_own` says that the other clock is never the robot's.

        `clock` is that of another queue, of the same device, which alone notes its messages: those
        of this one are then late where they come later than the other's. Of more than `longest`
        waiting samples, the oldest are lost.
        """
        self.now_s, self._latency_s = now_s, latency_s
        self._arrived: deque[_Arrival] = deque(maxlen=longest)
        self._ticks = TickClock()
        self.clock = clock or StampClock(is_of_its_own=is_of_its_own)
        self._notes = clock is None
        self._timed: deque[tuple[float, Sample]] = deque(maxlen=longest)  # samples by capture time
        self._last_s = -1.0

    @property
    def uncertainty_s(self) -> float:
        """Error of capture times; see `StampClock.uncertainty_s`."""
        return self.clock.uncertainty_s

    def put(self, stamp_s: float, arrived_s: float, sample: Sample) -> None:
        """Put a sample in, in any thread; `stamp_s` is of the other clock, 0 without a stamp."""
        self._arrived.append(_Arrival(stamp_s, arrived_s, sample))

    def take(self, t_s: float) -> tuple[Sample, ...]:
        """Take the samples captured until `t_s`; one not newer than its predecessor is dropped."""
        self._ticks.note_tick(t_s, self.now_s())
        arrivals = [self._arrived.popleft() for _ in range(len(self._arrived))]
        for stamp_s, arrived_s, _ in arrivals if self._notes else ():
            self.clock.note_message(stamp_s, self._ticks.convert_to_robot_s(arrived_s))
        for stamp_s, arrived_s, sample in arrivals:
            at_s = self.clock.convert_to_robot_s(stamp_s, self._ticks.convert_to_robot_s(arrived_s))
            at_s = max(at_s - self._latency_s, 0.0)
            if at_s > self._last_s:
                self._last_s = at_s
                self._timed.append((at_s, sample))
        taken = []
        while self._timed and self._timed[0][0] <= t_s:
            at_s, sample = self._timed.popleft()
            taken.append(msgspec.structs.replace(sample, t_s=at_s))
        return tuple(taken)
