"""How far off the position can be: a protection level that also holds when the GNSS lies.

Two hypotheses are bounded and the larger bound counts. Without a fault the covariance holds: an
error of two axes, each at most of 1 sigma s, exceeds r with probability exp(-r^2 / 2 s^2). With a
GNSS that has been wrong since some seconds the robot is where dead reckoning from before leads
it; the distance of that solution from the filter's, and its own spread, bound the error.
Source: solution separation, Blanch et al. 2015, "Baseline advanced RAIM user algorithm and
possible improvements", IEEE Transactions on Aerospace and Electronic Systems 51(1).
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from agribot.config import EstimateConfig
from agribot.estimate.ekf import SLIP, WHEEL_SCALE, YAW, Ekf, X, Y
from agribot.estimate.gnss import Gnss

# Before anything speaks against it, a receiver that lies is given this probability.
FAULT_RATIO = 0.1
ANCHOR_PERIOD_S, ANCHOR_AGE_S = 1.0, 5.0
# Wrong fixes and multipath last minutes; then a jump that nothing took back is believed.
MEMORY_S = 300.0
# Two solutions that differ by less than this part of the alarm agree again.
AGREE_RATIO = 0.5
# More than this share of the wheels' way is not lost by slip: the GNSS stands still, or the robot.
MAX_LOST_RATIO = 0.1
SUSPICIOUS_REJECTIONS = 5


class Spread(NamedTuple):
    """1 sigma of what the filter believes now: position, and the course and length of a way."""

    position_m: float
    course_rad: float
    scale_ratio: float


class _Anchor(NamedTuple):
    """The filter's position less the dead-reckoned one, and all that was driven until then."""

    t_s: float
    x_m: float
    y_m: float
    driven_m: float
    spread: Spread


class Integrity:
    """Call `move` for every step of the wheels, `level_m` for the bound of the present pose."""

    def __init__(self, config: EstimateConfig, ekf: Ekf, gnss: Gnss) -> None:
        self._ekf = ekf
        self._gnss = gnss
        self._gain = _rayleigh(config.protection_risk)
        self._fault_gain = _rayleigh(config.protection_risk / FAULT_RATIO)
        self._walk2_m = config.position_walk_m_per_sqrt_m**2
        self._x_m = self._y_m = self._driven_m = 0.0
        self._anchors: deque[_Anchor] = deque()
        self._is_split = False  # the two solutions contradict each other
        self._believed_m = self._moved_m = gnss.moved_m
        self._moved_t_s = -math.inf

    def move(self, distance_m: float) -> None:
        """A step of the wheels, along the heading of the filter."""
        lost_ratio = min(max(self._ekf.x[WHEEL_SCALE], -MAX_LOST_RATIO), MAX_LOST_RATIO)
        way_m, course_rad = distance_m * (1.0 - lost_ratio), self._ekf.x[YAW]
        self._x_m += way_m * math.cos(course_rad)
        self._y_m += way_m * math.sin(course_rad)
        self._driven_m += abs(way_m)

    def restart(self) -> None:
        """A person says where the robot is: nothing from before counts."""
        self._anchors.clear()
        self._is_split = False
        self._believed_m = self._gnss.moved_m

    def level_m(self, t_s: float, pos_std_m: float) -> float:
        """Radius around the position that holds the robot."""
        here = self._here(t_s, pos_std_m)
        self._keep(here)
        anchor = self._anchors[0]
        apart_m = math.dist((here.x_m, here.y_m), (anchor.x_m, anchor.y_m))
        alone_m = self._fault_gain * self._alone_std_m(anchor)
        self._is_split = apart_m > alone_m * (AGREE_RATIO if self._is_split else 1.0)
        self._forget(t_s, anchor)
        plain_m = self._gain * pos_std_m
        return max(plain_m + self._doubted_m(), apart_m + alone_m)

    def _here(self, t_s: float, pos_std_m: float) -> _Anchor:
        x, cov = self._ekf.x, self._ekf.cov
        course_rad = math.sqrt(cov[YAW, YAW] + cov[SLIP, SLIP])
        spread = Spread(pos_std_m, course_rad, math.sqrt(cov[WHEEL_SCALE, WHEEL_SCALE]))
        return _Anchor(t_s, x[X] - self._x_m, x[Y] - self._y_m, self._driven_m, spread)

    def _forget(self, t_s: float, anchor: _Anchor) -> None:
        """What has contradicted for long is believed."""
        if self._gnss.moved_m != self._moved_m:
            self._moved_m, self._moved_t_s = self._gnss.moved_m, t_s
        if t_s - anchor.t_s > MEMORY_S and t_s - self._moved_t_s > MEMORY_S:
            self.restart()

    def _doubted_m(self) -> float:
        """Where else the robot may be: at the fixes that are rejected, or before it followed them.

        A jump that is taken back leaves nothing of this.
        """
        gnss = self._gnss
        is_off = gnss.rejected_in_a_row >= SUSPICIOUS_REJECTIONS
        return math.dist(gnss.moved_m, self._believed_m) + (gnss.rejected_m if is_off else 0.0)

    def _keep(self, here: _Anchor) -> None:
        """The oldest anchor follows some seconds behind, unless the solutions are split."""
        anchors = self._anchors
        if self._is_split:
            return
        if not anchors or here.t_s - anchors[-1].t_s >= ANCHOR_PERIOD_S:
            anchors.append(here)
        while here.t_s - anchors[0].t_s > ANCHOR_AGE_S and len(anchors) > 1:
            anchors.popleft()

    def _alone_std_m(self, anchor: _Anchor) -> float:
        """1 sigma of dead reckoning since the anchor."""
        driven_m, spread = self._driven_m - anchor.driven_m, anchor.spread
        drift_ratio = math.hypot(spread.course_rad, spread.scale_ratio)
        walk_m2 = self._walk2_m * driven_m
        return math.sqrt(spread.position_m**2 + walk_m2 + (drift_ratio * driven_m) ** 2)


def _rayleigh(risk_ratio: float) -> float:
    """Radius in sigmas that two normal errors exceed with this probability."""
    return math.sqrt(-2.0 * math.log(min(risk_ratio, 0.5)))
