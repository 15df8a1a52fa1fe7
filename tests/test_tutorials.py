"""The pages for contributors: their files, written and registered as they say, do what they say."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from agribot.autonomy.estimate.corrections import CORRECTIONS
from agribot.cli.main import COMMANDS
from agribot.core import platforms
from agribot.core.implement import kind as implements
from agribot.drivers.line import schemes

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    page for page in (ROOT / "docs" / "contribute").glob("*.md") if page.stem != "plugins"
)
TABLES = (platforms._KINDS, schemes._KINDS, implements._registered, CORRECTIONS, COMMANDS)
MARKS = {
    name: pytest.mark.slow for name in ("platform", "screen", "source", "tool")
}  # a drive of some seconds
_FILE = re.compile(r"^```\w+ file=(\S+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def files_of(page: Path) -> dict[str, str]:
    """Name -> text of the files that a page asks to be written."""
    return dict(_FILE.findall(page.read_text(encoding="utf-8")))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A place for the files of a page; what they register is forgotten afterwards."""
    before = [dict(table) for table in TABLES]
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for table, kept in zip(TABLES, before, strict=True):
        table.clear()  # type: ignore[attr-defined]
        table.update(kept)  # type: ignore[attr-defined]
    for name in [*sys.modules]:
        if Path(getattr(sys.modules[name], "__file__", None) or "").parent == tmp_path:
            del sys.modules[name]


def test_every_page_brings_one_file_and_a_test_of_it() -> None:
    assert {page.stem for page in PAGES} >= {
        "command", "correction", "platform", "screen", "source", "tool",
    }  # fmt: skip
    for page in PAGES:
        modules = [name for name in files_of(page) if name.endswith(".py")]
        assert len(modules) == 2 and modules[1] == f"test_{modules[0]}", page.name


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, id=page.stem, marks=MARKS.get(page.stem, ())) for page in PAGES],
)
def test_a_page_keeps_its_promise(
    page: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = files_of(page)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    module = import_module(next(Path(name).stem for name in files if name.startswith("test_")))
    tests = [value for name, value in vars(module).items() if name.startswith("test_")]
    assert tests
    for test in tests:
        out = folder / test.__name__
        out.mkdir()
        given = {"tmp_path": out, "capsys": capsys}
        test(**{name: given[name] for name in inspect.signature(test).parameters})


@pytest.mark.slow
def test_the_readme_drives_the_robot_from_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    shorter = block.replace("duration_s=30", "duration_s=0.2")
    assert shorter != block
    monkeypatch.chdir(tmp_path)
    exec(compile(shorter, "README.md", "exec"), {})
    assert len(capsys.readouterr().out.splitlines()) >= 10
    assert (tmp_path / "runs" / "mine" / "report.json").is_file()
