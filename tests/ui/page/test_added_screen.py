"""A screen is added by one new file and its name in the list."""

from __future__ import annotations

import importlib.util
import os
import runpy
import shutil
import subprocess
from pathlib import Path

from playwright.sync_api import BrowserContext, expect

from agribot.ui import wire
from tests.ui.page.conftest import WITHOUT_GL, until
from tests.ui.page.fake_server import FakeServer, serving

ROOT = Path(__file__).parents[3]
SCREEN = """import type { Screen } from '../app.ts'
import { el } from '../dom.ts'

export const moon: Screen = {
  id: 'moon', title: 'Moon', icon: 'plots',
  mount(host) {
    host.append(el('p', { class: 'card' }, 'Waxing'))
    return () => undefined
  },
}
"""


def link(source: str, target: str) -> None:
    """A second name for a file costs nothing; where there can be none, a copy."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def build_with_screen(root: Path) -> Path:
    """Build the page's sources with one screen more; the folder of the result."""
    web = root / "web"
    shutil.copytree(ROOT / "web", web, symlinks=True, copy_function=link)
    link(str(ROOT / "LICENSE"), str(root / "LICENSE"))
    write_screens = runpy.run_path(str(ROOT / "scripts" / "generate_wire.py"))["write_screens"]
    (web / "src/screens/moon.ts").write_text(SCREEN)
    (web / "src/screens/index.ts").unlink()  # or the link would lead to the page's own
    (web / "src/screens/index.ts").write_text(write_screens((*wire.SCREENS, "moon")))
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec and spec.loader
    hook = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hook)
    npm, environment = hook.npm_command()
    done = subprocess.run(
        [*npm, "run", "build"],
        cwd=web,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    return root / "src/agribot/ui/page"


def test_a_screen_is_one_file_and_its_name_in_the_list(
    context: BrowserContext, tmp_path: Path
) -> None:
    fake = FakeServer(page=build_with_screen(tmp_path))
    with serving(fake) as address:
        page = context.new_page()
        page.goto(f"{address}/?{WITHOUT_GL}#/drive")
        until(page, "window.__agribot?.ready")
        page.get_by_role("link", name="Moon").click()
        expect(page.locator("#main")).to_contain_text("Waxing")
