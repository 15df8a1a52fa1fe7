"""Where the GNSS antenna sits, from turns on the spot and the straight legs between them.

While the robot turns in place its antenna draws a circle: p = c + R(turned) a. Its radius and phase
give the lever arm in the map at the start; a straight leg gives the heading there. The fitted arm
starts at the point about which the robot turns; its height cannot be observed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.app.calibration.drive_log import DriveLog, Stretch
from agribot.core.errors import MissionError
from agribot.core.facts import FewTurnFixes, HeadingUnfixed, WheelsStoodIn
from agribot.core.geo import MapFrame, make_datum
from agribot.core.messages import FloatArray
from agribot.core.pose import Pose2

MIN_TURNED_RAD = math.tau
MIN_FIXES = 20
MIN_ROLLED_RAD = 0.5  # least roll of a wheel in a leg
MAX_STD_M = 0.02
MAX_SCATTER_M = 0.05  # largest scatter; more is a wander whose fixes err together


class AntennaFit(msgspec.Struct, frozen=True, kw_only=True):
    """Forward and left of the turning centre, metres, and 1 sigma per axis."""

    x_m: float
    y_m: float
    std_m: float
    scatter_m: float
    fixes: int

    def complaints(self) -> tuple[str, ...]:
        if self.std_m <= MAX_STD_M and self.scatter_m <= MAX_SCATTER_M:
            return ()
        return (
            f"the arm is known to {100 * self.std_m:.1f} cm from fixes that scatter by "
            f"{100 * self.scatter_m:.0f} cm, at most {100 * MAX_STD_M:.0f} and "
            f"{100 * MAX_SCATTER_M:.0f} cm will do; use a receiver with corrections",
        )


def fit_antenna(log: DriveLog, stretches: Sequence[Stretch]) -> AntennaFit:
    """Fit the antenna's place on the body to the circles that it drew.

    Raises: MissionError: no full turn with fixes in it, or no leg that gives the heading.
    """
    start_s = stretches[0].start_s
    features, places = _circles(log, stretches, start_s)
    if len(places) < 2 * MIN_FIXES:
        raise MissionError(FewTurnFixes(len(places) // 2, MIN_FIXES))
    found, *_ = np.linalg.lstsq(features, places, rcond=None)
    freedom = max(len(places) - len(found), 1)
    scatter_m = math.sqrt(float(np.sum((places - features @ found) ** 2)) / freedom)
    cov = np.linalg.inv(features.T @ features) * scatter_m**2
    yaw_rad, yaw_std_rad = _heading(log, stretches, start_s)
    east_m, north_m = float(found[0]), float(found[1])
    x_m, y_m = Pose2(0.0, 0.0, yaw_rad).resolve(east_m, north_m)
    arm_m = math.hypot(east_m, north_m)
    return AntennaFit(
        x_m=x_m,
        y_m=y_m,
        std_m=math.hypot(math.sqrt(float(cov[0, 0])), arm_m * yaw_std_rad),
        scatter_m=scatter_m,
        fixes=len(places) // 2,
    )


def _circles(
    log: DriveLog, stretches: Sequence[Stretch], start_s: float
) -> tuple[FloatArray, FloatArray]:
    """Rows for the arm (2) and a centre of each turn, and the coordinates they explain."""
    turns = [s for s in stretches if not s.is_leg
             and abs(log.turned_rad(s.start_s, s.at_rest_s)) >= MIN_TURNED_RAD]  # fmt: skip
    first = log.fixes[0] if log.fixes else None
    rows, places = [], []
    for number, turn in enumerate(turns):
        for fix in log.fixes:
            if not turn.start_s <= fix.t_s <= turn.end_s or first is None:
                continue
            frame = MapFrame(make_datum(first.lat_deg, first.lon_deg, first.alt_m))
            east_m, north_m, _ = frame.map_from_geodetic(fix.lat_deg, fix.lon_deg, fix.alt_m)
            turned_rad = log.turned_rad(start_s, fix.t_s)
            cos, sin = math.cos(turned_rad), math.sin(turned_rad)
            for arm, axis, place in (((cos, -sin), 0, east_m), ((sin, cos), 1, north_m)):
                row = np.zeros(2 + 2 * len(turns))
                row[:2], row[2 + 2 * number + axis] = arm, 1.0
                rows.append(row)
                places.append(place)
    return np.array(rows), np.array(places)


def _heading(log: DriveLog, stretches: Sequence[Stretch], start_s: float) -> tuple[float, float]:
    """Find the heading at the start from the directions of the legs, and its 1 sigma."""
    total, weight = 0j, 0.0
    for number, stretch in enumerate(stretches):
        moved = log.displacement(number) if stretch.is_leg else None
        if moved is None:
            continue
        (east_m, north_m), std_m = moved
        rolled_rad = log.rolled_rad(stretch.start_s, stretch.at_rest_s)[0]
        if abs(rolled_rad) < MIN_ROLLED_RAD:
            raise MissionError(WheelsStoodIn(stretch.name))
        is_back = rolled_rad < 0.0
        turned_rad = log.turned_rad(start_s, (stretch.start_s + stretch.end_s) / 2.0)
        yaw_rad = math.atan2(north_m, east_m) + math.pi * is_back - turned_rad
        share = (math.hypot(east_m, north_m) / std_m) ** 2
        total += share * complex(math.cos(yaw_rad), math.sin(yaw_rad))
        weight += share
    if weight == 0.0:
        raise MissionError(HeadingUnfixed())
    return math.atan2(total.imag, total.real), 1.0 / math.sqrt(weight)
