"""How far off the position can be: a protection level that also holds when the GNSS lies.

Two hypotheses are bounded and the larger bound counts. Without a fault the covariance holds: an
error of two axes, each at most of 1 sigma s, exceeds r with probability exp(-r^2 / 2 s^2). With a
GNSS that has been wrong since some seconds the robot is where dead reckoning from before leads
it; the distance of that solution from the filter's, and its own spread, bound the error. In turns,
where wheels on soft ground lose much of their way, it follows the velocities of the receiver.
Source: solution separation, Blanch et al. 2015, "Baseline advanced RAIM user algorithm and
possible improvements", IEEE Transactions on Aerospace and Electronic Systems 51(1).
"""

from __future__ import annotations

import math
from collections import deque
from statistics import NormalDist
from typing import NamedTuple

from agribot.autonomy.estimate.filter.ekf import ROW_OFFSET, SLIP, WHEEL_SCALE, YAW, X, Y
from agribot.autonomy.estimate.filter.slope import SLIDE_STD_RATIO
from agribot.autonomy.estimate.sensors.gnss import SUSPICIOUS_REJECTIONS, Gnss
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.autonomy.estimate.witnesses.velocity_way import VelocityMark
from agribot.core.arithmetic import clamp
from agribot.core.geo import std_along_m
from agribot.core.pose import Pose2

# Probability of a receiver that lies, before evidence against it.
FAULT_RATIO = 0.1
ANCHOR_PERIOD_S, ANCHOR_AGE_S = 1.0, 5.0
# Wrong fixes and multipath last minutes; then a jump that nothing took back is believed.
MEMORY_S = 300.0
# Wheels that are dragged aside by a turn lose more of their way than they do ahead: 15 % on tilled
# soil in turns tighter than 2 m, as measured in the simulator, 1 % on hard ground. The share is
# learnt over LEARNING_WAY_M of turning while the receiver shows a loss and nothing else; the rest
# has this share of the way as 1 sigma, and as much again as turns have cost.
TURN_RADIUS_M, TURN_LOSS_STD_RATIO = 2.0, 0.05
LEARNING_WAY_M, LEARNING_GAIN = 0.2, 0.02
LOSS_RESIDUAL_RATIO, LOSS_RESIDUAL_M = 0.3, 0.03
# Way in turns from which the velocities of the receiver show where the robot is, too.
VOUCHED_TURNING_M = 0.2
# Error below which something holds the filter; above it, it follows the wheels and shows no loss.
LEARNING_STD_M = 0.03
# Largest change of heading for which the camera's hold across the row still counts.
HELD_HEADING_COS = math.cos(math.radians(20.0))
# Two solutions that differ by less than this part of the alarm agree again.
AGREE_RATIO = 0.5
# Largest share of the wheels' way that slip loses; beyond it the GNSS or the robot stands still.
MAX_LOST_RATIO = 0.1


Cov2 = tuple[float, float, float]


class Spread(NamedTuple):
    """1 sigma of what the filter believes now: position, and the course and length of a way.

    `cov_m2` is the position's covariance: xx, xy and yy in the map.
    """

    position_m: float
    cov_m2: Cov2
    course_rad: float
    scale_ratio: float


class _Anchor(NamedTuple):
    """The filter's position less the dead-reckoned one, and all that was driven until then.

    `aside_m` is how far the way up to then leads aside for each radian of side slip, `slip_rad`
    what the filter believed of that: a GNSS that begins to creep afterwards has no part in it.
    """

    t_s: float
    x_m: float
    y_m: float
    driven_m: float
    spread: Spread
    aside_m: tuple[float, float]
    slip_rad: float
    slid_m: float
    turning_m: float
    turning_way_m: tuple[float, float]
    by_velocity: VelocityMark | None

    def apart_m(self, here: _Anchor) -> tuple[float, float]:
        """Vector from the place of dead reckoning at a later time to that of the filter."""
        slip_rad, (then_x, then_y), (x, y) = self.slip_rad, self.aside_m, here.aside_m
        return (
            here.x_m - self.x_m - slip_rad * (x - then_x),
            here.y_m - self.y_m - slip_rad * (y - then_y),
        )

    def turned_m(self, here: _Anchor) -> tuple[float, float]:
        """Way in turns from here to a later place, by the wheels."""
        (then_x, then_y), (x, y) = self.turning_way_m, here.turning_way_m
        return x - then_x, y - then_y


class _Hold(NamedTuple):
    """Last hold of the camera: its place, the filter's shift by GNSS, and the left."""

    anchor: _Anchor
    moved_m: tuple[float, float]
    left: tuple[float, float]


class Bounds(NamedTuple):
    """Bounds of the error: in any direction, and to the side of the heading.

    `across_plain_m` is what the covariance alone makes of the latter, as if no GNSS were ever
    wrong, `across_unknown_m` what it would be if no two solutions differed: mere ignorance,
    without what speaks against the pose.
    """

    anywhere_m: float
    across_m: float
    across_plain_m: float
    across_unknown_m: float


class Integrity:
    """Call `move` for every step of the wheels, `bound` for the bounds of the present pose."""

    def __init__(self, pose: PoseFilter, gnss: Gnss) -> None:
        config = pose.config
        self._ekf, self._pose = pose.ekf, pose
        self._gnss = gnss
        self._gain = _rayleigh(config.protection_risk)
        self._fault_gain = _rayleigh(config.protection_risk / FAULT_RATIO)
        self._across_gain = _normal(config.protection_risk)
        self._across_fault_gain = _normal(config.protection_risk / FAULT_RATIO)
        self._walk2_m = config.position_walk_m_per_sqrt_m**2
        self._x_m = self._y_m = self._driven_m = self._aside_x_m = self._aside_y_m = 0.0
        self._slid_m = self._turning_m = self._turning_x_m = self._turning_y_m = 0.0
        self._turn_loss_ratio, self._max_turn_loss_ratio = 0.0, config.max_turn_loss_ratio
        self._anchors: deque[_Anchor] = deque()
        self._is_split = False  # the two solutions contradict each other
        self._believed_m = self._moved_m = gnss.moved_m
        self._moved_t_s = -math.inf
        self._hold: _Hold | None = None

    def move(
        self,
        distance_m: float,
        slide_m: tuple[float, float] = (0.0, 0.0),
        turn_rad: float = 0.0,
    ) -> None:
        """Add a step of the wheels, along the heading of the filter, and its slide down a slope.

        The slide is forward and left, the turn that of the step.
        """
        lost_ratio = clamp(self._ekf.x[WHEEL_SCALE], -MAX_LOST_RATIO, MAX_LOST_RATIO)
        way_m, course_rad = distance_m * (1.0 - lost_ratio), self._ekf.x[YAW]
        cos, sin = math.cos(course_rad), math.sin(course_rad)
        self._x_m += way_m * cos + slide_m[0] * cos - slide_m[1] * sin
        self._y_m += way_m * sin + slide_m[0] * sin + slide_m[1] * cos
        self._slid_m += math.hypot(*slide_m)
        turning_m = _measure_turning_m(way_m, turn_rad)
        self._turning_m += abs(turning_m)
        self._turning_x_m += turning_m * cos
        self._turning_y_m += turning_m * sin
        self._driven_m += abs(way_m)
        slips_m = abs(way_m) * self._ekf.slip_ratio(course_rad)
        self._aside_x_m -= slips_m * sin
        self._aside_y_m += slips_m * cos

    def find_turn_loss_m(self, distance_m: float, turn_rad: float) -> float:
        """Find the way that the wheels lose in a turn, as learnt from the turns until now."""
        return self._turn_loss_ratio * _measure_turning_m(distance_m, turn_rad)

    def restart(self) -> None:
        """Forget what was before: a person says where the robot is."""
        self._anchors.clear()
        self._is_split = False
        self._believed_m = self._gnss.moved_m
        self._hold = None

    def bound(self, t_s: float, pos_std_m: float, *, is_ok: bool, is_held: bool) -> Bounds:
        """Bound the error of the present pose; infinite where there is no pose.

        `is_held`: the camera holds it on its row, so that no fault of the GNSS moves it aside.
        """
        plain_m = self._across_gain * std_along_m(self._cov_m2, self._left)
        if not is_ok:
            return Bounds(math.inf, math.inf, plain_m, plain_m)
        here = self._here(t_s, pos_std_m)
        anywhere_m = self._anywhere_m(here)
        led, beside_m = self._pose.lines.led, plain_m + self._pose.agreement.doubted_m
        if is_held and led is None:
            self._hold = _Hold(here, self._gnss.moved_m, self._left)
            return Bounds(anywhere_m, beside_m, plain_m, plain_m)
        across_m, unknown_m = self._bound_across(here, plain_m)
        if led is not None:  # a camera that lies leads the filter off, or is about to
            led_m = abs(led.off_m) + self._across_fault_gain * led.std_m
            across_m = max(across_m, led_m)
        return Bounds(anywhere_m, across_m, plain_m, unknown_m)

    def _anywhere_m(self, here: _Anchor) -> float:
        """Radius around the position that holds the robot."""
        self._keep(here)
        anchor = self._anchors[0]
        self._learn_turn_loss(anchor, here)
        apart_m = math.hypot(*self._apart_m(anchor, here))
        alone_m = self._fault_gain * self._alone_std_m(anchor)
        if parted := self._compare_with_velocity(anchor, here):
            apart_m = abs(parted[0])
            alone_m = self._fault_gain * math.hypot(anchor.spread.position_m, parted[1])
        self._is_split = apart_m > alone_m * (AGREE_RATIO if self._is_split else 1.0)
        self._forget(here, anchor)
        plain_m = self._gain * here.spread.position_m
        return max(plain_m + self._doubted_m(), apart_m + alone_m, self._unseen_creep_m())

    def _compare_with_velocity(
        self, anchor: _Anchor, here: _Anchor
    ) -> tuple[complex, float] | None:
        """Measure the filter's distance from the receiver's velocities, and 1 sigma of these.

        None where the robot has hardly turned: there the wheels know better.
        """
        if here.turning_m - anchor.turning_m < VOUCHED_TURNING_M:
            return None
        return self._gnss.velocity.way.compare(anchor.by_velocity, here.by_velocity)

    def _bound_across(self, here: _Anchor, plain_m: float) -> tuple[float, float]:
        """Bound the error to the side of the heading, and how much of it is mere ignorance.

        After `_anywhere_m`.
        """
        gnss, left = self._gnss, self._left
        anchor, believed_m = self._find_sure(left)
        moved_m = abs(_along(left, gnss.moved_m) - _along(left, believed_m))
        doubted_m = moved_m + (abs(_along(left, gnss.rejected_m)) if self._is_off else 0.0)
        doubted_m += abs(_along(left, gnss.drift.apart_m)) + self._bound_creep_m(left)
        apart_m = abs(_along(left, self._apart_m(anchor, here)))
        driven_m = self._driven_m - anchor.driven_m
        alone_m = math.sqrt(
            std_along_m(anchor.spread.cov_m2, left) ** 2
            + self._walk2_m * driven_m
            + (anchor.spread.course_rad * driven_m) ** 2
            + self._slid_m2(anchor)
        )
        unknown_m = self._across_fault_gain * alone_m
        if parted := self._compare_with_velocity(anchor, here):
            apart_m = abs(_along(left, (parted[0].real, parted[0].imag)))
            begun_m = std_along_m(anchor.spread.cov_m2, left)
            unknown_m = self._across_fault_gain * math.hypot(begun_m, parted[1])
        return max(plain_m + doubted_m, apart_m + unknown_m), max(plain_m, unknown_m)

    def _find_sure(self, left: tuple[float, float]) -> tuple[_Anchor, tuple[float, float]]:
        """Find from where on dead reckoning counts to the side, and what GNSS had moved until then.

        Where the camera has held the robot since, two solutions that were split are so no more to
        that side: the crop row itself has decided.
        """
        anchor, hold = self._anchors[0], self._hold
        if not self._is_split or hold is None or hold.anchor.t_s <= anchor.t_s:
            return anchor, self._believed_m
        is_so_still = _along(hold.left, left) >= HELD_HEADING_COS
        return (hold.anchor, hold.moved_m) if is_so_still else (anchor, self._believed_m)

    def _apart_m(self, anchor: _Anchor, here: _Anchor) -> tuple[float, float]:
        """Measure the vector from dead reckoning to the filter, less the usual cost of turns."""
        (x_m, y_m), (lost_x, lost_y) = anchor.apart_m(here), anchor.turned_m(here)
        return x_m + self._turn_loss_ratio * lost_x, y_m + self._turn_loss_ratio * lost_y

    def _learn_turn_loss(self, anchor: _Anchor, here: _Anchor) -> None:
        """Learn what share of their way turns cost, where that explains how far it is apart."""
        (x_m, y_m), (way_x, way_y) = anchor.apart_m(here), anchor.turned_m(here)
        way_m2 = way_x * way_x + way_y * way_y
        is_held = here.spread.position_m <= LEARNING_STD_M
        if way_m2 < LEARNING_WAY_M**2 or self._is_off or not is_held:
            return
        ratio = -(x_m * way_x + y_m * way_y) / way_m2
        residual_m = math.hypot(x_m + ratio * way_x, y_m + ratio * way_y)
        is_loss = 0.0 <= ratio <= self._max_turn_loss_ratio
        if is_loss and residual_m <= LOSS_RESIDUAL_RATIO * math.hypot(x_m, y_m) + LOSS_RESIDUAL_M:
            self._turn_loss_ratio += LEARNING_GAIN * (ratio - self._turn_loss_ratio)

    @property
    def _cov_m2(self) -> Cov2:
        """Covariance of the position against the true places of the field's rows."""
        cov, x = self._ekf.cov, self._ekf.x
        xx, xy, yy = float(cov[X, X]), float(cov[X, Y]), float(cov[Y, Y])
        off_m2 = float(cov[ROW_OFFSET, ROW_OFFSET])
        if not off_m2:
            return xx, xy, yy
        east, north = self._pose.rows.at(x[X], x[Y]).right
        off_x, off_y = float(cov[X, ROW_OFFSET]), float(cov[Y, ROW_OFFSET])
        return (
            xx - 2.0 * east * off_x + east * east * off_m2,
            xy - east * off_y - north * off_x + east * north * off_m2,
            yy - 2.0 * north * off_y + north * north * off_m2,
        )

    @property
    def _left(self) -> tuple[float, float]:
        return Pose2(0.0, 0.0, self._ekf.x[YAW]).left

    def _here(self, t_s: float, pos_std_m: float) -> _Anchor:
        x, cov = self._ekf.x, self._ekf.cov
        course_rad = math.sqrt(cov[YAW, YAW] + cov[SLIP, SLIP])
        wheel_ratio = math.sqrt(cov[WHEEL_SCALE, WHEEL_SCALE])
        spread = Spread(pos_std_m, self._cov_m2, course_rad, wheel_ratio)
        return _Anchor(
            t_s, x[X] - self._x_m, x[Y] - self._y_m, self._driven_m, spread,
            (self._aside_x_m, self._aside_y_m), x[SLIP], self._slid_m, self._turning_m,
            (self._turning_x_m, self._turning_y_m), self._gnss.velocity.way.find_mark(t_s),
        )  # fmt: skip

    def _forget(self, here: _Anchor, anchor: _Anchor) -> None:
        """Begin dead reckoning anew from here: what has contradicted for long is believed."""
        if self._gnss.moved_m != self._moved_m:
            self._moved_m, self._moved_t_s = self._gnss.moved_m, here.t_s
        if here.t_s - anchor.t_s > MEMORY_S and here.t_s - self._moved_t_s > MEMORY_S:
            self.restart()
            self._anchors.append(here)

    def _doubted_m(self) -> float:
        """Sum up how far off the robot may be: rejected fixes, followed ones, and their drift.

        A jump that is taken back leaves nothing of this. A receiver whose positions and velocity
        differ may have led the filter off by the difference.
        """
        gnss = self._gnss
        rejected_m = math.hypot(*gnss.rejected_m) if self._is_off else 0.0
        apart_m = math.hypot(*gnss.drift.apart_m) + self._bound_creep_m()
        return math.dist(gnss.moved_m, self._believed_m) + rejected_m + apart_m

    def _bound_creep_m(self, left: tuple[float, float] | None = None) -> float:
        """Bound how far a slow creep may have led the filter off, to one side or anywhere."""
        doubt = self._gnss.drift.slow.doubt
        if doubt is None:
            return 0.0
        if left is None:
            return doubt.bound_m(self._fault_gain)
        aside_m = abs(_along(left, (doubt.apart_m.real, doubt.apart_m.imag)))
        return aside_m + self._across_fault_gain * doubt.std_m

    def _unseen_creep_m(self) -> float:
        """Bound how far a creep may have led the filter off that the receiver itself cannot see."""
        widest = self._gnss.drift.slow.widest
        return widest.bound_m(self._fault_gain) if widest else 0.0

    @property
    def _is_off(self) -> bool:
        gnss = self._gnss
        return gnss.rejected_in_a_row >= SUSPICIOUS_REJECTIONS or gnss.jump.off_m > 0.0

    def _keep(self, here: _Anchor) -> None:
        """Let the oldest anchor follow some seconds behind, unless the solutions are split."""
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
        drift_m2 = (drift_ratio * driven_m) ** 2
        return math.sqrt(spread.position_m**2 + walk_m2 + drift_m2 + self._slid_m2(anchor))

    def _slid_m2(self, anchor: _Anchor) -> float:
        """Variance of what turns have cost since the anchor: sliding down a slope, lost way."""
        slid_m = SLIDE_STD_RATIO * (self._slid_m - anchor.slid_m)
        loss_ratio = TURN_LOSS_STD_RATIO + self._turn_loss_ratio
        lost_m = loss_ratio * (self._turning_m - anchor.turning_m)
        return slid_m * slid_m + lost_m * lost_m


def _measure_turning_m(way_m: float, turn_rad: float) -> float:
    """Return the part of a way that counts as turning: all of it in turns of TURN_RADIUS_M."""
    return math.copysign(min(abs(way_m), TURN_RADIUS_M * abs(turn_rad)), way_m)


def _rayleigh(risk_ratio: float) -> float:
    """Radius in sigmas that two normal errors exceed with this probability."""
    return math.sqrt(-2.0 * math.log(min(risk_ratio, 0.5)))


def _normal(risk_ratio: float) -> float:
    """Distance in sigmas that one normal error exceeds with this probability, either way."""
    return NormalDist().inv_cdf(1.0 - min(risk_ratio, 0.5) / 2.0)


def _along(direction: tuple[float, float], vector_m: tuple[float, float]) -> float:
    return direction[0] * vector_m[0] + direction[1] * vector_m[1]
