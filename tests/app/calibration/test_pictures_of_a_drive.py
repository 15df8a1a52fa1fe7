"""What the camera shows on a drive along a row: its own mount, and whether rows are seen right.

Plants and lines are drawn where the camera of the machine has them in its picture; the rendered
ones are in tests/autonomy/perceive/test_mount_fit.py.
"""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.app.calibration.measured_robot import apply_calibration
from agribot.app.calibration.wizard import Wizard
from agribot.autonomy.perceive.foliage import HEIGHT_RATIO
from agribot.core import config
from agribot.core.facts import NoResult, NothingSeen
from agribot.core.messages import FloatArray, GroundPlant, PlantClass, RowLine, Scene, TickRecord
from agribot.description.loader import load_robot
from tests import nightly
from tests.app.calibration.test_wizard import SETTINGS, Bench

AREA_M2 = 0.01
LEAVES_M = HEIGHT_RATIO[PlantClass.CROP] * 2.0 * math.sqrt(AREA_M2 / math.pi)
EVERY_S = 0.2
FIELD = ("field.first_row_start_map_m=[0.0,-1.0]", "field.row_yaw_deg=90.0",
         "field.row_length_m=14.0", "field.row_count=3")  # fmt: skip
# Against the description: 0.03 rolled, 0.05 further down, 0.03 to the right, 3 cm higher.
WRONG = ("calibration.camera_rpy_rad=[0.03,0.9227,-0.03]", "calibration.camera_height_m=0.93")


class SeeingBench(Bench):
    """Plants grow along the drive; the wizard gets what the camera sees of them."""

    def __init__(self, folder: Path, *settings: str, line_aside_m: float = 0.0) -> None:
        super().__init__(folder, "record.enabled=false", *FIELD, *settings)
        session, rng = self.session, np.random.default_rng(5)
        self._places_m = np.column_stack([rng.uniform(-0.5, 0.5, 90), rng.uniform(0.0, 12.0, 90)])
        self._real = load_robot().body_from_camera()
        self._believed = session.robot.body_from_camera()
        self._aside_m, self._next_s, self._rng = line_aside_m, 0.0, rng
        elsewhere = ("field.start_map_m=[-9.0,5.0]", "field.start_yaw_deg=0.0")  # long ago
        words = [*SETTINGS, *FIELD, *settings, *elsewhere, "perception.enabled=true"]
        sees = config.load("farm", words)
        session.stack.taps.remove(self.wizard)
        self.wizard = Wizard(session.inbox, session.robot, sees, self.file)
        session.add_tap(lambda record: self.wizard(self._with_picture(record)))

    def _with_picture(self, record: TickRecord) -> TickRecord:
        t_s = record.batch.t_s
        if t_s < self._next_s:
            return record
        self._next_s = t_s + EVERY_S
        truth = self.session.simulator.truth()
        x_m, y_m, yaw_rad = truth.x_map_m, truth.y_map_m, truth.yaw_map_rad
        scene = Scene(
            t_s=t_s, ready_s=t_s, frame_index=0, view_body_m=(),
            plants=self._plants(x_m, y_m, yaw_rad),
            row_line=RowLine(
                t_s=t_s, offset_m=-x_m + self._aside_m, heading_rad=yaw_rad - math.pi / 2.0,
                offset_std_m=0.012, heading_std_rad=0.02,
            ),
        )  # fmt: skip
        return msgspec.structs.replace(record, scenes=(scene,))

    def _plants(self, x_m: float, y_m: float, yaw_rad: float) -> tuple[GroundPlant, ...]:
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        dx, dy = (self._places_m - [x_m, y_m]).T
        body: FloatArray = np.column_stack(
            [cos * dx + sin * dy, cos * dy - sin * dx, np.full(len(dx), LEAVES_M)]
        )
        body = body[(body[:, 0] > 0.5) & (body[:, 0] < 1.8)]
        rays = (body - self._real[:3, 3]) @ self._real[:3, :3] @ self._believed[:3, :3].T
        reach = (LEAVES_M - self._believed[2, 3]) / rays[:, 2]
        seen = self._believed[:2, 3] + reach[:, None] * rays[:, :2]
        seen += self._rng.normal(0.0, 0.005, seen.shape)
        return tuple(
            GroundPlant(
                x_body_m=x, y_body_m=y, plant=PlantClass.CROP, area_m2=AREA_M2, confidence=1.0,
                std_m=0.01,
            )
            for x, y in seen.tolist()
        )  # fmt: skip


@nightly.by_day(
    "test_rows_that_are_seen_beside_their_place_are_named",
    "tests/autonomy/perceive/test_mount_fit.py::test_without_noise_the_mount_is_found_exactly",
    "tests/autonomy/perceive/test_mount_fit.py::test_over_seeds_it_errs_no_more_than_it_says",
    "tests/app/calibration/test_robot_file.py::test_a_run_believes_the_file_and_an_option_more",
)
def test_a_wrong_mount_is_found_and_the_next_run_believes_the_right_one(tmp_path: Path) -> None:
    bench = SeeingBench(tmp_path, *WRONG)
    with bench.session:
        found = bench.drive_to_the_end("camera")["found"]
        assert found["ok"], found["reasons"]
        assert bench.do("accept")["refusal"] is None
    seems = next(c for c in found["changes"] if c["label"] == "Plants seem to move by")
    assert seems["after"] < 0.5 * seems["before"]
    next_run = config.load("farm", [*SETTINGS, *WRONG, *bench.file.settings()])
    believed, real = apply_calibration(load_robot(), next_run.calibration), load_robot()
    turned = believed.body_from_camera()[:3, :3].T @ real.body_from_camera()[:3, :3]
    off_rad = math.acos(min(1.0, (float(np.trace(turned)) - 1.0) / 2.0))
    assert math.degrees(off_rad) < 1.0  # it was off by 3.7
    assert believed.body_from_camera()[2, 3] == pytest.approx(0.9008, abs=0.015)


@pytest.mark.parametrize(
    "aside_m",
    [
        pytest.param(
            0.0, marks=nightly.by_day("test_rows_that_are_seen_beside_their_place_are_named")
        ),
        0.06,
    ],
)
def test_rows_that_are_seen_beside_their_place_are_named(tmp_path: Path, aside_m: float) -> None:
    bench = SeeingBench(tmp_path, line_aside_m=aside_m)
    with bench.session:
        found = bench.drive_to_the_end("row-view")["found"]
        assert bench.do("accept")["refusal"] == NoResult()  # nothing to take over
    assert found["changes"][0]["after"] == pytest.approx(aside_m, abs=0.015)
    assert found["ok"] is (aside_m == 0.0)
    assert ["aside" in reason for reason in found["reasons"]] == [True] * (aside_m > 0.0)


def test_without_perception_the_robot_does_not_set_off(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    with bench.session:
        bench.stand_ready()
        assert bench.do("start", "camera")["refusal"] == NothingSeen()
        assert bench.phase() == "idle"
