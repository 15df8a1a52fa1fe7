"""Where a machine was left: kept while it stands, dropped when it drives, read by the next run."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.app.place_memory import PlaceMemory
from agribot.core.config import FieldConfig
from agribot.core.geo import MapFrame
from agribot.core.messages import GnssQuality
from tests.record.record_samples import tick

FIELD = FieldConfig()


def live(
    *parts: tuple[float, float],
    quality: GnssQuality = GnssQuality.RTK_FIXED,
    pos_std_m: float = 0.01,
) -> None:
    """Live through parts of a run, each of a duration (s) and a speed (m/s), at (4, 5)."""
    memory, now_s = PlaceMemory("hardware", FIELD), 0.0
    record = tick(0, np.random.default_rng(0))
    for lasts_s, speed_mps in parts:
        for _ in range(round(lasts_s / 0.1)):
            now_s += 0.1
            estimate = msgspec.structs.replace(
                record.estimate, t_s=now_s, x_map_m=4.0, y_map_m=5.0, v_mps=speed_mps,
                pos_std_m=pos_std_m, quality=quality,
            )  # fmt: skip
            memory(msgspec.structs.replace(record, estimate=estimate))
    memory.close()


def recall(field: FieldConfig = FIELD) -> FieldConfig:
    return PlaceMemory("hardware", field).recall()


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path))


def test_the_next_run_knows_where_the_robot_was_left() -> None:
    live((2.0, 0.4), (1.5, 0.0))
    assert recall().left_map_m == pytest.approx((4.0, 5.0), abs=1e-3)


def test_a_map_with_another_datum_has_the_same_place_elsewhere() -> None:
    live((1.5, 0.0))
    east = MapFrame(FIELD.datum).geodetic_from_map(100.0, 0.0, 0.0)
    datum = msgspec.structs.replace(FIELD.datum, lat_deg=east[0], lon_deg=east[1])
    left = recall(msgspec.structs.replace(FIELD, datum=datum))
    assert left.left_map_m == pytest.approx((-96.0, 5.0), abs=0.01)


@pytest.mark.parametrize(
    ("parts", "quality", "pos_std_m"),
    [
        ([(1.5, 0.0), (1.0, 0.4)], GnssQuality.RTK_FIXED, 0.01),  # the program ended on the way
        ([(0.8, 0.0)], GnssQuality.RTK_FIXED, 0.01),
        ([(5.0, 0.0)], GnssQuality.SINGLE, 0.01),
        ([(5.0, 0.0)], GnssQuality.RTK_FIXED, 0.05),
    ],
)
def test_nothing_is_known_of_a_robot_that_drove_or_was_not_sure_of_its_place(
    parts: list[tuple[float, float]], quality: GnssQuality, pos_std_m: float
) -> None:
    live(*parts, quality=quality, pos_std_m=pos_std_m)
    assert recall() == FIELD


def test_a_file_that_is_damaged_is_as_good_as_none() -> None:
    live((1.5, 0.0))
    PlaceMemory("hardware", FIELD).path.write_bytes(b"{")
    assert recall() == FIELD
