"""A position that creeps away: fixes held against their own velocity, and against the wheels.

Three witnesses show how far the antenna moved in the last seconds: the fixes, the integrated
velocity of the receiver (from the carrier's Doppler shift, independent of wrong ambiguities), and
wheels with gyro. Fixes that differ from both of the others are wrong. Several windows are compared,
since a fast creep shows in a short one and a slow one in a long one.
Source: solution separation with a bank of windows; Blanch et al. 2015 (see `integrity`); Joerger
and Pervan 2013, "Kalman filter-based integrity monitoring against sensor faults", Journal of
Guidance, Control, and Dynamics 36(2).
"""

from __future__ import annotations

import cmath
import math
from collections import deque
from typing import NamedTuple

from agribot.autonomy.estimate.witnesses.slow_creep import CreepMark, SlowCreep
from agribot.autonomy.estimate.witnesses.velocity_way import MAX_GAP_S
from agribot.core.facts import GnssCrept, GnssParts

WINDOWS_S = (1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0)
STEP_S = 0.1  # least distance of kept fixes
# Largest lasting error of the velocities of a receiver with fixed ambiguities. A standing NEO-M8T,
# of one frequency, showed 6 mm/s over 38 s (log ublox-neo-m8t of gpsd).
MOST_BIAS_MPS = 0.01
# Receivers smooth velocities; their sum lags behind by the change of speed times some tenths.
LAG_STD_S = 0.1
# Two normal errors exceed this squared distance once in a million times.
ALARM2 = -2.0 * math.log(1e-6)
# Least duration of an error of the fixes: a single one is an outlier, which the gate rejects.
LASTS_S = 0.5
# Delay of the report, and its duration, where the wheels cannot show which of the two is wrong.
APART_LASTS_S = 2.0
# Wheels and gyro bear it out: beyond two sigmas themselves, and nearer to the velocity.
BORNE_OUT2 = 4.0
FAR_M = 0.3  # gap beyond which it is enough that they are nearer to the velocity
# On soil wheels slip by 2 to 5 %, in turns they lose up to 0.3 m for each radian.
SOIL_RATIO, TURN_LOSS_M_PER_RAD = 0.03, 0.3
# Largest share of the wheels' way that slip loses.
MAX_LOST_RATIO = 0.1


class WitnessReport(NamedTuple):
    """Measurements of the witnesses at a fix; vectors of the map are complex, East + i North.

    `driven_mps` is the velocity of the wheels along the heading that the gyro has summed up, and
    `turn` what makes the robot's true way of it, as the filter has it then: a rotation, and the
    share of the way that is not lost. `arm_m` leads from the robot to the antenna.
    """

    t_s: float
    place_m: complex
    velocity_mps: complex
    driven_mps: complex
    turn: complex
    arm_m: complex
    way_m: float
    turned_rad: float


class Trust(NamedTuple):
    """1 sigma of a fix, of one velocity, and of the course and the length of a way.

    The bias of a fix walks by `bias_m2_per_s`; wheels gather `walk_m2_per_m` on their way.
    """

    fix_m: float
    bias_m2_per_s: float
    velocity_mps: float
    course_rad: float
    scale_ratio: float
    walk_m2_per_m: float


class _Sums(NamedTuple):
    """A fix with the ways up to it by velocity and by wheels, and the squares of its gaps, s^2."""

    report: WitnessReport
    flown_m: complex
    driven_m: complex
    gaps2_s2: float


class _Creep(NamedTuple):
    """Distance of fixes and their velocity, and whether the wheels side with the latter."""

    window_s: float
    apart_m: complex
    is_borne_out: bool


class DriftWatch:
    """Call `add` with every fix of carrier corrections, `restart` where others come between."""

    def __init__(self) -> None:
        self._sums: deque[_Sums] = deque()
        self._last: _Sums | None = None
        self._since_s: float | None = None
        self.off_m = (0.0, 0.0)  # creep of the fixes; zero while they are believed
        self._over_s = 0.0
        # Distance of fixes and velocity, whatever the wheels say: one of the two is wrong.
        self.apart_m = (0.0, 0.0)
        self.suspicion: GnssParts | None = None  # the same, once it has lasted
        self._apart_since_s: float | None = None
        self._apart_t_s = -math.inf
        self.slow = SlowCreep()

    @property
    def is_drifting(self) -> bool:
        return self.off_m != (0.0, 0.0)

    @property
    def fault(self) -> GnssCrept | None:
        return GnssCrept(math.hypot(*self.off_m), self._over_s) if self.is_drifting else None

    def restart(self) -> None:
        """Forget all fixes and what was said of them."""
        self._sums.clear()
        self._last, self._since_s, self.off_m = None, None, (0.0, 0.0)
        self.slow.restart()
        self._clear_suspicion()

    def add(self, report: WitnessReport, trust: Trust) -> None:
        if self._last is not None and report.t_s - self._last.report.t_s > MAX_GAP_S:
            self.restart()
        here = self._last = _sum_up(self._last, report)
        self.slow.add(_mark(here, trust), trust.velocity_mps, trust.bias_m2_per_s)
        found = self._find_creep(here, trust)
        self._suspect(report.t_s, found)
        if found is None or not found.is_borne_out:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = report.t_s
        elif report.t_s - self._since_s >= LASTS_S:
            self._over_s, self.off_m = found.window_s, (found.apart_m.real, found.apart_m.imag)
            self._clear_suspicion()
        if not self._sums or report.t_s - self._sums[-1].report.t_s >= STEP_S - 1e-6:
            self._sums.append(here)
        while report.t_s - self._sums[0].report.t_s > WINDOWS_S[-1] + STEP_S:
            self._sums.popleft()

    def _suspect(self, t_s: float, found: _Creep | None) -> None:
        """Hold for some seconds how far fixes and velocity were apart at most."""
        if t_s - self._apart_t_s > APART_LASTS_S:
            self._clear_suspicion()
        if found is None:
            return
        if abs(found.apart_m) >= math.hypot(*self.apart_m):
            self.apart_m, self._apart_t_s = (found.apart_m.real, found.apart_m.imag), t_s
        if self._apart_since_s is None:
            self._apart_since_s = t_s
        elif self.suspicion is None and t_s - self._apart_since_s >= APART_LASTS_S:
            self.suspicion = GnssParts(abs(found.apart_m), found.window_s)

    def _clear_suspicion(self) -> None:
        self.apart_m, self.suspicion, self._apart_since_s = (0.0, 0.0), None, None

    def straighten(self, since_s: float, rate_radps: float) -> None:
        """Take back that the gyro has turned too fast since then, as is known only now."""
        if self._last is None:
            return
        bent_rad = max(0.0, self._last.report.t_s - since_s) * rate_radps
        then, last, turn = deque(self._sums), None, None
        self._sums.clear()
        for each in (*then, self._last):
            report, late_s = each.report, max(0.0, each.report.t_s - since_s)
            # The filter's correction of the wheels' heading holds for the past.
            turn = report.turn if turn is None or not late_s else turn
            by_rad = bent_rad - rate_radps * late_s
            report = report._replace(
                driven_mps=report.driven_mps * cmath.rect(1.0, by_rad),
                turn=turn * cmath.rect(1.0, -bent_rad),
            )
            # The sums go on from where they were: slow creeps are held against them, too.
            last = each._replace(report=report) if last is None else _sum_up(last, report)
            self._sums.append(last)
        self._last = self._sums.pop()

    def _find_creep(self, here: _Sums, trust: Trust) -> _Creep | None:
        """Find the window in which the fixes part most, and whether the wheels bear out any."""
        index = len(self._sums) - 1
        found: list[_Creep] = []
        for window_s in WINDOWS_S:
            latest_s = here.report.t_s - window_s + STEP_S / 2.0
            while index >= 0 and self._sums[index].report.t_s > latest_s:
                index -= 1
            if index < 0:
                break
            creep = _judge(self._sums[index], here, trust, window_s)
            if creep is not None:
                found.append(creep)
        if not found:
            return None
        return max(found, key=_size_m)._replace(
            is_borne_out=any(creep.is_borne_out for creep in found)
        )


def _size_m(creep: _Creep) -> float:
    return abs(creep.apart_m)


def _sum_up(last: _Sums | None, report: WitnessReport) -> _Sums:
    """Add the ways since the last fix, as the mean of the velocities at both."""
    if last is None:
        return _Sums(report, 0j, 0j, 0.0)
    gap_s = report.t_s - last.report.t_s
    return _Sums(
        report,
        last.flown_m + gap_s / 2.0 * (last.report.velocity_mps + report.velocity_mps),
        last.driven_m + gap_s / 2.0 * (last.report.driven_mps + report.driven_mps),
        last.gaps2_s2 + gap_s * gap_s,
    )


def _mark(here: _Sums, trust: Trust) -> CreepMark:
    report = here.report
    return CreepMark(
        report.t_s, report.place_m - here.flown_m, here.gaps2_s2,
        report.turn * report.driven_mps, report.way_m, trust.fix_m**2,
    )  # fmt: skip


class _Witness(NamedTuple):
    """Distance of the fixes from where a witness led since a time, and the variance of its way.

    A lasting error of the witness may have led it off by `lasting_m` besides.
    """

    apart_m: complex
    way_m2: float
    lasting_m: float = 0.0

    def contradicts(self, fixes_m2: float, limit2: float = ALARM2) -> bool:
        off_m = max(0.0, abs(self.apart_m) - self.lasting_m)
        return off_m**2 > limit2 * (fixes_m2 + self.way_m2)


def _judge(then: _Sums, here: _Sums, trust: Trust, window_s: float) -> _Creep | None:
    """Hold the fixes against the surer of velocity and wheels, then against the other one.

    Velocities may be off by MOST_BIAS_MPS for as long as they are summed up, wheels are by a share
    of their way: those of a robot that stands are surer, where the velocity bears them out.
    """
    lasted_s = here.report.t_s - then.report.t_s
    fixes_m2 = 2.0 * trust.fix_m**2 + trust.bias_m2_per_s * lasted_s
    velocity, wheels = _ask_velocity(then, here, trust), _ask_wheels(then, here, trust)
    between_m = abs(velocity.apart_m - wheels.apart_m)
    is_alone = between_m < min(abs(velocity.apart_m), abs(wheels.apart_m))
    if velocity.contradicts(fixes_m2):
        is_off = wheels.contradicts(fixes_m2, BORNE_OUT2) or abs(velocity.apart_m) >= FAR_M
        return _Creep(window_s, velocity.apart_m, is_borne_out=is_off and is_alone)
    if wheels.way_m2 < velocity.way_m2 and wheels.contradicts(fixes_m2) and is_alone:
        return _Creep(window_s, wheels.apart_m, is_borne_out=True)
    return None


def _ask_velocity(then: _Sums, here: _Sums, trust: Trust) -> _Witness:
    lasted_s = here.report.t_s - then.report.t_s
    change_mps = abs(here.report.driven_mps - then.report.driven_mps)
    noise_m2 = trust.velocity_mps**2 * (here.gaps2_s2 - then.gaps2_s2)
    moved_m = here.report.place_m - then.report.place_m
    apart_m = moved_m - (here.flown_m - then.flown_m)
    velocity_m2 = noise_m2 + (LAG_STD_S * change_mps) ** 2
    return _Witness(apart_m, velocity_m2, MOST_BIAS_MPS * lasted_s)


def _ask_wheels(then: _Sums, here: _Sums, trust: Trust) -> _Witness:
    # The filter's belief at the start: later creep has no part in it.
    driven_m = then.report.turn * (here.driven_m - then.driven_m)
    moved_m = here.report.place_m - then.report.place_m
    way_m = here.report.way_m - then.report.way_m
    turn_m = TURN_LOSS_M_PER_RAD * (here.report.turned_rad - then.report.turned_rad)
    ratio2 = trust.course_rad**2 + trust.scale_ratio**2 + SOIL_RATIO**2
    return _Witness(
        moved_m - driven_m - (here.report.arm_m - then.report.arm_m),
        trust.walk_m2_per_m * way_m + ratio2 * way_m**2 + turn_m**2,
    )
