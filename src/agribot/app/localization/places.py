"""Places that a log states, and the units of numbers that are not places."""

from __future__ import annotations

import math

from agribot.core.errors import BridgeError, add_advice

PER_DEGREE = 1e7  # factor of receivers that count whole numbers


def check_place(lat_deg: float, lon_deg: float) -> None:
    """Refuse what is no place in degrees.

    Raises: BridgeError: it says what unit it looks like.
    """
    if not math.isfinite(lat_deg + lon_deg):
        raise BridgeError(
            f"latitude {lat_deg:g}, longitude {lon_deg:g} is not finite; it is left out"
        )
    if abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0:
        return
    what = f"latitude {lat_deg:.9g}, longitude {lon_deg:.9g} is no place in degrees"
    if abs(lat_deg) / PER_DEGREE <= 90.0 and abs(lon_deg) / PER_DEGREE <= 180.0:
        if max(abs(lat_deg), abs(lon_deg)) > PER_DEGREE / 10.0:
            what += "; it looks like units of 1e-7 degrees, divide both by 1e7"
        elif abs(lat_deg) <= 9000.0 and abs(lon_deg) <= 18000.0:
            what += "; it looks like ddmm.mmmm of NMEA, convert it to degrees"
    raise BridgeError(add_advice(what, "write decimal degrees"))
