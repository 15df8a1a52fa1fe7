"""Direction of magnetic North, by the World Magnetic Model of the place and the day."""

from __future__ import annotations

import datetime
from typing import NamedTuple

import msgspec

from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError
from agribot.core.extras import format_install
from agribot.core.geo import Datum
from agribot.core.platforms import find_platform
from agribot.core.robot import RobotSpec

PACKAGE = "pygeomag"
MOST_OFF_DEG = 3.0  # largest difference of a typed value from the model's
# Horizontal field of the model's blackout zones round the magnetic poles, T.
LEAST_HORIZONTAL_T = 2e-6
T_PER_NT = 1e-9


class MagneticNorth(NamedTuple):
    """The model's values at a place: East positive, 1 sigma, and the level part of the field.

    `on` is the day that it was computed for, `asked` the one it was wanted for, which may lie
    outside the years of the model; `until_year` is where these end.
    """

    declination_deg: float
    std_deg: float
    horizontal_t: float
    model: str
    on: datetime.date
    asked: datetime.date
    until_year: int

    def describe(self, datum: Datum) -> str:
        """Say the declination in one line, with place and day."""
        side = "east" if self.declination_deg >= 0.0 else "west"
        return (
            f"declination: {abs(self.declination_deg):.1f} deg {side} at {datum.lat_deg:.4f}, "
            f"{datum.lon_deg:.4f} on {self.on.isoformat()} by {self.model}"
        )


def find_magnetic_north(datum: Datum, day: datetime.date) -> MagneticNorth:
    """Compute the declination of a place; a day outside the model's years is moved to the nearest.

    Raises: ConfigError: the package of the model is not installed.
    """
    try:
        from pygeomag import GeoMag
    except ImportError as error:
        raise ConfigError(
            f"declination: the World Magnetic Model is not installed; "
            f"{format_install('hardware')}, or set field.declination_deg"
        ) from error
    model = GeoMag()
    first, last = (int(year) for year in model.life_span)
    on = min(max(day, datetime.date(first, 1, 1)), datetime.date(last - 1, 12, 31))
    found = model.calculate(
        glat=datum.lat_deg, glon=datum.lon_deg, alt=datum.alt_m / 1000.0, time=_to_year(on)
    )
    return MagneticNorth(
        declination_deg=round(float(found.d), 2),
        std_deg=float(found.calculate_uncertainty().d),
        horizontal_t=float(found.h) * T_PER_NT,
        model=str(model.model),
        on=on,
        asked=day,
        until_year=last,
    )


def _to_year(day: datetime.date) -> float:
    first, next_first = datetime.date(day.year, 1, 1), datetime.date(day.year + 1, 1, 1)
    return day.year + (day - first).days / (next_first - first).days


class SettledDeclination(NamedTuple):
    """Settings with a declination; `notes` say where it comes from, `warnings` what is odd."""

    config: RunConfig
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def settle_declination(
    config: RunConfig, robot: RobotSpec, today: datetime.date
) -> SettledDeclination:
    """Fill in `field.declination_deg` of a real robot where it is not set; say what is odd.

    It is that of the model; a value that was typed stays, and is compared with it. In the simulator
    nothing changes: the field points to true North, but for `sim.declination_deg`, which the robot
    does not know.
    """
    typed_deg = config.field.declination_deg
    if find_platform(config.platform).is_simulated or robot.mag is None:
        return SettledDeclination(config)
    try:
        north = find_magnetic_north(config.field.datum, today)
    except ConfigError as error:
        why = () if typed_deg is not None else (f"{error}; until then it is taken as 0",)
        return SettledDeclination(_set_declination(config, typed_deg or 0.0), warnings=why)
    warnings = warn_of_model(north, config.field.datum)
    if typed_deg is None:
        settled = _set_declination(config, north.declination_deg)
        return SettledDeclination(settled, (north.describe(config.field.datum),), warnings)
    off_deg = abs((typed_deg - north.declination_deg + 180.0) % 360.0 - 180.0)
    if off_deg > MOST_OFF_DEG:
        warnings = (
            *warnings,
            f"declination: field.declination_deg is {typed_deg:g}, {off_deg:.1f} deg > "
            f"{MOST_OFF_DEG:g} deg off the {north.declination_deg:g} of {north.model} at "
            f"field.datum on {north.on.isoformat()}; check sign and place, or leave it out",
        )
    return SettledDeclination(config, warnings=warnings)


def warn_of_model(north: MagneticNorth, datum: Datum) -> tuple[str, ...]:
    """Say where the model cannot be relied on: outside its years, near a magnetic pole."""
    warnings = []
    if north.on < north.asked:
        warnings.append(
            f"declination: {north.model} ends with {north.until_year - 1}, today is "
            f"{north.asked.isoformat()}; computed for {north.on.isoformat()}; update it with "
            f"'pip install --upgrade {PACKAGE}', or correct this machine's clock"
        )
    elif north.on > north.asked:
        warnings.append(
            f"declination: this machine's clock says {north.asked.isoformat()}, before "
            f"{north.model} begins; computed for {north.on.isoformat()}; set the clock"
        )
    if north.horizontal_t < LEAST_HORIZONTAL_T:
        warnings.append(
            f"declination: at {datum.lat_deg:.2f}, {datum.lon_deg:.2f} the magnetic field is "
            f"{1e6 * north.horizontal_t:.1f} uT level, under {1e6 * LEAST_HORIZONTAL_T:.0f}; no "
            "compass works so near to a magnetic pole; leave the magnetometer out"
        )
    return tuple(warnings)


def _set_declination(config: RunConfig, declination_deg: float) -> RunConfig:
    field = msgspec.structs.replace(config.field, declination_deg=declination_deg)
    return msgspec.structs.replace(config, field=field)
