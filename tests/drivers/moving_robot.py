"""A robot on a plane, without forces: it moves as its wheels turn, and what its sensors feel."""

from __future__ import annotations

import datetime as dt
import math

from agribot.core.config import FieldConfig
from agribot.core.geo import MapFrame
from agribot.core.messages import Vec3
from agribot.description.loader import load_robot
from tests.drivers.receiver_bytes import make_ubx_pvt

ROBOT = load_robot()
DRIVE = ROBOT.drive
COUNTS_PER_TURN = DRIVE.encoder_ticks_per_rev * DRIVE.gear_ratio
FIELD_T = 3e-5  # of the Earth, to the North and down


class MovingRobot:
    """`pose` is where it is in the map (x, y, yaw)."""

    def __init__(self, pose: tuple[float, float, float], field: FieldConfig) -> None:
        self.pose = pose
        self._frame = MapFrame(field.datum)
        self._v_mps = self._rate_radps = self._t_s = 0.0

    def roll(self, right_radps: float, left_radps: float, dt_s: float) -> None:
        """Let the wheels of both sides turn so."""
        x_m, y_m, yaw_rad = self.pose
        radius_m = DRIVE.wheel_radius_m
        v_mps = (right_radps + left_radps) / 2.0 * radius_m
        rate = (right_radps - left_radps) * radius_m / DRIVE.effective_separation_m
        yaw_rad += rate * dt_s
        self.pose = (x_m + v_mps * dt_s * math.cos(yaw_rad),
                     y_m + v_mps * dt_s * math.sin(yaw_rad), yaw_rad)  # fmt: skip
        self._v_mps, self._rate_radps, self._t_s = v_mps, rate, self._t_s + dt_s

    @property
    def gyro_radps(self) -> Vec3:
        hum = 1e-3 * math.sin(1e3 * self._t_s)  # no gyro says the same twice
        return hum, 0.0, self._rate_radps

    @property
    def mag_t(self) -> Vec3:
        yaw_rad = self.pose[2]
        return FIELD_T * math.sin(yaw_rad), FIELD_T * math.cos(yaw_rad), -FIELD_T

    def fix(self, at: dt.datetime) -> bytes:
        """Write what a u-blox receiver with fixed ambiguities says of its antenna."""
        x_m, y_m, yaw_rad = self.pose
        ahead_m, left_m, up_m = ROBOT.body_from_link(ROBOT.gnss.link)[:3, 3].tolist()
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        antenna = x_m + c * ahead_m - s * left_m, y_m + s * ahead_m + c * left_m, up_m
        lat_deg, lon_deg, _ = self._frame.geodetic_from_map(*antenna)
        # A turn moves the antenna, too.
        ahead_mps = self._v_mps - self._rate_radps * left_m
        left_mps = self._rate_radps * ahead_m
        velocity = (c * ahead_mps - s * left_mps, s * ahead_mps + c * left_mps, 0.0)
        return make_ubx_pvt(at, lat_deg, lon_deg, carrier=2, h_acc_m=0.02, velocity_mps=velocity)
