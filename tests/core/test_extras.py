"""How an extra is installed: from where the program came, since no index has it."""

from __future__ import annotations

import importlib.metadata
import json
import re
import shlex
import subprocess
import tomllib
from pathlib import Path

import pytest

from agribot.core import extras
from agribot.core.errors import ConfigError

ROOT = Path(__file__).parents[2]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]


class Installed:
    """A distribution that pip installed from a URL."""

    def __init__(self, told: str | None) -> None:
        self.told = told

    def read_text(self, name: str) -> str | None:
        assert name == "direct_url.json"
        return self.told


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Installed:
    here = Installed(None)
    monkeypatch.setattr(importlib.metadata, "distribution", lambda _: here)
    lines = ["eclipse-zenoh>=1.5; extra == 'ros'", "xxhash; extra == 'ros'", "numpy>=1.26"]
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: lines)
    return here


def told(path: Path, **more: object) -> str:
    return json.dumps({"url": path.as_uri(), **more})


def test_a_clone_is_named_with_the_extra(installed: Installed, tmp_path: Path) -> None:
    installed.told = told(tmp_path, dir_info={"editable": True})
    assert extras.format_install("ros") == f"pip install -e '{tmp_path}[ros]'"


def test_in_the_clone_a_point_is_enough(
    installed: Installed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed.told = told(tmp_path, dir_info={"editable": True})
    monkeypatch.chdir(tmp_path)
    assert extras.format_install("ros") == "pip install -e '.[ros]'"
    assert extras.format_install("") == "pip install -e ."


def test_a_wheel_is_named_with_the_extra(installed: Installed, tmp_path: Path) -> None:
    wheel = tmp_path / "my robot" / "agribot-0.1.0-py3-none-any.whl"
    wheel.parent.mkdir()
    wheel.touch()
    installed.told = told(wheel, archive_info={})
    command = extras.format_install("ros")
    assert shlex.split(command) == ["pip", "install", f"{wheel}[ros]"]


@pytest.mark.parametrize("source", [None, "", "{", '{"url": "file:///nowhere/agribot.whl"}'])
def test_where_the_source_is_not_known_the_packages_are_named(
    installed: Installed, source: str | None
) -> None:
    installed.told = source
    assert extras.format_install("ros") == "pip install 'eclipse-zenoh>=1.5' xxhash"


def test_a_program_that_is_not_installed_is_installed_from_its_folder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(_: str) -> None:
        raise importlib.metadata.PackageNotFoundError

    monkeypatch.setattr(importlib.metadata, "distribution", refuse)
    monkeypatch.setattr(importlib.metadata, "requires", refuse)
    assert extras.format_install("ros") == "pip install -e '.[ros]' in its folder"


def test_a_refusal_names_the_command(
    installed: Installed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed.told = told(tmp_path)
    monkeypatch.setattr(extras, "_is_installed", lambda _: False)
    with pytest.raises(ConfigError) as refused:
        extras.require("ros", "--ros2")
    assert str(refused.value) == (
        f"--ros2 needs eclipse-zenoh, xxhash; pip install '{tmp_path}[ros]'"
    )


def list_texts() -> list[tuple[str, str]]:
    """All files that a reader may take a command from."""
    listed = subprocess.run(
        ["git", "ls-files", "*.md", "*.py", "*.toml", "*.sh", "web/src"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    names = [name for name in listed.stdout.split() if name != "CHANGELOG.md"]
    return [(name, (ROOT / name).read_text(encoding="utf-8")) for name in names]


def test_no_text_takes_the_program_from_an_index() -> None:
    """No index has it: the first to register the name owns what the reader installs."""
    bad = re.compile(r"pip install (?:-\S+ )*['\"]?agri" r"bot\b")
    assert not [name for name, text in list_texts() if bad.search(text)]


def test_every_extra_that_a_text_names_exists() -> None:
    named = {
        (name, extra)
        for name, text in list_texts()
        for group in re.findall(r"'\.\[([\w,]+)\]'", text)
        for extra in group.split(",")
    }
    assert len(named) > 5
    assert not {one for one in named if one[1] not in EXTRAS}


def test_every_extra_that_the_code_names_exists() -> None:
    called = re.compile(r"(?:format_install|extras\.(?:require|has))\(\s*['\"](\w+)['\"]")
    named = {
        (name, extra)
        for name, text in list_texts()
        if name.startswith("src/")
        for extra in called.findall(text)
    }
    assert len(named) > 15
    assert not {one for one in named if one[1] not in EXTRAS}
