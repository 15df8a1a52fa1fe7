"""The figure that a calibration drives: straight legs, turns on the spot, arcs, and rests."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import msgspec

from agribot.app.calibration.drive_fit import DriveFit
from agribot.app.calibration.drive_log import DriveLog, Stretch
from agribot.core.errors import PlatformError
from agribot.core.messages import DriveCommand, RobotCommand, Scene, SensorBatch
from agribot.core.platform import Platform
from agribot.core.robot import DriveSpec

REST_S = 3.0
LEG_M, LEG_MPS = 4.0, 0.4
SPIN_RAD, SPIN_RADPS = 2.0 * math.tau, 0.8
ARC_RAD, ARC_MPS, ARC_RADPS = math.tau, 0.3, 0.4
# A motion that takes longer than commanded by this factor has failed; with the geometry of the
# original's plugin it is 1.9.
PATIENCE = 4.0


class FigureMotion(NamedTuple):
    """A command and how far it is held: metres by the wheels, or radians by the gyro."""

    name: str
    v_mps: float
    yaw_rate_radps: float
    travel: float

    @property
    def is_leg(self) -> bool:
        return self.yaw_rate_radps == 0.0

    @property
    def duration_s(self) -> float:
        """Duration at the commanded rate."""
        return self.travel / abs(self.v_mps if self.is_leg else self.yaw_rate_radps)


# Twice around to both sides, between legs that show the heading by GNSS.
TURNS = (
    FigureMotion("leg 1, ahead", LEG_MPS, 0.0, LEG_M),
    FigureMotion("spin left", 0.0, SPIN_RADPS, SPIN_RAD),
    FigureMotion("spin right", 0.0, -SPIN_RADPS, SPIN_RAD),
    FigureMotion("leg 2, back", -LEG_MPS, 0.0, LEG_M),
)
# Turns to both sides cancel; a leg after each of them sees its angle by GNSS.
FIGURE = (
    FigureMotion("leg 1, ahead", LEG_MPS, 0.0, LEG_M),
    FigureMotion("spin left", 0.0, SPIN_RADPS, SPIN_RAD),
    FigureMotion("leg 2, back", -LEG_MPS, 0.0, LEG_M),
    FigureMotion("spin right", 0.0, -SPIN_RADPS, SPIN_RAD),
    FigureMotion("leg 3, ahead", LEG_MPS, 0.0, LEG_M),
    FigureMotion("arc left", ARC_MPS, ARC_RADPS, ARC_RAD),
    FigureMotion("leg 4, back", -LEG_MPS, 0.0, LEG_M),
    FigureMotion("arc right", ARC_MPS, -ARC_RADPS, ARC_RAD),
    FigureMotion("leg 5, ahead", LEG_MPS, 0.0, LEG_M),
)
# Ahead and back over little ground, or jacked up: the wheels themselves measure it.
TEST_RUN = (
    FigureMotion("wheels ahead", 0.25, 0.0, 1.0),
    FigureMotion("wheels back", -0.25, 0.0, 1.0),
)


# Motions along a crop row and back to where they began.
ALONG_ROW = (
    FigureMotion("along the row", LEG_MPS, 0.0, 8.0),
    FigureMotion("back", -LEG_MPS, 0.0, 8.0),
)


# The same with the nose swung to both sides: plants that cross the picture show a roll. What the
# swings overshoot cancels, as every other one begins to the other side.
def _make_swing(first: str, second: str, yaw_rate_radps: float) -> tuple[FigureMotion, ...]:
    return (
        FigureMotion("along the row", LEG_MPS, 0.0, 1.3),
        FigureMotion(f"swing {first}", ARC_MPS, yaw_rate_radps, 0.3),
        FigureMotion(f"swing {second}", ARC_MPS, -yaw_rate_radps, 0.6),
        FigureMotion("swing back", ARC_MPS, yaw_rate_radps, 0.3),
    )


_SWINGS = (*_make_swing("left", "right", ARC_RADPS), *_make_swing("right", "left", -ARC_RADPS))
_BACK = FigureMotion("back", -LEG_MPS, 0.0, 8.7)
# Twice, as few plants of a dense row are seen whole and alone.
SWINGING = (*_SWINGS, *_SWINGS, _BACK, *_SWINGS, *_SWINGS, _BACK)


class DriveSamples(NamedTuple):
    """The samples of a drive; `scenes` are those of the camera, where somebody adds them."""

    batches: list[SensorBatch]
    stretches: list[Stretch]
    scenes: list[Scene]


class Gain(msgspec.Struct, frozen=True, kw_only=True):
    """Speed and yaw rate that were reached, relative to the command."""

    speed: float
    yaw_rate: float


Tape = Callable[[], tuple[float, float]]


class FigureDrive:
    """A figure as one command for every batch of the sensors; it does no input or output.

    `tape` gives the measured place at the legs' ends, where there is one.
    """

    def __init__(
        self, drive: DriveSpec, figure: Sequence[FigureMotion] = FIGURE, tape: Tape | None = None
    ) -> None:
        self.driven = DriveSamples([], [], [])
        self.motion: FigureMotion | None = None
        self.travelled = 0.0  # progress of the motion, in its unit
        self._drive, self._figure, self._tape = drive, figure, tape
        self._commands = self._run()

    def step(self, batch: SensorBatch) -> DriveCommand | None:
        """Return the command for now; None when the figure is over.

        Raises: PlatformError: a motion does not come to its end.
        """
        self.driven.batches.append(batch)
        return next(self._commands, None)

    @property
    def share(self) -> float:
        """Share done, 0 to 1, by the time that the motions take."""
        done = sum(motion.duration_s for motion in self._figure[: len(self.driven.stretches)])
        now_s = 0.0
        if self.motion is not None:
            now_s = self.motion.duration_s * min(self.travelled / self.motion.travel, 1.0)
        return (done + now_s) / sum(motion.duration_s for motion in self._figure)

    @property
    def _now_s(self) -> float:
        return self.driven.batches[-1].t_s

    def _run(self) -> Iterator[DriveCommand]:
        tape = self._tape
        yield from self._hold(REST_S)
        for motion in self._figure:
            from_m = tape() if tape else (0.0, 0.0)
            start_s = self._now_s
            yield from self._move(motion)
            end_s = self._now_s
            yield from self._hold(REST_S)
            to_m = tape() if tape else (0.0, 0.0)
            self.driven.stretches.append(
                Stretch(
                    name=motion.name,
                    start_s=start_s,
                    end_s=end_s,
                    is_leg=motion.is_leg,
                    distance_m=math.dist(from_m, to_m) if tape and motion.is_leg else None,
                )
            )
            self.motion = None

    def _hold(self, seconds: float) -> Iterator[DriveCommand]:
        end_s = self._now_s + seconds
        while self._now_s < end_s:
            yield DriveCommand()

    def _move(self, motion: FigureMotion) -> Iterator[DriveCommand]:
        self.motion, self.travelled = motion, 0.0
        command = DriveCommand(v_mps=motion.v_mps, yaw_rate_radps=motion.yaw_rate_radps)
        limit_s, last_s = self._now_s + PATIENCE * motion.duration_s, self._now_s
        while self.travelled < motion.travel:
            yield command
            batch = self.driven.batches[-1]
            dt_s, last_s = batch.t_s - last_s, batch.t_s
            if motion.is_leg and batch.wheels:
                mean_radps = sum(batch.wheels[-1].speed_radps) / 4.0
                self.travelled += abs(mean_radps) * self._drive.wheel_radius_m * dt_s
            elif batch.imu:
                mean_radps = sum(sample.gyro_radps[2] for sample in batch.imu) / len(batch.imu)
                self.travelled += abs(mean_radps) * dt_s
            if batch.t_s > limit_s:
                raise PlatformError(
                    f"'{motion.name}' got to {self.travelled:.2f} of {motion.travel:.2f} "
                    f"{'m' if motion.is_leg else 'rad'} in {PATIENCE:g} times the time it needs; "
                    "check motors, encoders and gyro, and that nothing stands in the way"
                )


def drive_figure(
    platform: Platform,
    drive: DriveSpec,
    tape: Tape | None = None,
    figure: Sequence[FigureMotion] = FIGURE,
) -> DriveSamples:
    """Drive a figure on a platform that nothing else drives.

    Raises: PlatformError: a motion does not come to its end.
    """
    figure_drive = FigureDrive(drive, figure, tape)
    batch = platform.read()
    try:
        while (command := figure_drive.step(batch)) is not None:
            platform.write(RobotCommand(t_s=batch.t_s, drive=command))
            batch = platform.read()
    finally:
        platform.write(RobotCommand(t_s=batch.t_s))
    return figure_drive.driven


def measure_gain(driven: DriveSamples, fit: DriveFit) -> Gain:
    """Average over the middle half of each leg and turn, by the fitted geometry and gyro."""
    log = DriveLog(driven.batches, driven.stretches)
    speeds, rates = [], []
    for motion, stretch in zip(FIGURE, driven.stretches, strict=True):
        quarter_s = (stretch.end_s - stretch.start_s) / 4.0
        between = stretch.start_s + quarter_s, stretch.end_s - quarter_s
        if motion.is_leg:
            rolled_m = fit.wheel_radius_m * log.rolled_rad(*between)[0]
            speeds.append(rolled_m / (motion.v_mps * 2.0 * quarter_s))
        else:
            turned_rad = fit.gyro_scale * log.turned_rad(*between)
            rates.append(turned_rad / (motion.yaw_rate_radps * 2.0 * quarter_s))
    return Gain(speed=sum(speeds) / len(speeds), yaw_rate=sum(rates) / len(rates))
