"""A sensor that corrects the pose, and the one ladder that the samples of all of them climb.

A sensor is one `Correction`: it says what a sample measures less what the state expects, and how
that follows from the state. The ladder refuses samples that are not usable, late or without
odometry; `PoseFilter.correct` keeps outliers out and opens the filter up when a run of them says
that the pose is wrong. What is refused is counted. `corrections.CORRECTIONS` lists the sensors.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from typing import ClassVar, Generic, Protocol, TypeVar

from agribot.autonomy.estimate.filter.gate import Verdict
from agribot.autonomy.estimate.filter.history import UNMOVED, Epoch
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.sensors.first_heading import Known
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.core.messages import SensorBatch


class Timed(Protocol):
    """Anything with a capture time on the platform clock."""

    @property
    def t_s(self) -> float: ...


Sample = TypeVar("Sample", bound=Timed)

# A sensor yields one measurement after the other, and receives the verdict on each.
Measurements = Generator[Measurement, Verdict, None]


class Correction(ABC, Generic[Sample]):
    """A sensor that corrects the pose."""

    # Measurement that must come before the sensor can serve.
    needs: ClassVar[Known | None] = "position"
    needs_odometry: ClassVar[bool] = True

    def __init__(self, pose: PoseFilter) -> None:
        self.pose = pose

    @abstractmethod
    def measure(self, sample: Sample, epoch: Epoch) -> Measurements:
        """Yield what a sample measures; the state has moved on when the next one is asked for."""

    def samples(self, batch: SensorBatch) -> Sequence[Sample]:
        """Give the sensor's part of a batch; none where others call the ladder."""
        return ()

    def is_usable(self, sample: Sample) -> bool:
        """Return whether the sample's numbers are valid."""
        return True

    def objection(self, sample: Sample) -> str:
        """Say why a sample in order is not believed, as it is counted; empty where it is."""
        return ""

    def ageing(self, dt_s: float, turn_abs_rad: float) -> Sequence[tuple[int, float, float]]:
        """Say how the sensor's own error states age, as Ekf.relax takes it."""
        return ()


class Ladder(Generic[Sample]):
    """Takes the samples of one sensor up to the filter, or counts where each fell off."""

    def __init__(self, name: str, correction: Correction[Sample]) -> None:
        self.correction = correction
        self._name = name
        self._pose = correction.pose
        self._last_t_s = -math.inf

    def update_all(self, batch: SensorBatch) -> None:
        for sample in self.correction.samples(batch):
            self.update(sample)

    def update(self, sample: Sample) -> None:
        """Correct the pose by a sample, if it may; samples before the sensor can serve are lost."""
        needs = self.correction.needs
        if needs is not None and needs not in self._pose.known:
            return
        epoch = self._pose.history.epoch(sample.t_s) if self.correction.needs_odometry else _STILL
        refusal = self._refusal(sample, epoch)
        if refusal or epoch is None:
            self._pose.rejected[f"{self._name} {refusal}"] += 1
            return
        epoch = epoch._replace(since_last_s=sample.t_s - self._last_t_s)
        self._last_t_s = sample.t_s
        self._climb(self.correction.measure(sample, epoch))

    def _refusal(self, sample: Sample, epoch: Epoch | None) -> str:
        if not math.isfinite(sample.t_s) or not self.correction.is_usable(sample):
            return "not usable"
        if sample.t_s <= self._last_t_s:
            return "out of order"
        return "without odometry" if epoch is None else self.correction.objection(sample)

    def _climb(self, measurements: Measurements) -> None:
        try:
            measured = next(measurements)
            while True:
                measured = measurements.send(self._pose.correct(measured))
        except StopIteration:
            return


_STILL = Epoch(UNMOVED, UNMOVED)
