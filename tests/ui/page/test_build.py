"""The page is built when it has to be, and installing never fails for want of it."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[3]


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


def test_the_page_type_checks_and_its_pure_parts_pass_their_tests(hook: ModuleType) -> None:
    npm, environment = hook.npm_command()
    done = subprocess.run(
        [*npm, "run", "--silent", "check"],
        cwd=ROOT / "web",
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert "# fail 0" in done.stdout
