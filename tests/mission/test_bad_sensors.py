"""Sensors that lie in a row: the robot stops and says why, or goes on; no crop dies."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from unittest.mock import ANY

import msgspec
import pytest

from agribot.app.simulated_run import simulate
from agribot.core.config import load
from agribot.core.facts import (
    ClockWentBack,
    Fact,
    FixesRejected,
    GnssCrept,
    GnssJumped,
    GnssRepeats,
    GnssSilent,
)
from agribot.core.messages import GnssFix, SensorBatch, TickRecord
from agribot.record.events import read_events
from agribot.record.report import Report
from tests import nightly
from tests.finding import SHOWN, holds, is_like, list_codes

FROM_S = 25.0
QUICK = ["perception.enabled=false", "record.enabled=false", "field.start_map_m=[-2,0]",
         "duration_s=40"]  # fmt: skip
Spoil = Callable[[SensorBatch], SensorBatch]


def driven(out: Path, spoil: Spoil, *more: str) -> tuple[Report, list[TickRecord]]:
    """The farm's first rows, with every batch spoilt after `FROM_S`."""
    records = []
    with simulate(load("farm", [*QUICK, *more]), out) as session:
        read = session.platform.read

        def lied() -> SensorBatch:
            batch = read()
            return spoil(batch) if batch.t_s > FROM_S else batch

        session.platform.read = lied  # type: ignore[method-assign]
        for record in session.ticks():
            records.append(record)
        return session.finish(), records


def moved(fix: GnssFix, north_m: float) -> GnssFix:
    return msgspec.structs.replace(fix, lat_deg=fix.lat_deg + north_m / 110719.0)


def east(fix: GnssFix, east_m: float) -> GnssFix:
    return msgspec.structs.replace(fix, lon_deg=fix.lon_deg + east_m / 103858.0)


def is_told(records: list[TickRecord], wanted: Fact | type[Fact], within: float = SHOWN) -> bool:
    """Whether the estimate, the gate or the mission found it after `FROM_S`."""
    facts = (
        fact
        for record in records[int(FROM_S / 0.02) :]
        for fact in (record.estimate.fact, record.fact, record.status.fact)
    )
    return any(holds(fact, wanted, within=within) for fact in facts)


@pytest.mark.parametrize(
    "sensors",
    [
        "rtk",
        pytest.param(
            "m8n",
            marks=nightly.by_day("test_a_receiver_that_jumps_100_m_is_told_and_crushes_nothing"),
        ),
    ],
)
def test_a_receiver_that_jumps_100_m_is_told_and_crushes_nothing(
    tmp_path: Path, sensors: str
) -> None:
    def jump(batch: SensorBatch) -> SensorBatch:
        return msgspec.structs.replace(batch, gnss=tuple(moved(fix, 100.0) for fix in batch.gnss))

    report, records = driven(tmp_path, jump, f'sim.sensors="{sensors}"')
    assert report.tracking.plants_crushed == 0
    assert is_told(records, FixesRejected)
    last = records[-1]
    if sensors == "rtk":
        assert last.status.state == "paused"
        assert is_like(last.status.fact, GnssJumped(99.55), within=0.55)
        assert last.command.drive.v_mps == 0.0


@pytest.mark.parametrize(
    "size_m",
    [
        0.15,
        pytest.param(
            0.4,
            marks=nightly.by_day(
                "test_a_small_jump_of_fixed_rtk_halts_on_the_row_and_says_by_how_much"
            ),
        ),
    ],
)
def test_a_small_jump_of_fixed_rtk_halts_on_the_row_and_says_by_how_much(
    tmp_path: Path, size_m: float
) -> None:
    def jump(batch: SensorBatch) -> SensorBatch:
        return msgspec.structs.replace(batch, gnss=tuple(east(fix, size_m) for fix in batch.gnss))

    report, records = driven(tmp_path, jump, 'sim.sensors="rtk"', "duration_s=32")
    assert report.tracking.plants_crushed == 0
    assert report.tracking.xte_max_m is not None
    assert report.tracking.xte_max_m < 0.1
    assert records[-1].status.state == "paused"
    assert is_like(records[-1].status.fact, GnssJumped(0.5), within=0.5)
    assert records[-1].command.drive.v_mps == 0.0


@nightly.by_day(
    "tests/autonomy/estimate/test_witnesses.py::"
    "test_fixes_that_creep_off_by_five_centimetres_a_second_are_named_without_a_camera",
    "tests/autonomy/estimate/test_doubts.py::"
    "test_fixes_that_creep_off_the_row_are_stopped_before_a_wheel_reaches_the_crop",
)
def test_a_drift_of_fixed_rtk_without_camera_is_named_and_stopped_before_the_crop(
    tmp_path: Path,
) -> None:
    def drift(batch: SensorBatch) -> SensorBatch:
        fixes = tuple(east(fix, 0.05 * (fix.t_s - FROM_S)) for fix in batch.gnss)
        return msgspec.structs.replace(batch, gnss=fixes)

    report, records = driven(tmp_path, drift, 'sim.sensors="rtk"', "duration_s=40")
    assert report.tracking.plants_crushed == 0
    assert report.tracking.xte_max_m is not None
    assert report.tracking.xte_max_m < 0.3
    assert is_told(records, GnssCrept(0.5, ANY), within=0.5)
    assert next(r.batch.t_s for r in records if r.estimate.contradiction_fact) < FROM_S + 6.0
    assert records[-1].command.drive.v_mps == 0.0


@nightly.by_day(
    "tests/autonomy/estimate/test_doubts.py::"
    "test_a_receiver_that_repeats_its_place_while_the_wheels_turn_is_named_and_not_believed",
    "test_a_receiver_that_jumps_100_m_is_told_and_crushes_nothing",
)
def test_a_receiver_that_freezes_is_named_and_crushes_nothing(tmp_path: Path) -> None:
    last: list[GnssFix] = []

    def freeze(batch: SensorBatch) -> SensorBatch:
        last[:] = last or batch.gnss[-1:]
        frozen = tuple(msgspec.structs.replace(last[0], t_s=fix.t_s) for fix in batch.gnss)
        return msgspec.structs.replace(batch, gnss=frozen)

    report, records = driven(tmp_path, freeze, 'sim.sensors="rtk"')
    assert report.tracking.plants_crushed == 0
    assert is_told(records, GnssRepeats)
    levels_m = [record.estimate.across_protection_m for record in records]
    assert all(level_m > 0.25 for level_m in levels_m[-50:])
    assert max(levels_m[round(15.0 / 0.02) : round(FROM_S / 0.02)]) < 0.28  # the limit is 0.31 m
    faults = (one for one in read_events(tmp_path / "events.jsonl") if one.kind == "fault")
    assert GnssRepeats(0.0).code in list_codes(faults)


@nightly.by_day(
    "tests/autonomy/estimate/test_localizer_faults.py::test_a_clock_that_goes_back_is_reported",
    "tests/autonomy/control/test_protective_stops.py::"
    "test_a_clock_that_jumps_stops_the_robot_until_a_person_clears_it",
)
def test_a_clock_that_goes_back_stops_the_robot(tmp_path: Path) -> None:
    def back(batch: SensorBatch) -> SensorBatch:
        return msgspec.structs.replace(batch, t_s=batch.t_s - 5.0)

    report, records = driven(tmp_path, back, 'sim.sensors="rtk"', "duration_s=32")
    assert report.tracking.plants_crushed == 0
    assert is_told(records, ClockWentBack)
    assert records[-1].command.drive.v_mps == 0.0


@pytest.mark.figures
@nightly.by_day(
    "tests/autonomy/estimate/test_localizer_faults.py::"
    "test_a_fix_that_is_not_finite_is_as_good_as_none",
)
def test_fixes_that_are_no_numbers_are_as_good_as_none(tmp_path: Path) -> None:
    def nan(batch: SensorBatch) -> SensorBatch:
        lost = tuple(msgspec.structs.replace(fix, lat_deg=math.nan) for fix in batch.gnss)
        return msgspec.structs.replace(batch, gnss=lost)

    report, records = driven(tmp_path, nan, 'sim.sensors="rtk"')
    assert report.tracking.plants_crushed == 0
    assert is_told(records, GnssSilent)
