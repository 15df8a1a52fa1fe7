"""A camera that is knocked aside, slides off or is mirrored; the receiver cannot detect it."""

from __future__ import annotations

import math
from collections.abc import Callable
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.core.config import EstimateConfig
from agribot.core.facts import CameraAndGnssDisagree, PictureMirrored, RowLineMoved
from agribot.core.messages import ControlMission, Estimate, RowLine
from tests import nightly
from tests.asking import ask
from tests.autonomy.estimate.noisy_rover import M8N, RTK, Errors, Recording, record
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import batches
from tests.autonomy.estimate.test_doubts import FIELD, north, sight, told
from tests.finding import is_like

FROM_S = 12.0
Spoil = Callable[[float, RowLine], RowLine]


def weaving(t_s: float) -> tuple[float, float]:
    """Snakes by 15 cm to both sides over 6 m of way."""
    return (0.4, 0.066 * math.cos(2.0 * math.pi * (t_s - 3.0) / 15.0)) if t_s > 3.0 else (0.0, 0.0)


def right(seconds: float, line: RowLine) -> RowLine:
    return line


def knocked(off_m: float) -> Spoil:
    return lambda seconds, line: msgspec.structs.replace(
        line, offset_m=(line.offset_m or 0) + off_m
    )


def sliding(mps: float) -> Spoil:
    return lambda seconds, line: knocked(mps * seconds)(seconds, line)


def mirrored(seconds: float, line: RowLine) -> RowLine:
    assert line.offset_m is not None and line.heading_rad is not None
    return msgspec.structs.replace(line, offset_m=-line.offset_m, heading_rad=-line.heading_rad)


def follow(seconds: float, line: RowLine) -> RowLine:
    """The row bends as the robot drives, and its line runs straight below it."""
    rng = np.random.default_rng(int(100 * seconds))
    off_m, turn_rad = rng.normal(0.0, (0.015, math.radians(0.7))).tolist()
    return msgspec.structs.replace(line, offset_m=off_m, heading_rad=turn_rad)


class Drive:
    """A recording with a camera that is spoilt from a time on; the robot starts on its mark."""

    def __init__(
        self, recording: Recording, spoil: Spoil, *, seed: int = 0, resume_s: float = -1.0,
        from_s: float = FROM_S,
    ) -> None:  # fmt: skip
        x_m, y_m, _ = map(float, recording.pose(0.0))
        field = msgspec.structs.replace(FIELD, start_map_m=(x_m, y_m), start_std_m=0.05)
        self.into = Localizer(EstimateConfig(), field, robot((0.0, 0.0, 0.6)))
        self.recording = recording
        self.estimates: list[Estimate] = []
        rng = np.random.default_rng(seed)
        for tick, batch in enumerate(batches(recording)):
            is_time = abs(batch.t_s - resume_s) < 0.01
            events = (ask(ControlMission(action="resume"), "test", t_s=batch.t_s),) * is_time
            self.estimates.append(
                self.into.update(msgspec.structs.replace(batch, requests=events))
            )  # fmt: skip
            if tick % 5 == 0 and batch.t_s > 4.0:
                scene = sight(recording, batch.t_s, 0.0, rng)
                if batch.t_s > from_s and scene.row_line is not None:
                    line = spoil(batch.t_s - from_s, scene.row_line)
                    scene = msgspec.structs.replace(scene, row_line=line)
                if not self.into.is_stale(scene):
                    self.into.observe(scene)

    def off_m(self, estimate: Estimate) -> float:
        return abs(estimate.x_map_m - float(self.recording.pose(estimate.t_s)[0]))

    @property
    def first(self) -> Estimate:
        return next(e for e in self.estimates if e.contradiction_fact)


@pytest.mark.parametrize("errors", [M8N, RTK], ids=["m8n", "rtk"])
@nightly.one_by_one("off_m", [-0.3, 0.15, 0.5], in_suite=1)
def test_a_camera_that_is_knocked_aside_in_a_row_is_named_and_not_followed(
    off_m: float, errors: Errors
) -> None:
    drive = Drive(record(north, 22.0, seed=1, errors=errors), knocked(off_m))
    assert is_like(drive.first.contradiction_fact, RowLineMoved(0.5), within=0.5)
    assert drive.first.verdicts["camera"].state == "contradicted"
    assert "gnss" not in drive.first.verdicts
    assert FROM_S < drive.first.t_s < FROM_S + 1.5
    assert max(drive.off_m(e) for e in drive.estimates if 6.0 < e.t_s < FROM_S + 3.0) < 0.06
    assert drive.first.across_protection_m > abs(off_m)


@nightly.one_by_one("mps", [0.05, -0.1], in_suite=1)
def test_a_camera_that_slides_off_is_named_before_a_wheel_reaches_the_crop(mps: float) -> None:
    drive = Drive(record(north, 24.0, seed=1, errors=M8N), sliding(mps))
    first = drive.first
    assert isinstance(first.contradiction_fact, RowLineMoved)
    assert drive.off_m(first) < 0.25
    assert first.across_protection_m > drive.off_m(first)


def test_with_corrections_a_camera_that_slides_off_slowly_is_found_out_by_the_receiver() -> None:
    drive = Drive(record(north, FROM_S + 22.0, seed=1, errors=RTK), sliding(0.01))
    disagree = CameraAndGnssDisagree(0.15, ANY)
    assert is_like(drive.first.contradiction_fact, disagree, within=0.055)
    assert max(drive.off_m(e) for e in drive.estimates if e.t_s > 6.0) < 0.1


@pytest.mark.parametrize("errors", [M8N, RTK], ids=["m8n", "rtk"])
@nightly.one_by_one("seed", range(3), in_suite=1)
def test_no_camera_that_is_right_is_accused(errors: Errors, seed: int) -> None:
    for motion in (north, weaving):
        drive = Drive(record(motion, 30.0, seed=seed, errors=errors), right, seed=seed)
        assert not told(drive.estimates)
        assert not any("camera" in e.verdicts for e in drive.estimates)


def test_a_row_that_bends_where_the_map_has_it_straight_is_no_fault_of_the_camera() -> None:
    drive = Drive(record(weaving, 40.0, seed=1, errors=M8N), follow, from_s=4.0)
    assert drive.into.rejected["row line moved aside"] == 0
    assert not told(drive.estimates)


def test_whoever_resumes_believes_the_camera_again() -> None:
    def halting(t_s: float) -> tuple[float, float]:
        return (0.4, 0.0) if 3.0 < t_s < 14.0 or t_s > 19.0 else (0.0, 0.0)

    drive = Drive(record(halting, 26.0, seed=1, errors=M8N), knocked(0.2), resume_s=18.0)
    at_17 = next(e for e in drive.estimates if e.t_s > 17.0)
    assert at_17.contradiction_fact and drive.off_m(at_17) < 0.06
    after = [e for e in drive.estimates if e.t_s > 22.0]
    assert not told(after)
    assert all(0.1 < drive.off_m(e) < 0.25 for e in after)


def test_a_mirrored_picture_is_named_by_the_turns_and_used_for_nothing() -> None:
    drive = Drive(record(weaving, 40.0, seed=1, errors=M8N), mirrored)
    named = next(e for e in drive.estimates if isinstance(e.fact, PictureMirrored))
    assert named.verdicts["camera"].state == "contradicted"
    assert named.t_s < FROM_S + 12.0
    assert drive.into.rejected["picture mirrored"] > 50
