"""A screen is one file and one word in a list: the one of the page for contributors is shown."""

from __future__ import annotations

import re
import runpy
import shutil
import subprocess
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, expect

from agribot.ui import wire
from tests import nightly
from tests.ui.page.conftest import WITHOUT_GL, until
from tests.ui.page.fake_server import FakeServer, serving

ROOT = Path(__file__).parents[3]
WEB = ROOT / "web"
TOOLS = WEB / "node_modules" / ".bin"
# The page's own settings without what makes licences and compressed files.
SETTINGS = "export default { base: './', build: { target: 'es2022' }, worker: { format: 'es' } }\n"

pytestmark = pytest.mark.skipif(
    not (TOOLS / "vite").exists(),
    reason="the page's tools are missing (cd web && npm ci)",
)


def copy_web(folder: Path) -> Path:
    shutil.copytree(WEB / "src", folder / "src")
    shutil.copytree(WEB / "public", folder / "public")
    for name in ("index.html", "package.json", "tsconfig.json"):
        shutil.copy(WEB / name, folder / name)
    (folder / "vite.config.ts").write_text(SETTINGS)
    (folder / "node_modules").symlink_to(WEB / "node_modules")
    return folder


def add_screen(web: Path) -> str:
    """The file of the page for contributors, and the list with its name."""
    text = (ROOT / "docs" / "contribute" / "screen.md").read_text(encoding="utf-8")
    ((name, code),) = re.findall(r"^```typescript file=(\w+)\.ts\n(.*?)^```$", text, re.S | re.M)
    write_screens = runpy.run_path(str(ROOT / "scripts" / "generate_wire.py"))["write_screens"]
    screens = web / "src" / "screens"
    (screens / f"{name}.ts").write_text(code, encoding="utf-8")
    (screens / "index.ts").write_text(write_screens([*wire.SCREENS, name]), encoding="utf-8")
    return str(name)


def run_tool(web: Path, name: str, *words: str) -> None:
    _, environment = runpy.run_path(str(ROOT / "hatch_build.py"))["npm_command"]()
    done = subprocess.run(
        [str(TOOLS / name), *words],
        cwd=web, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_screen_of_ones_own_type_checks(tmp_path: Path) -> None:
    web = copy_web(tmp_path)
    add_screen(web)
    run_tool(web, "tsc", "--noEmit")


@nightly.by_day("test_a_screen_of_ones_own_type_checks")
def test_a_screen_of_ones_own_is_one_file_and_a_word_in_the_list(
    context: BrowserContext, tmp_path: Path
) -> None:
    web = copy_web(tmp_path)
    name = add_screen(web)
    run_tool(web, "vite", "build")
    with serving(FakeServer(page=web / "dist")) as address:
        page = context.new_page()
        page.goto(f"{address}/?{WITHOUT_GL}#/{name}")
        until(page, "window.__agribot?.ready")
        expect(page.locator("nav").get_by_text("Tilt").first).to_be_visible()
        expect(page.locator(".readout")).to_have_text(re.compile(r"side -?\d+\.\d °, ahead"))
