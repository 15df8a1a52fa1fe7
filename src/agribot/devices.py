"""What further devices say, beside the sensors that every robot has; all of it is optional.

Units and frames as in `messages`; a batch without such a device carries an empty tuple.
"""

from __future__ import annotations

import msgspec


class BaseFix(msgspec.Struct, frozen=True, kw_only=True):
    """Where a receiver at a known place believes to be: what is off there is off nearby, too."""

    t_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    pos_std_m: float
    known_lat_deg: float
    known_lon_deg: float
    known_alt_m: float

    def error(self) -> tuple[float, float, float]:
        """Latitude, longitude (degrees) and altitude (m) to subtract from a fix near by."""
        return (
            self.lat_deg - self.known_lat_deg,
            self.lon_deg - self.known_lon_deg,
            self.alt_m - self.known_alt_m,
        )


class GnssHeading(msgspec.Struct, frozen=True, kw_only=True):
    """Heading of the robot from two antennas; silent while the ambiguities are not fixed."""

    t_s: float
    yaw_map_rad: float
    std_rad: float


class BumperSample(msgspec.Struct, frozen=True, kw_only=True):
    """The robot touches something, here in the body frame; one sample per tick of contact."""

    t_s: float
    x_body_m: float
    y_body_m: float


class BatterySample(msgspec.Struct, frozen=True, kw_only=True):
    """Voltage at the terminals, current drawn, and what is left of the capacity."""

    t_s: float
    voltage_v: float
    current_a: float
    charge_ratio: float


class RowLine(msgspec.Struct, frozen=True, kw_only=True):
    """The crop row under the robot, as one frame shows it; whoever looks cannot tell which row.

    `offset_m` is how far the body's origin stands to the left of the row, `heading_rad` the
    robot's heading against the row's direction that it faces, counter-clockwise; both are None
    where too little of the row is in view. The first and the last plant lie so far ahead along
    the row, None where they are not in view. Sigmas are
    those of one frame; errors that last for seconds come on top. `offset_m` holds for the point
    `at_ahead_m` ahead on the body's x axis: there its error is independent of the heading's.
    """

    t_s: float
    offset_m: float | None
    heading_rad: float | None
    offset_std_m: float
    heading_std_rad: float
    start_ahead_m: float | None = None
    end_ahead_m: float | None = None
    range_std_m: float = 0.1
    at_ahead_m: float = 0.0


class CropCover(msgspec.Struct, frozen=True, kw_only=True):
    """Where leaves of crop stand over the ground, as one frame shows it; nothing may spray there.

    Square cells of the body frame, row by row from the corner at (`x_body_m`, `y_body_m`): columns
    run to the left (y), rows forwards (x). `crop` and `seen` hold a bit for each cell, the highest
    bit of a byte first, whether it shows crop, and whether the picture shows it at all.
    """

    x_body_m: float
    y_body_m: float
    cell_m: float
    rows: int
    columns: int
    crop: bytes
    seen: bytes
