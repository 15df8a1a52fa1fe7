"""The CPU time of a training: all of its process, not of its steps alone."""

from __future__ import annotations

import os


class CpuMeter:
    """CPU time of this process and of its children that have ended, since the meter was made.

    `earlier_s` is what calls before this one used, of a training that goes on.
    """

    def __init__(self) -> None:
        self._zero_s = _measure_cpu_s()
        self.earlier_s = 0.0

    @property
    def spent_s(self) -> float:
        return self.earlier_s + _measure_cpu_s() - self._zero_s


def _measure_cpu_s() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
