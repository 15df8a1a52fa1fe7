"""The map of what must not be entered, from its file into the settings of a run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError
from agribot.core.geo import Datum, MapFrame
from agribot.description.ros_map import OCCUPIED, UNKNOWN, load_ros_map
from agribot.gis.map_outlines import Ring, outline_cells


def settle_keep_out(config: RunConfig) -> RunConfig:
    """Return the settings with the areas of `field.keep_out` in place of its file.

    Raises:
        ConfigError: an area of the settings has fewer than three corners.
        DescriptionError: the file is no map, or has more areas than can be planned with.
    """
    field = config.field
    _check_corners(field.keep_out_map_m)
    if not field.keep_out:
        return config
    rings = read_keep_out(Path(field.keep_out), field.datum, with_unknown=field.keep_out_unknown)
    settled = msgspec.structs.replace(
        field, keep_out="", keep_out_map_m=(*field.keep_out_map_m, *rings)
    )
    return msgspec.structs.replace(config, field=settled)


def _check_corners(areas: Sequence[Ring]) -> None:
    for number, ring in enumerate(areas, 1):
        if len(ring) < 3:
            raise ConfigError(
                f"field.keep_out_map_m: area {number} of {len(areas)} has {len(ring)} corners; "
                "give at least 3"
            )


def read_keep_out(path: Path, datum: Datum, *, with_unknown: bool = False) -> tuple[Ring, ...]:
    """Read the areas of a map_server map, in the map of `datum`.

    A map that states a datum of its own is moved by the distance of the two.
    Raises: DescriptionError: as `settle_keep_out`.
    """
    ros_map = load_ros_map(path)
    rings = outline_cells(ros_map, (OCCUPIED, UNKNOWN) if with_unknown else (OCCUPIED,))
    own = ros_map.datum
    if own is None:
        return rings
    east_m, north_m, _ = MapFrame(datum).map_from_geodetic(own.lat_deg, own.lon_deg, datum.alt_m)
    return tuple(tuple((x + east_m, y + north_m) for x, y in ring) for ring in rings)
