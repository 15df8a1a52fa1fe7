"""The page is built when it has to be, and installing never fails for want of it."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[3]
needs_linter = pytest.mark.skipif(
    not any((ROOT / "web" / "node_modules" / "@biomejs").glob("cli-*")),
    reason="Biome is missing (cd web && npm ci)",
)


@pytest.fixture(scope="module")
def hook() -> ModuleType:
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def make_sources(root: Path, scripts: dict[str, str]) -> Path:
    web = root / "web"
    web.mkdir()
    package = {"name": "page", "version": "1.0.0", "scripts": scripts}
    (web / "package.json").write_text(json.dumps(package))
    lock = {"name": "page", "version": "1.0.0", "lockfileVersion": 3, "packages": {"": package}}
    (web / "package-lock.json").write_text(json.dumps(lock))
    return web


def test_a_bundle_is_fresh_until_a_source_changes(hook: ModuleType, tmp_path: Path) -> None:
    web = make_sources(tmp_path, {})
    assert not hook.is_fresh(tmp_path)
    index = tmp_path / hook.PAGE / "index.html"
    index.parent.mkdir(parents=True)
    index.write_text("<!doctype html>")
    assert hook.is_fresh(tmp_path)
    later_s = index.stat().st_mtime + 10
    os.utime(web / "package.json", (later_s, later_s))
    assert not hook.is_fresh(tmp_path)


def test_packages_and_test_output_are_no_sources(hook: ModuleType, tmp_path: Path) -> None:
    web = make_sources(tmp_path, {})
    (web / "node_modules").mkdir()
    (web / "node_modules" / "x.js").write_text("")
    names = {path.name for path in hook.page_sources(web)}
    assert names == {"package.json", "package-lock.json"}


def test_without_sources_there_is_nothing_to_build(hook: ModuleType, tmp_path: Path) -> None:
    assert hook.is_fresh(tmp_path)


def test_a_failing_build_is_told_and_not_raised(hook: ModuleType, tmp_path: Path) -> None:
    make_sources(tmp_path, {"build": "node -e \"console.error('no such layer'); process.exit(3)\""})
    problem = hook.build_page(tmp_path)
    assert problem.startswith("npm run failed")
    assert "no such layer" in problem


def test_a_machine_without_node_is_told_what_is_missing(
    hook: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_sources(tmp_path, {"build": "true"})

    def no_node() -> None:
        raise ImportError

    monkeypatch.setattr(hook, "npm_command", no_node)
    assert "no Node" in hook.build_page(tmp_path)


def test_the_lock_file_names_no_registry() -> None:
    lock = json.loads((ROOT / "web" / "package-lock.json").read_text())
    packages = [package for name, package in lock["packages"].items() if name]
    assert packages
    assert all("resolved" not in package for package in packages)
    assert all(package["integrity"].startswith("sha512-") for package in packages)


def run_script(
    hook: ModuleType, name: str, web: Path = ROOT / "web"
) -> subprocess.CompletedProcess[str]:
    npm, environment = hook.npm_command()
    return subprocess.run(
        [*npm, "run", "--silent", name],
        cwd=web,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_page_type_checks_and_its_pure_parts_pass_their_tests(hook: ModuleType) -> None:
    done = run_script(hook, "check")
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert "# fail 0" in done.stdout


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    """A copy of a part of the page's source that a test may spoil."""
    web = tmp_path / "web"
    unwanted = shutil.ignore_patterns("node_modules", ".test-build", "src", "test", "public")
    shutil.copytree(ROOT / "web", web, ignore=unwanted)
    for name in ("src", "test"):
        (web / name).mkdir()
    shutil.copy(ROOT / "web" / "src" / "dom.ts", web / "src")
    (web / "node_modules").symlink_to(ROOT / "web" / "node_modules")
    return web


@needs_linter
def test_the_page_keeps_the_rules_of_its_linter_and_no_line_is_too_long(hook: ModuleType) -> None:
    done = run_script(hook, "lint")
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


@needs_linter
def test_the_linter_refuses_what_the_house_forbids(hook: ModuleType, sources: Path) -> None:
    long = "  list.push(0)\n" * 60
    for name, text in {
        "any.ts": "export const anything: any = 1\n",
        "unused.ts": "import { el } from './dom.ts'\n",
        "left.ts": "import type { Right } from './right.ts'\nexport type Left = Right | 1\n",
        "right.ts": "import type { Left } from './left.ts'\nexport type Right = Left | 2\n",
        "endless.ts": f"export function fill(list: number[]): void {{\n{long}}}\n",
    }.items():
        (sources / "src" / name).write_text(text)
    done = run_script(hook, "lint", sources)
    assert done.returncode
    for rule in (
        "noExplicitAny",
        "noUnusedImports",
        "noImportCycles",
        "noExcessiveLinesPerFunction",
    ):
        assert rule in done.stdout + done.stderr


@needs_linter
def test_a_text_that_makes_its_line_too_long_is_named(hook: ModuleType, sources: Path) -> None:
    (sources / "src" / "tale.ts").write_text(f"export const TALE =\n  '{'a ' * 60}'\n")
    done = run_script(hook, "lint", sources)
    assert done.returncode
    assert "tale.ts:2: 124 characters, at most 120" in done.stderr
