"""Where the robot believes to be."""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from agribot.core.facts import AnyFact
from agribot.core.messages.sensors import GnssQuality

SensorState = Literal["fine", "silent", "late", "frozen", "contradicted"]


class SensorVerdict(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Verdict on one sensor, its time and its reason; fine needs none.

    `reason` is the text of `fact`.
    """

    state: SensorState = "fine"
    since_s: float | None = None
    reason: str = ""
    fact: AnyFact | None = None


FINE = SensorVerdict()


# Verdicts by sensor: gnss, compass, gyro, wheels, camera, clock, and those that packages add; one
# that is missing is fine.
SensorVerdicts = dict[str, SensorVerdict]


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """Pose of the body in the map; `pose_cov` is the 3x3 covariance of x, y and yaw by rows.

    `ok` is False until the filter has a position and a heading, and again when inputs go
    silent; `reason` is then the cause, or what is wrong with a sensor that the pose does without.
    `protection_m` bounds the error, faults of GNSS included, `across_protection_m` the error to the
    side of the heading. Of that, `across_plain_m` is from the covariance alone and
    `across_unknown_m` from lack of knowledge, without two solutions that differ. `rows_off_m` is
    how far the field's rows stand East and North of where the map has them. `contradiction` names
    sensors that disagree, between which a person decides, or asks one which row this is:
    `row_certainty` is the probability that it is the one that the pose says. `verdicts` say of
    every sensor whether it is believed. `plants_doubt` is why the tool must not work by what the
    camera calls weed and crop, though the pose is good. `fact`, `contradiction_fact` and
    `plants_fact` are what the program decides by; `reason`, `contradiction` and `plants_doubt` are
    their texts, for recordings and other programs.
    """

    t_s: float
    x_map_m: float
    y_map_m: float
    yaw_map_rad: float
    v_mps: float
    yaw_rate_radps: float
    slip_rad: float
    pose_cov: tuple[float, float, float, float, float, float, float, float, float]
    pos_std_m: float
    yaw_std_rad: float
    quality: GnssQuality
    ok: bool
    reason: str = ""
    protection_m: float = float("inf")
    row_seen: bool | None = None  # crop where the row should be; None: no camera
    across_protection_m: float = float("inf")
    across_plain_m: float = 0.0
    across_unknown_m: float = 0.0
    contradiction: str = ""
    rows_off_m: tuple[float, float] = (0.0, 0.0)
    verdicts: SensorVerdicts = msgspec.field(default_factory=dict)
    row_certainty: float = 1.0
    plants_doubt: str = ""
    fact: AnyFact | None = None
    contradiction_fact: AnyFact | None = None
    plants_fact: AnyFact | None = None

    def relate_to_rows(self) -> Estimate:
        """Return the pose in a map whose rows lie where those of the field stand."""
        return self._relate_to_moved(*self.rows_off_m)

    def relate_to_aside(self, yaw_map_rad: float, left_m: float) -> Estimate:
        """Return the pose in a map in which a line in this direction lies `left_m` to its left."""
        return self._relate_to_moved(
            -math.sin(yaw_map_rad) * left_m, math.cos(yaw_map_rad) * left_m
        )

    def _relate_to_moved(self, east_m: float, north_m: float) -> Estimate:
        if not east_m and not north_m:
            return self
        return msgspec.structs.replace(
            self, x_map_m=self.x_map_m - east_m, y_map_m=self.y_map_m - north_m
        )
