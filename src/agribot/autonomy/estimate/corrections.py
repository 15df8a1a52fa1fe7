"""The sensors that correct the pose, in the order in which those of one batch do so.

A further one is a class in a file of its own, and a line here or, from elsewhere, one call of
`register_correction`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from agribot.autonomy.estimate.sensors.base_correction import BaseCorrection
from agribot.autonomy.estimate.sensors.compass import Compass
from agribot.autonomy.estimate.sensors.correction import Correction
from agribot.autonomy.estimate.sensors.crop_rows import CropRows
from agribot.autonomy.estimate.sensors.dual_heading import DualHeading
from agribot.autonomy.estimate.sensors.gnss import Gnss
from agribot.autonomy.estimate.sensors.plant_places import PlantPlaces
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.autonomy.estimate.sensors.row_lines import RowLines
from agribot.core.errors import ConfigError
from agribot.core.plugins import CORRECTIONS as GROUP
from agribot.core.plugins import bind_all, find_used

BuildCorrection = Callable[..., Correction[Any]]  # builder that takes a `PoseFilter` and `settings`

# Corrections by the name under which a refused sample is counted, and the sensor.
CORRECTIONS: dict[str, BuildCorrection] = {
    "mag": Compass,
    "base": BaseCorrection,
    "gnss": Gnss,
    "antenna heading": DualHeading,
    "row line": RowLines,
    "scene": CropRows,
    "plants": PlantPlaces,
}


def register_correction(name: str, build: BuildCorrection) -> None:
    """Let a further sensor correct the pose, after those that are there.

    Replays need it too: a recording keeps what was measured, not who took it.

    Raises: ConfigError: the name is taken.
    """
    if name in CORRECTIONS:
        raise ConfigError(f"the correction {name!r} is registered already; choose another name")
    CORRECTIONS[name] = build


def load_corrections(plugins: Mapping[str, Any]) -> dict[str, Callable[[PoseFilter], Any]]:
    """Take those that are registered, and with their settings those of installed packages.

    Args:
        plugins: `RunConfig.plugins`, which names the installed ones that are used.

    Raises: ConfigError: a package cannot be imported, or its settings do not fit.
    """
    installed = find_used(GROUP, plugins)
    for name in installed.keys() & CORRECTIONS.keys():
        raise ConfigError(
            f"corrections: the installed correction {name!r} has the name of a registered one; "
            "rename it in its package"
        )
    return bind_all(CORRECTIONS | installed, plugins)
