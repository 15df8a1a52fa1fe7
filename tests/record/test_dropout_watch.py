"""A part that falls silent for moments is named from the third time within ten minutes on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.cli.doctor.doctor_runs import check_dropouts
from agribot.core.facts import ComesAndGoes, ComingAndGoing
from agribot.core.messages import GnssFix, GnssQuality, ImuSample, SensorBatch, WheelSample
from agribot.record.dropout_watch import DropoutWatch

TICK_S = 0.02


def drive(
    gaps: dict[str, list[tuple[float, float]]],
    seconds: float = 60.0,
    stuck_wheel: int | None = None,
) -> Iterator[SensorBatch]:
    """Drive straight ahead at 4 rad/s; `gaps` are silences (from, for) by the field of the batch.

    Those of `ticks` are of the whole program, those of `encoder` of one wheel's encoder.
    """
    missed_rad = 0.0
    for index in range(int(seconds / TICK_S)):
        t_s = TICK_S * index
        silent = {
            name for name, spans in gaps.items()
            if any(begin_s < t_s < begin_s + long_s for begin_s, long_s in spans)
        }  # fmt: skip
        missed_rad += 4.0 * TICK_S * ("encoder" in silent)
        angles = [4.0 * t_s - missed_rad * (wheel == stuck_wheel) for wheel in range(4)]
        if "ticks" in silent:
            continue
        yield SensorBatch(
            t_s=t_s,
            wheels=() if "wheels" in silent else (_read_wheels(t_s, angles),),
            imu=() if "imu" in silent else (_read_imu(t_s),),
            gnss=(_fix(t_s),) if index % 10 == 0 and "gnss" not in silent else (),
        )


def _read_wheels(t_s: float, angles: list[float]) -> WheelSample:
    right_rear, left_rear, right_front, left_front = angles
    return WheelSample(
        t_s=t_s, angle_rad=(right_rear, left_rear, right_front, left_front),
        speed_radps=(4.0, 4.0, 4.0, 4.0),
    )  # fmt: skip


def _read_imu(t_s: float) -> ImuSample:
    return ImuSample(t_s=t_s, accel_mps2=(0.0, 0.0, 9.81), gyro_radps=(0.0, 0.0, 0.0))


def _fix(t_s: float) -> GnssFix:
    return GnssFix(
        t_s=t_s, lat_deg=48.7, lon_deg=9.2, alt_m=400.0, pos_std_m=0.01,
        quality=GnssQuality.RTK_FIXED,
    )  # fmt: skip


def watch(batches: Iterator[SensorBatch]) -> tuple[list[ComesAndGoes], DropoutWatch]:
    found: list[ComesAndGoes] = []
    dropouts = DropoutWatch()
    for batch in batches:
        found += dropouts.update(batch)
    return found, dropouts


def spread(count: int, long_s: float) -> list[tuple[float, float]]:
    return [(10.0 + 5.0 * index, long_s) for index in range(count)]


@pytest.mark.parametrize(
    ("field", "part", "long_s"),
    [("wheels", "wheels", 0.25), ("imu", "imu", 0.3), ("gnss", "gnss", 1.3),
     ("ticks", "program", 0.6), ("encoder", "left_wheel_F", 0.3)],
)  # fmt: skip
def test_the_third_dropout_within_ten_minutes_is_reported_once(
    field: str, part: ComingAndGoing, long_s: float
) -> None:
    found, dropouts = watch(drive({field: spread(7, long_s)}, stuck_wheel=3))
    assert [(fact.silent_part, fact.count) for fact in found] == [(part, 3)]
    assert found[0].longest_s == pytest.approx(long_s, abs=0.21)
    assert {name: one.count for name, one in dropouts.summarise().items()} == {part: 7}


def test_two_dropouts_and_a_steady_rhythm_are_no_news() -> None:
    assert watch(drive({"imu": spread(2, 0.3)}))[0] == []
    assert watch(drive({}))[1].summarise() == {}


def test_a_clock_that_leaps_and_goes_back_is_no_program_that_stands() -> None:
    leaps = [(10.0, 12.0), (20.0, 22.0), (30.0, 32.0), (40.0, 42.0)]

    def leap(batch: SensorBatch) -> SensorBatch:
        is_off = any(begin_s < batch.t_s < end_s for begin_s, end_s in leaps)
        return msgspec.structs.replace(batch, t_s=batch.t_s + 2.0 * is_off)

    found, dropouts = watch(map(leap, drive({})))
    assert found == []
    assert dropouts.summarise() == {}


def test_samples_that_jitter_are_no_dropouts() -> None:
    rng = np.random.default_rng(1)
    late = [(float(t_s), float(rng.uniform(0.02, 0.15))) for t_s in np.arange(2.0, 58.0, 0.5)]
    assert watch(drive({"imu": late, "gnss": late}))[0] == []


def test_dropouts_that_are_more_than_ten_minutes_apart_are_forgotten() -> None:
    gaps = [(10.0, 0.3), (300.0, 0.3), (650.0, 0.3), (690.0, 0.3), (1400.0, 0.3)]
    found, dropouts = watch(drive({"imu": gaps}, seconds=1450.0))
    assert [fact.count for fact in found] == [3]
    assert dropouts.summarise()["imu"].count == 5
    assert dropouts.summarise()["imu"].per_hour == pytest.approx(5 / (1450.0 / 3600.0), rel=0.01)


def test_a_wheel_that_stands_while_the_robot_turns_about_it_is_no_dropout() -> None:
    batches = []
    for index in range(1000):
        t_s = TICK_S * index
        turn_rad = 4.0 * t_s
        angles = [turn_rad, 0.0, turn_rad, 0.3 * turn_rad if index % 50 else 0.0]
        batches.append(SensorBatch(t_s=t_s, wheels=(_read_wheels(t_s, angles),)))
    assert watch(iter(batches))[1].summarise() == {}


def test_dropouts_of_an_encoder_are_a_warning_of_the_wheels() -> None:
    fact = ComesAndGoes("left_wheel_F", 3, 10.0, 0.31)
    assert (fact.parts, fact.severity) == (("wheels",), "warning")


def test_the_doctor_shows_how_dropouts_grow_from_run_to_run(tmp_path: Path) -> None:
    for index, count in enumerate((0, 2, 7)):
        folder = tmp_path / f"run{index}"
        folder.mkdir()
        one = {"count": count, "per_hour": 2.0 * count, "longest_s": 0.3}
        safety = {"dropouts": {"gnss": one} if count else {}}
        (folder / "report.json").write_bytes(msgspec.json.encode({"safety": safety}))
    (tmp_path / "older").mkdir()
    (tmp_path / "older" / "report.json").write_text('{"safety": {}}')
    (finding,) = check_dropouts(tmp_path)
    assert finding.what == "short dropouts of gnss"
    assert finding.state == "warning"
    assert finding.detail.startswith("0, 4, 14 an hour in the last 3 runs")
    assert list(check_dropouts(tmp_path / "none")) == []
