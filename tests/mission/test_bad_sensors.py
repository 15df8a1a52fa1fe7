"""Sensors that lie in a row: the robot stops and says why, or goes on; no crop dies."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from agribot.config import load
from agribot.messages import GnssFix, SensorBatch, TickRecord
from agribot.record.report import Report
from agribot.session import Session

FROM_S = 25.0
QUICK = ["perception.enabled=false", "record.enabled=false", "field.start_map_m=[-2,0]",
         "duration_s=60"]  # fmt: skip
Spoil = Callable[[SensorBatch], SensorBatch]


def driven(out: Path, spoil: Spoil, *more: str) -> tuple[Report, list[TickRecord]]:
    """The farm's first rows, with every batch spoilt after `FROM_S`."""
    records = []
    with Session(load("farm", [*QUICK, *more]), out) as session:
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


def reasons(records: list[TickRecord]) -> str:
    return " ".join({record.estimate.reason + record.reason + record.status.reason
                     for record in records[int(FROM_S / 0.02) :]})  # fmt: skip


@pytest.mark.parametrize("sensors", ["rtk", "m8n"])
def test_a_receiver_that_jumps_100_m_is_told_and_crushes_nothing(
    tmp_path: Path, sensors: str
) -> None:
    def jump(batch: SensorBatch) -> SensorBatch:
        return msgspec.structs.replace(batch, gnss=tuple(moved(fix, 100.0) for fix in batch.gnss))

    report, records = driven(tmp_path, jump, f'sim.sensors="{sensors}"')
    assert report.tracking.plants_crushed == 0
    assert "rejected in a row" in reasons(records)
    last = records[-1]
    if sensors == "rtk":
        assert last.status.state == "failed"
        assert "off path" in last.status.reason
        assert last.command.drive.v_mps == 0.0


def test_a_receiver_that_freezes_is_noticed_and_crushes_nothing(tmp_path: Path) -> None:
    last: list[GnssFix] = []

    def freeze(batch: SensorBatch) -> SensorBatch:
        last[:] = last or batch.gnss[-1:]
        frozen = tuple(msgspec.structs.replace(last[0], t_s=fix.t_s) for fix in batch.gnss)
        return msgspec.structs.replace(batch, gnss=frozen)

    report, records = driven(tmp_path, freeze, 'sim.sensors="rtk"')
    assert report.tracking.plants_crushed == 0
    assert "rejected in a row" in reasons(records)
    truth_beyond = [record.estimate.protection_m for record in records[-50:]]
    assert all(level_m > 1.0 for level_m in truth_beyond)


def test_a_clock_that_goes_back_stops_the_robot(tmp_path: Path) -> None:
    def back(batch: SensorBatch) -> SensorBatch:
        return msgspec.structs.replace(batch, t_s=batch.t_s - 5.0)

    report, records = driven(tmp_path, back, 'sim.sensors="rtk"')
    assert report.tracking.plants_crushed == 0
    assert "clock went back" in reasons(records)
    assert records[-1].command.drive.v_mps == 0.0


def test_fixes_that_are_no_numbers_are_as_good_as_none(tmp_path: Path) -> None:
    def nan(batch: SensorBatch) -> SensorBatch:
        lost = tuple(msgspec.structs.replace(fix, lat_deg=math.nan) for fix in batch.gnss)
        return msgspec.structs.replace(batch, gnss=lost)

    report, records = driven(tmp_path, nan, 'sim.sensors="rtk"')
    assert report.tracking.plants_crushed == 0
    assert "GNSS silent" in reasons(records)
