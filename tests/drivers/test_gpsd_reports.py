"""What gpsd leaves out of a report is not known, field by field (gpsd_json(5), TPV and GST)."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest

from agribot.cli.tools.gnss import ReceiverSummary
from agribot.core.messages import GnssFix, GnssQuality
from agribot.drivers.gnss.gpsd import GpsdFixes

NAN = math.nan
FULL: dict[str, Any] = {
    "class": "TPV", "mode": 3, "status": 2, "time": "2026-05-04T09:30:15.000Z", "lat": 51.0,
    "lon": 7.0, "altHAE": 145.2, "altMSL": 101.0, "geoidSep": 44.2, "eph": 1.2, "eps": 0.05,
    "track": 90.0, "speed": 2.0, "climb": 0.5, "velN": 0.0, "velE": 2.0, "velD": -0.5,
}  # fmt: skip
# What differs in the fix without a field; None is no fix.
WITHOUT: dict[tuple[str, ...], dict[str, Any] | None] = {
    ("mode",): None,
    ("time",): None,
    ("lat",): None,
    ("lon",): None,
    ("status",): {"quality": GnssQuality.SINGLE},
    ("altHAE",): {},
    ("altHAE", "altMSL"): {"alt_m": NAN},
    ("altHAE", "geoidSep"): {"alt_m": NAN},
    ("eph",): {"pos_std_m": 1.0},
    ("eps",): {"velocity_std_mps": 0.1},
    ("velD",): {"velocity_mps": (2.0, 0.0, NAN)},
    ("velN",): {},
    ("velE",): {},
    ("velN", "velE", "velD", "climb"): {"velocity_mps": (2.0, 0.0, NAN)},
    ("velN", "velE", "track"): {"velocity_mps": None},
    ("velN", "velE", "speed"): {"velocity_mps": None},
}


def read(report: dict[str, Any]) -> GnssFix | None:
    found = GpsdFixes(pytest.fail).add(report)
    return None if found is None else found.fix


def test_every_field_that_is_read_is_left_out_once() -> None:
    assert {name for names in WITHOUT for name in names} == set(FULL) - {"class"}


@pytest.mark.parametrize("names", WITHOUT)
@pytest.mark.parametrize("is_nan", [False, True])
def test_what_a_report_leaves_out_is_not_known(names: tuple[str, ...], is_nan: bool) -> None:
    whole, becomes = read(FULL), WITHOUT[names]
    left = {name: value for name, value in FULL.items() if name not in names}
    if is_nan and not {"mode", "time", "status", "lat", "lon"} & set(names):
        left |= dict.fromkeys(names, NAN)
    fix = read(left)
    if becomes is None:
        assert fix is None
        return
    assert fix is not None and whole is not None
    for name, value in msgspec.structs.asdict(whole).items():
        assert getattr(fix, name) == pytest.approx(becomes.get(name, value), nan_ok=True), name


def test_a_gpsd_of_old_tells_the_altitude_by_that_of_the_sea_and_no_altitude_is_not_0_m() -> None:
    for names, words in (
        (("altHAE",), "51.00000000, 7.00000000, 145.20 m"),
        (("altHAE", "altMSL"), "51.00000000, 7.00000000, no altitude"),
    ):
        fix = read({name: value for name, value in FULL.items() if name not in names})
        assert fix is not None
        summary = ReceiverSummary()
        summary.add(0.0, (fix,), {})
        assert summary.describe().startswith(words)


def test_an_accuracy_without_both_axes_is_none_and_refuses_nothing() -> None:
    fixes = GpsdFixes(pytest.fail)
    fixes.add({"class": "GST", "time": FULL["time"], "lat": 0.01})
    found = fixes.add(FULL)
    assert found is not None and found.fix.pos_std_m == pytest.approx(1.2 / math.sqrt(2.0))
    again = GpsdFixes(pytest.fail)
    again.add({"class": "GST", "time": FULL["time"], "lat": 0.3, "lon": 0.4})
    found = again.add(FULL)
    assert found is not None and found.fix.pos_std_m == pytest.approx(0.5 / math.sqrt(2.0))
