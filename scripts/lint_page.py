"""Check the source of the operator's page: `python scripts/lint_page.py`, with `--fix` fix it.

Installs the packages of `web/package-lock.json` first where the linter of that file is not there.
"""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
WEB = ROOT / "web"
LINTER = "node_modules/@biomejs/biome"
INSTALL = ["ci", "--ignore-scripts", "--no-audit", "--no-fund"]
NO_BUILD = "web/package-lock.json has no Biome for this machine: the page is not checked\n"


def is_installed() -> bool:
    """Whether the linter is there in the version of the lock file."""
    lock = json.loads((WEB / "package-lock.json").read_text(encoding="utf-8"))
    package = WEB / LINTER / "package.json"
    wanted: str = lock["packages"][LINTER]["version"]
    return package.is_file() and json.loads(package.read_text("utf-8"))["version"] == wanted


def has_build() -> bool:
    """Whether the linter runs on this kind of machine; its builds are packages of their own."""
    return any((WEB / LINTER).parent.glob("cli-*"))


def main(arguments: list[str]) -> int:
    npm, environment = runpy.run_path(str(ROOT / "hatch_build.py"))["npm_command"]()

    def run(*step: str) -> int:
        return subprocess.run([*npm, *step], cwd=WEB, env=environment, check=False).returncode

    if not is_installed() and (failed := run(*INSTALL)):
        return failed
    if not has_build():
        sys.stderr.write(NO_BUILD)
        return int(os.environ.get("AGRIBOT_REQUIRE_ALL") == "1")
    return run("run", "--silent", "format" if "--fix" in arguments else "lint")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
