"""Where magnetic North is: by the World Magnetic Model, as typed, or as the simulator has it."""

from __future__ import annotations

import builtins
import datetime
from pathlib import Path
from typing import Any

import msgspec
import pytest

from agribot.app.declination import find_magnetic_north, settle_declination
from agribot.app.run_setup import prepare_run
from agribot.cli.doctor import doctor_machine
from agribot.core import config as settings
from agribot.core.errors import ConfigError
from agribot.core.geo import Datum
from agribot.core.robot import RobotSpec
from agribot.description.loader import load_robot

TODAY = datetime.date(2026, 11, 29)
BONN = Datum(lat_deg=50.62, lon_deg=6.99, alt_m=200.0)
CAPE_TOWN = Datum(lat_deg=-33.9, lon_deg=18.4, alt_m=50.0)
# By the model's makers' own program, wmm-calculator 1.4.4 of NOAA and CIRES.
REFERENCE = (
    (Datum(lat_deg=21.161289, lon_deg=72.787022), (2026, 11, 29), 0.3326, 37561.8),
    (BONN, (2025, 1, 1), 3.0944, 19835.1),
    (CAPE_TOWN, (2027, 6, 1), -26.9165, 10726.7),
    (Datum(lat_deg=64.1, lon_deg=-21.9, alt_m=30.0), (2026, 1, 1), -11.2450, 13249.8),
    (Datum(lat_deg=40.0, lon_deg=-95.0, alt_m=300.0), (2029, 12, 1), 1.1275, 20264.0),
    (Datum(lat_deg=-35.3, lon_deg=149.1, alt_m=600.0), (2026, 7, 1), 12.6324, 23615.2),
    (Datum(lat_deg=-80.0, lon_deg=-120.0), (2025, 1, 1), 68.7754, 16898.1),
)


@pytest.fixture(scope="module")
def rover() -> RobotSpec:
    return load_robot()


def real(datum: Datum, *sets: str) -> settings.RunConfig:
    config = settings.load("hardware", [*sets])
    field = msgspec.structs.replace(config.field, datum=datum)
    return msgspec.structs.replace(config, field=field)


@pytest.mark.parametrize(("datum", "day", "declination_deg", "horizontal_nt"), REFERENCE)
def test_the_declination_is_that_of_the_models_makers(
    datum: Datum, day: tuple[int, int, int], declination_deg: float, horizontal_nt: float
) -> None:
    north = find_magnetic_north(datum, datetime.date(*day))
    assert north.declination_deg == pytest.approx(declination_deg, abs=0.006)
    assert north.horizontal_t == pytest.approx(1e-9 * horizontal_nt, rel=1e-5)
    assert north.model == "WMM-2025" and 0.2 < north.std_deg < 1.0


def test_a_real_robot_takes_the_declination_of_its_place_and_day(rover: RobotSpec) -> None:
    settled = settle_declination(real(CAPE_TOWN), rover, datetime.date(2027, 6, 1))
    assert settled.config.field.declination_deg == -26.92
    assert settled.notes == (
        "declination: 26.9 deg west at -33.9000, 18.4000 on 2027-06-01 by WMM-2025",
    )
    assert settled.warnings == ()


def test_a_value_that_was_typed_stays_and_is_warned_of_where_it_is_off(rover: RobotSpec) -> None:
    near = settle_declination(real(BONN, "field.declination_deg=5"), rover, TODAY)
    assert (near.config.field.declination_deg, near.notes, near.warnings) == (5.0, (), ())
    wrong_sign = real(CAPE_TOWN, "field.declination_deg=26.9")
    settled = settle_declination(wrong_sign, rover, TODAY)
    assert settled.config.field.declination_deg == 26.9
    (warning,) = settled.warnings
    assert "field.declination_deg is 26.9, 53.7 deg > 3 deg off the -26.8" in warning
    assert warning.endswith("check sign and place, or leave it out")


def test_the_simulators_robot_is_told_nothing_of_a_field_that_is_turned(rover: RobotSpec) -> None:
    for setting in ("seed=1", "sim.declination_deg=15", "field.declination_deg=-20"):
        config = settings.load("farm", [setting])
        assert settle_declination(config, rover, TODAY) == (config, (), ())


def test_a_robot_without_a_magnetometer_hears_nothing_of_it(rover: RobotSpec) -> None:
    without = msgspec.structs.replace(rover, mag=None)
    settled = settle_declination(real(CAPE_TOWN, "field.declination_deg=9"), without, TODAY)
    assert (settled.config.field.declination_deg, settled.warnings) == (9.0, ())


@pytest.mark.parametrize(
    ("day", "computed_for", "words"),
    [
        ((2031, 3, 1), (2029, 12, 31), "WMM-2025 ends with 2029, today is 2031-03-01"),
        (
            (1970, 1, 1),
            (2025, 1, 1),
            "this machine's clock says 1970-01-01, before WMM-2025 begins",
        ),
    ],
)
def test_outside_its_years_the_nearest_day_is_taken_and_reported(
    rover: RobotSpec, day: tuple[int, int, int], computed_for: tuple[int, int, int], words: str
) -> None:
    settled = settle_declination(real(BONN), rover, datetime.date(*day))
    nearest = find_magnetic_north(BONN, datetime.date(*computed_for))
    assert settled.config.field.declination_deg == nearest.declination_deg
    (warning,) = settled.warnings
    assert words in warning and "clock" in warning


def test_near_a_magnetic_pole_a_compass_is_said_to_be_useless(rover: RobotSpec) -> None:
    settled = settle_declination(real(Datum(lat_deg=82.0, lon_deg=-115.0)), rover, TODAY)
    (warning,) = settled.warnings
    assert "uT level, under 2; no compass works so near to a magnetic pole" in warning


def test_without_the_model_the_robot_drives_and_says_what_to_install(
    rover: RobotSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = builtins.__import__

    def refuse(name: str, *args: Any) -> Any:
        if name == "pygeomag":
            raise ImportError(name)
        return found(name, *args)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(ConfigError, match=r"not installed; .*hardware.*, or set field"):
        find_magnetic_north(BONN, TODAY)
    settled = settle_declination(real(BONN), rover, TODAY)
    assert settled.config.field.declination_deg == 0.0
    assert settled.warnings[0].endswith("or set field.declination_deg; until then it is taken as 0")
    assert settle_declination(real(BONN, "field.declination_deg=3"), rover, TODAY).warnings == ()
    (finding,) = doctor_machine.check_declination(TODAY)
    assert finding.state == "missing" and "not installed" in finding.detail


def test_a_run_keeps_the_declination_in_its_settings(tmp_path: Path) -> None:
    setup = prepare_run(real(CAPE_TOWN), tmp_path / "run")
    assert setup.config.field.declination_deg == pytest.approx(-27.0, abs=1.0)
    assert "west" in setup.notes[0]
    assert f"declination_deg = {setup.config.field.declination_deg}" in settings.to_toml(
        setup.config
    )
    simulated = prepare_run(settings.load("farm"), tmp_path / "sim")
    assert simulated.config.field.declination_deg is None


def test_the_doctor_says_until_when_the_model_is_good() -> None:
    (finding,) = doctor_machine.check_declination(TODAY)
    assert (finding.state, finding.detail[:19]) == ("ok", "WMM-2025 until 2030")
    (finding,) = doctor_machine.check_declination(datetime.date(2033, 1, 1))
    assert finding.state == "warning" and "pip install --upgrade pygeomag" in finding.detail
