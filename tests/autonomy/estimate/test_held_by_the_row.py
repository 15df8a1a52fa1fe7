"""What the camera held the robot to is sure, whatever dead reckoning from before says."""

from __future__ import annotations

import math

from agribot.autonomy.estimate.filter.ekf import YAW, X, Y
from agribot.autonomy.estimate.integrity import Bounds, Integrity
from agribot.autonomy.estimate.sensors.gnss import Gnss
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.core.config import EstimateConfig, FieldConfig
from tests.autonomy.estimate.paper_robot import robot

STD_M = 0.02
STEP_M = 0.02  # of a tick at 0.4 m/s
LOST_M = 0.5  # what wheels lost in a turn, until the camera saw the row


class Drive:
    """A filter that knows its place well, driven along a row to the East, tick by tick."""

    def __init__(self) -> None:
        self.pose = PoseFilter(EstimateConfig(), FieldConfig(), robot())
        self.ekf = self.pose.ekf
        self.ekf.cov[:] = 0.0
        for axis in (X, Y):
            self.ekf.cov[axis, axis] = STD_M**2
        self.ekf.x[YAW] = 0.0
        self.integrity = Integrity(self.pose, Gnss(self.pose))
        self.t_s = 0.0

    def go(self, duration_s: float, *, is_held: bool = False) -> Bounds:
        for _ in range(round(duration_s / 0.05)):
            self.t_s += 0.05
            self.ekf.x[X] += STEP_M * math.cos(self.ekf.x[YAW])
            self.ekf.x[Y] += STEP_M * math.sin(self.ekf.x[YAW])
            self.integrity.move(STEP_M)
            bounds = self.integrity.bound(self.t_s, STD_M, is_ok=True, is_held=is_held)
        return bounds


def test_a_turn_that_cost_the_wheels_half_a_metre_is_past_once_the_camera_held_the_row() -> None:
    drive = Drive()
    assert drive.go(6.0).across_m < 0.15
    drive.ekf.x[Y] += LOST_M
    assert drive.go(0.1).across_m > LOST_M, "which of the two is right is still open"
    assert drive.go(1.0, is_held=True).across_m < 0.15
    assert drive.go(2.5).across_m < 0.2, "the row has decided, and no plant is in sight any more"


def test_what_the_camera_has_not_decided_stays_open_when_the_robot_turns_off() -> None:
    drive = Drive()
    drive.go(6.0)
    drive.ekf.x[X] += LOST_M  # along the row, which its plants do not show
    drive.go(1.0, is_held=True)
    assert drive.go(0.5).across_m < 0.2
    drive.ekf.x[YAW] = math.pi / 2.0
    assert drive.go(0.1).across_m > LOST_M, "what was ahead is now at the side"


def test_a_pose_that_moves_off_after_the_camera_let_go_is_doubted_again() -> None:
    drive = Drive()
    drive.go(6.0)
    drive.ekf.x[Y] += LOST_M
    drive.go(1.0, is_held=True)
    drive.ekf.x[Y] += LOST_M
    assert drive.go(0.1).across_m > LOST_M
