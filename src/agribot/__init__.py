"""AGRIBOT: an autonomous field robot that weeds, in simulation and on real hardware.

The names below are the public API: they keep their meaning from one minor version to the next.
Each is imported when it is first asked for, so that `import agribot` loads nothing else.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from agribot.core.version import __version__

if TYPE_CHECKING:
    from agribot.app.open_run import open_run
    from agribot.app.run import Run
    from agribot.app.simulated_run import SimulatedRun, simulate
    from agribot.autonomy.estimate.corrections import register_correction
    from agribot.autonomy.estimate.sensors.correction import Correction
    from agribot.core import messages, topics
    from agribot.core.config import RunConfig, load
    from agribot.core.errors import AgribotError
    from agribot.core.implement.kind import Implement, ImplementKind, register_implement
    from agribot.core.implement.spec import ImplementSpec
    from agribot.core.messages import RobotCommand, SensorBatch, TickRecord, Who
    from agribot.core.platform import Platform, SensorSource
    from agribot.core.platforms import register_platform
    from agribot.core.robot import RobotSpec
    from agribot.description.loader import load_robot
    from agribot.drivers.line.schemes import register_scheme
    from agribot.ui import panels
    from agribot.ui.robot_side.operator_page import OperatorPage

# Modules of the names; a module stands for itself.
_HOMES = {
    "AgribotError": "agribot.core.errors",
    "Correction": "agribot.autonomy.estimate.sensors.correction",
    "Implement": "agribot.core.implement.kind",
    "ImplementKind": "agribot.core.implement.kind",
    "ImplementSpec": "agribot.core.implement.spec",
    "OperatorPage": "agribot.ui.robot_side.operator_page",
    "Platform": "agribot.core.platform",
    "RobotCommand": "agribot.core.messages",
    "RobotSpec": "agribot.core.robot",
    "Run": "agribot.app.run",
    "RunConfig": "agribot.core.config",
    "SensorBatch": "agribot.core.messages",
    "SensorSource": "agribot.core.platform",
    "SimulatedRun": "agribot.app.simulated_run",
    "TickRecord": "agribot.core.messages",
    "Who": "agribot.core.messages",
    "load": "agribot.core.config",
    "load_robot": "agribot.description.loader",
    "messages": "agribot.core",
    "open_run": "agribot.app.open_run",
    "panels": "agribot.ui",
    "register_correction": "agribot.autonomy.estimate.corrections",
    "register_implement": "agribot.core.implement.kind",
    "register_platform": "agribot.core.platforms",
    "register_scheme": "agribot.drivers.line.schemes",
    "simulate": "agribot.app.simulated_run",
    "topics": "agribot.core",
}

__all__ = [
    "AgribotError", "Correction", "Implement", "ImplementKind", "ImplementSpec", "OperatorPage",
    "Platform", "RobotCommand", "RobotSpec", "Run", "RunConfig", "SensorBatch", "SensorSource",
    "SimulatedRun", "TickRecord", "Who", "__version__", "load", "load_robot", "messages",
    "open_run", "panels", "register_correction", "register_implement", "register_platform",
    "register_scheme", "simulate", "topics",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'agribot' has no attribute {name!r}")
    module = import_module(home)
    found = getattr(module, name, None)
    return import_module(f"{home}.{name}") if found is None else found


def __dir__() -> list[str]:
    return sorted(__all__)
