"""Command against motion: whether wheels and gyro follow the motors' command.

The motor board's ramps are modelled from the sent commands. A wheel may turn between the slowest
and the fastest speed of the last moments, so that neither a delay of that length nor a board
without ramps is a fault. Encoders are compared by angles over 0.1 s, which an encoder's whole ticks
do not disturb.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from agribot.autonomy.control.rest_watch import RestWatch
from agribot.autonomy.control.roll_out import RollOut
from agribot.core.arithmetic import clamp
from agribot.core.facts import (
    Fact,
    HeldInTurn,
    ImuFrozen,
    Motion,
    MotorDead,
    TurnsDisagree,
    Wheel,
    WheelsSwapped,
    WheelsWrong,
)
from agribot.core.messages import DriveCommand, Four, SensorBatch, WheelSample
from agribot.core.robot import DriveSpec

SPAN_S = 0.1
LASTING_S = 0.4  # a wheel that jerks free or spins up on a clod is over sooner
# Longest time for which one sample counts. Encoders may be slower than the ticks: a sample covers
# the time since the last one, yet two alone are not a fault.
MOST_OF_ONE_S = LASTING_S / 2.0
TOLERANCE_RADPS, TOLERANCE_RATIO = 0.6, 0.3
STANDS_RATIO = 0.15
# A skidding robot turns by up to 1.5 of what its wheels say, and a little where one side slips. In
# tight turns on rough soil it turns by far less: soil moves the centres about which the tyres turn
# (Mandow et al. 2007), so that an effective separation of four tracks is no fault of the gyro.
YAW_TOLERANCE_RADPS, YAW_LOW_RATIO, YAW_HIGH_RATIO = 0.24, 0.2, 0.5
TIGHT_RADPS, TIGHT_RATIO = 0.4, 0.85
# A gyro that shows this little of a turn is believed where a receiver shows that the robot is held.
# A clod is climbed in a second or two, and meanwhile the robot may swing the other way; after that
# it is stuck. A biased gyro shows the same on a robot that drives on, which steers against it.
HELD_RADPS, HELD_RATIO = 0.25, 0.75
YAW_LASTING_S, HELD_LASTING_S = 0.6, 2.5
FROZEN_S = 0.5
TURNING_RADPS = 0.6
# A motor without current gives no torque at all: its wheel rolls along and its encoder looks well.
# One that the others carry along for a moment passes through zero, but does not stay there.
DEAD_RATIO, WORKING_RATIO, DEAD_LASTING_S = 1e-6, 2e-3, 0.5
WHEELS: tuple[Wheel, ...] = ("right_wheel_R", "left_wheel_R", "right_wheel_F", "left_wheel_F")


class _CommandedSpeeds(NamedTuple):
    """Wheel speeds that the board drives at a time."""

    t_s: float
    right_radps: float
    left_radps: float


class Found(NamedTuple):
    """The fault, or None.

    `wheels` turn without a command; `runaway` are wheels that should stand but are driven by their
    motors: faster than by a push, on after the drive ended, or when STOP was pressed. A dead motor,
    a frozen IMU and a wrong turn matter to odometry and gyro, not to a person who drives by hand.
    `held` is a robot that does not turn with its wheels.
    """

    wheels: Fact | None = None
    runaway: Fact | None = None
    dead_motor: Fact | None = None
    frozen_imu: Fact | None = None
    wrong_turn: Fact | None = None
    held: Fact | None = None


class WheelWatch:
    """One call a tick, with what was sent in the tick before.

    `fastest_radps` is then how fast the fastest wheel turns, either way round; None where no
    encoder was read.
    """

    fastest_radps: float | None = None

    def __init__(self, drive: DriveSpec, delay_s: float) -> None:
        """`delay_s` is that of command and encoder together which is no fault."""
        self._drive, self._delay_s = drive, delay_s
        self._max_radps = 3.0 * drive.max_speed_mps / drive.wheel_radius_m
        self._v_mps = self._yaw_rate_radps = 0.0
        self._commanded: deque[_CommandedSpeeds] = deque()
        self._read: deque[WheelSample] = deque()
        self._off_s = [0.0] * 4
        self._is_driven = [False] * 4  # whether its motor has driven a wheel since it last stood
        self._rest, self._roll_out = RestWatch(drive), RollOut()
        self._runaway: Fact | None = None
        self._dead_s = [0.0] * 4
        self._yaw_off_s = self._held_s = 0.0
        self._unjudged_s = 0.0  # since the last tick that brought a wheel sample
        self._gyro_radps: deque[tuple[float, float]] = deque()
        self._imu: tuple[float, ...] = ()
        self._imu_changed_s = -math.inf

    def restart(self) -> None:
        """Judge turns anew: the robot goes another way."""
        self._yaw_off_s = self._held_s = 0.0

    def watch(
        self,
        sent: DriveCommand,
        batch: SensorBatch,
        dt_s: float,
        *,
        is_held: bool = False,
        is_stop_pressed: bool = False,
        has_power: bool = True,
    ) -> Found:
        """Judge one tick.

        `is_held`: a receiver shows that the robot gets on less than its wheels. `is_stop_pressed`:
        a STOP was requested in this tick; wheels that turn do not count as pushed any more.
        Motors without power (`has_power`) cannot brake: their wheels may roll out.
        """
        if is_stop_pressed:
            self._is_driven = [
                driven or off_s > 0.0
                for driven, off_s in zip(self._is_driven, self._off_s, strict=True)
            ]
        self._follow_board(sent, batch.t_s, dt_s)
        self._read.extend(batch.wheels)
        self._update_imu(batch)
        self._unjudged_s = min(self._unjudged_s + dt_s, MOST_OF_ONE_S)
        self.fastest_radps = None
        if not batch.wheels:
            return Found(runaway=self._runaway)
        elapsed_s, self._unjudged_s = self._unjudged_s, 0.0
        speeds = self._measure()
        if speeds is None:
            return Found()
        self.fastest_radps = max(abs(speed) for speed in speeds)
        self._roll_out.follow(speeds, self._off_s, elapsed_s, has_power=has_power)
        self._count_wrong_wheels(speeds, elapsed_s)
        is_lasting = max(self._off_s) > LASTING_S
        runs_away = self._runs_away(speeds, batch.wheels[-1].effort_nm, elapsed_s)
        wrong = self._describe_wrong_wheels(speeds) if is_lasting or runs_away else None
        self._runaway = wrong if runs_away else None
        wrong_turn, held = self._compare_turns(speeds, elapsed_s, is_held=is_held)
        return Found(
            wheels=wrong if is_lasting else None,
            runaway=self._runaway,
            dead_motor=self._dead_motor(batch.wheels[-1], elapsed_s),
            frozen_imu=self._frozen_imu(speeds, batch),
            wrong_turn=wrong_turn,
            held=held,
        )

    def _follow_board(self, sent: DriveCommand, t_s: float, dt_s: float) -> None:
        drive, commanded = self._drive, self._commanded
        self._v_mps = _toward(self._v_mps, sent.v_mps, drive.max_accel_mps2 * dt_s)
        self._yaw_rate_radps = _toward(
            self._yaw_rate_radps, sent.yaw_rate_radps, drive.max_yaw_accel_radps2 * dt_s
        )
        for v_mps, yaw_rate_radps in (
            (sent.v_mps, sent.yaw_rate_radps),  # a board without ramps is there at once
            (self._v_mps, self._yaw_rate_radps),
        ):
            left, right = drive.wheel_speeds_radps(v_mps, yaw_rate_radps)
            commanded.append(_CommandedSpeeds(t_s, right, left))
        while len(commanded) > 2 and not 0.0 <= t_s - commanded[0].t_s <= self._delay_s:
            commanded.popleft()

    def _measure(self) -> Four | None:
        """Mean speed of each wheel over the last 0.1 s; None before the first."""
        read = self._read
        while len(read) > 2 and not 0.0 < read[-1].t_s - read[1].t_s <= SPAN_S:
            read.popleft()
        first, last = read[0], read[-1]
        span_s = last.t_s - first.t_s
        if not 0.0 < span_s < 5.0 * SPAN_S:
            if len(read) > 1:
                read.popleft()
            return None
        a, b, c, d = (
            (after - before) / span_s
            for before, after in zip(first.angle_rad, last.angle_rad, strict=True)
        )
        top = self._max_radps
        if not (abs(a) < top and abs(b) < top and abs(c) < top and abs(d) < top):
            return last.speed_radps  # the encoder began to count anew
        return a, b, c, d

    def _count_wrong_wheels(self, speeds: Four, elapsed_s: float) -> None:
        rights = [commanded.right_radps for commanded in self._commanded]
        lefts = [commanded.left_radps for commanded in self._commanded]
        bounds = ((min(rights), max(rights)), (min(lefts), max(lefts)))
        for k, speed in enumerate(speeds):
            low, high = bounds[k % 2]
            is_commanded, rolls_radps = low != 0.0 or high != 0.0, self._roll_out.speeds_radps[k]
            if rolls_radps:
                low, high = min(low, rolls_radps, 0.0), max(high, rolls_radps, 0.0)
            tolerance = TOLERANCE_RADPS + TOLERANCE_RATIO * max(abs(low), abs(high))
            is_off = not low - tolerance <= speed <= high + tolerance
            self._off_s[k] = self._off_s[k] + elapsed_s if is_off else 0.0
            self._is_driven[k] = is_commanded or (self._is_driven[k] and is_off)

    def _describe_wrong_wheels(self, speeds: Four) -> WheelsWrong | WheelsSwapped:
        now = self._commanded[-1]
        off = tuple(k for k in range(4) if self._off_s[k] > 0.0)
        return _describe(off, speeds, (now.right_radps, now.left_radps))

    def _runs_away(self, speeds: Four, efforts_nm: Four | None, elapsed_s: float) -> bool:
        """Whether wheels that are to stand never came to stand, or are driven out of rest."""
        if any(commanded.right_radps or commanded.left_radps for commanded in self._commanded):
            self._rest.restart()
            return False
        runs_on = any(
            is_driven and off_s > LASTING_S
            for is_driven, off_s in zip(self._is_driven, self._off_s, strict=True)
        )
        return self._rest.is_driven(speeds, efforts_nm, elapsed_s) or runs_on

    def _dead_motor(self, read: WheelSample, elapsed_s: float) -> MotorDead | None:
        """Only boards that report the torque of each wheel show it."""
        efforts, torque_nm = read.effort_nm, self._drive.wheel_torque_nm
        commanded = self._commanded[-1]
        if (
            efforts is None
            or abs(commanded.right_radps + commanded.left_radps) / 2.0 < TURNING_RADPS
        ):
            self._dead_s = [0.0] * 4
            return None
        total_nm = sum(abs(effort) for effort in efforts)
        for k, effort in enumerate(efforts):
            if abs(effort) > DEAD_RATIO * torque_nm:
                self._dead_s[k] = 0.0
            elif total_nm > 3.0 * WORKING_RATIO * torque_nm:
                self._dead_s[k] += elapsed_s
            if self._dead_s[k] > DEAD_LASTING_S:
                return MotorDead(WHEELS[k])
        return None

    def _update_imu(self, batch: SensorBatch) -> None:
        for sample in batch.imu:
            self._gyro_radps.append((sample.t_s, sample.gyro_radps[2]))
            value = (*sample.gyro_radps, *(sample.accel_mps2 or ()))
            if value != self._imu:
                self._imu, self._imu_changed_s = value, sample.t_s

    def _frozen_imu(self, speeds: Four, batch: SensorBatch) -> ImuFrozen | None:
        if not batch.imu or min(abs(speed) for speed in speeds) < TURNING_RADPS:
            self._imu_changed_s = max(self._imu_changed_s, batch.t_s - SPAN_S)
            return None
        same_s = batch.imu[-1].t_s - self._imu_changed_s
        return ImuFrozen(same_s) if same_s > FROZEN_S else None

    def _compare_turns(
        self, speeds: Four, elapsed_s: float, *, is_held: bool
    ) -> tuple[TurnsDisagree | None, HeldInTurn | None]:
        """Find that the gyro contradicts the wheels, and that the ground holds the robot."""
        gyro = self._gyro_radps
        while gyro and not 0.0 <= self._read[-1].t_s - gyro[0][0] <= SPAN_S:
            gyro.popleft()
        if not gyro:
            self._yaw_off_s = self._held_s = 0.0
            return None, None
        rate_radps = sum(rate for _, rate in gyro) / len(gyro)
        drive = self._drive
        across_radps = (speeds[0] + speeds[2] - speeds[1] - speeds[3]) / 2.0
        wheels_radps = across_radps * drive.wheel_radius_m / drive.effective_separation_m
        is_off = abs(rate_radps - wheels_radps) > _tolerate_yaw(wheels_radps, rate_radps)
        if not any(self._off_s):  # else it may be a wheel's fault, reported by name
            is_held = is_held and _turns_little(wheels_radps, rate_radps)
            self._count_off(is_off, is_held, elapsed_s)
        rates = rate_radps, wheels_radps
        return (
            TurnsDisagree(*rates) if self._yaw_off_s > YAW_LASTING_S else None,
            HeldInTurn(*rates) if self._held_s > HELD_LASTING_S else None,
        )

    def _count_off(self, is_off: bool, is_held: bool, elapsed_s: float) -> None:
        if not is_off:
            self._yaw_off_s = self._held_s = 0.0
        elif is_held:
            self._held_s += elapsed_s
        else:
            self._yaw_off_s += elapsed_s


def _describe(
    off: tuple[int, ...], speeds: Four, commanded: tuple[float, float]
) -> WheelsWrong | WheelsSwapped:
    """Find which wheels do what instead of what."""
    wanted = sum(commanded[k % 2] for k in off) / len(off)
    speed = sum(speeds[k] for k in off) / len(off)
    right, left = (speeds[0] + speeds[2]) / 2.0, (speeds[1] + speeds[3]) / 2.0
    turn, wanted_turn = right - left, commanded[0] - commanded[1]
    is_swapped = turn * wanted_turn < 0.0 and abs(turn + wanted_turn) < abs(turn) / 2.0
    gets_on = abs(right + left - commanded[0] - commanded[1]) < abs(wanted_turn)
    if len(off) > 1 and is_swapped and gets_on:
        return WheelsSwapped()
    if abs(speed) < STANDS_RATIO * abs(wanted):
        motion: Motion = "stand"
    elif speed * wanted < 0.0:
        motion = "backwards"
    else:
        motion = "fast" if abs(speed) > abs(wanted) else "slow"
    return WheelsWrong(tuple(WHEELS[k] for k in off), motion, speed, wanted)


def _tolerate_yaw(wheels_radps: float, gyro_radps: float) -> float:
    """Return the tolerance of gyro and wheels; larger where the robot turns less than they."""
    commanded_radps = abs(wheels_radps)
    ratio = TIGHT_RATIO if _turns_less(wheels_radps, gyro_radps) else YAW_HIGH_RATIO
    return max(YAW_TOLERANCE_RADPS + YAW_LOW_RATIO * commanded_radps, ratio * commanded_radps)


def _turns_little(wheels_radps: float, gyro_radps: float) -> bool:
    """Whether the robot hardly turns at all, though its wheels do."""
    return abs(wheels_radps) > HELD_RADPS and abs(gyro_radps) < HELD_RATIO * abs(wheels_radps)


def _turns_less(wheels_radps: float, gyro_radps: float) -> bool:
    """Whether the robot turns less than its wheels say, in a tight turn."""
    return abs(wheels_radps) > TIGHT_RADPS and wheels_radps * (wheels_radps - gyro_radps) > 0.0


def _toward(value: float, target: float, step: float) -> float:
    return value + clamp(target - value, -step, step)
