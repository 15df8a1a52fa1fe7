"""A package from outside brings sources, corrections, witnesses, facts, faults, tools and more."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from agribot.autonomy.estimate.corrections import load_corrections
from agribot.cli.main import main
from agribot.core import plugins
from agribot.core.config import load
from agribot.core.errors import ConfigError
from agribot.core.fact_text import render
from agribot.core.implement.kind import find_spec_type
from agribot.record.replay import read_ticks as read_recording
from agribot.ui.panels import Panels
from agribot.ui.view import list_doubts
from tests.test_tutorials import files_of

PAGES = Path(__file__).parents[1] / "docs" / "contribute"
# Where the robot of the farm starts, seen from a beacon 10 m to the East.
RANGES = "".join(f"{0.1 * k:.1f} 8.0 0.0 {12.0 if k == 24 else 10.0}\n" for k in range(40))


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the package of the page with pip, and a tool beside it, into a folder of its own."""
    source, target = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("site")
    files = files_of(PAGES / "plugins.md") | files_of(PAGES / "tool.md")
    project = files["pyproject.toml"].replace("include = [", 'include = ["my_brush.py", ')
    tool = '\n[project.entry-points."agribot.implements"]\nbrush = "my_brush:BRUSH"\n'
    for name, text in (files | {"pyproject.toml": project + tool}).items():
        (source / name).write_text(text, encoding="utf-8")
    words = ["install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    words += ["--disable-pip-version-check", "--target", str(target), str(source)]
    subprocess.run([sys.executable, "-m", "pip", *words], check=True)
    return target


@pytest.fixture
def here(installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Let this process find what is installed; the folder is that of the test."""
    monkeypatch.syspath_prepend(installed)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ranges.txt").write_text(RANGES)
    _forget()
    yield tmp_path
    _forget()


def _forget() -> None:
    for name in ("my_beacons", "my_beacon_command", "my_brush"):
        sys.modules.pop(name, None)


Output = pytest.CaptureFixture[str]


@pytest.mark.usefixtures("here")
def test_what_is_installed_is_listed_with_its_package(capsys: Output) -> None:
    assert main(["plugins", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out.splitlines()[-1])["plugins"]
    assert {(row["group"], row["name"], row["package"], row["error"]) for row in rows} == {
        (f"agribot.{group}", name, "agribot-beacons", "")
        for group, name in (
            ("sources", "beacons"), ("corrections", "beacon"), ("witnesses", "beacon"),
            ("facts", "beacon"), ("faults", "beacon.jams"),
            ("panels", "beacons"), ("commands", "beacons"), ("implements", "brush"),
        )
    }  # fmt: skip
    assert [row["name"] for row in rows if row["has_settings"]] == ["beacon"]


@pytest.mark.usefixtures("here")
def test_its_command_is_one_of_the_program(capsys: Output) -> None:
    assert main(["beacons", "ranges.txt"]) == 0
    assert capsys.readouterr().out == "40 ranges\n"
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "count the ranges in a file of beacons" in capsys.readouterr().out


def test_the_robot_corrects_its_pose_by_it_with_its_settings_and_faults(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    words = ["--set", "perception.enabled=false", "--for", "4.5", "--speed", "max", "--headless"]
    words += ["--source", f"others=beacons:{here}/ranges.txt"]
    words += ["--fault", "beacon.jams@3", "--set", "plugins.beacon.std_m=0.02"]
    main(["run", "farm", *words, "--out", "run"])
    assert "[plugins.beacon]\nstd_m = 0.02" in (here / "run" / "config.toml").read_text()
    assert "beacon.jams@3 begins" in (here / "run" / "events.jsonl").read_text()
    recording = list(read_recording(here / "run" / "run.mcap"))
    assert len([sample for tick in recording for sample in tick.batch.others]) > 25
    accused = [tick for tick in recording if "beacon" in tick.estimate.verdicts]
    assert accused[0].batch.t_s == pytest.approx(2.4, abs=0.1)
    assert accused[-1].batch.t_s == pytest.approx(4.4, abs=0.1)
    fact = accused[0].estimate.verdicts["beacon"].fact
    assert fact is not None
    assert fact.parts == ("beacon",)
    assert fact.numbers == {"off_m": pytest.approx(2.0, abs=0.2)}
    assert render(fact) == "beacon range is off by 2.0 m; check the beacon"
    assert render(fact, "de") == "Entfernung zur Bake falsch: 2,0 m; Bake prüfen"
    assert render(fact, "hi") == render(fact)
    (noticed,) = json.loads((here / "run" / "report.json").read_text())["safety"]["noticed"]
    assert (noticed["code"], noticed["parts"]) == ("beacon.range_off", ["beacon"])
    assert [doubt.sensor for doubt in list_doubts(accused[0].estimate.verdicts)] == ["beacon"]
    fixes_s = [fix.t_s for tick in recording for fix in tick.batch.gnss]
    assert len(fixes_s) > 10
    assert max(fixes_s) < 3.0
    assert main(["replay", "--check", "run/run.mcap"]) == 0
    capsys.readouterr()
    monkeypatch.undo()
    _forget()
    assert main(["replay", "--check", str(here / "run" / "run.mcap")]) == 2
    assert "no plugin 'beacon' is installed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("plugins.beacon.std_m=-1", "plugins.beacon"),
        ("plugins.beacon.range_m=1", "known here: std_m"),
        ("plugins.radar.std_m=1", "no plugin 'radar' is installed"),
        ("plugins.brush.depth_m=1", "the plugin has no settings"),
    ],
)
def test_a_setting_that_it_lacks_is_refused_before_anything_moves(
    setting: str, words: str, here: Path, capsys: Output
) -> None:
    assert main(["run", "farm", "--set", setting, "--out", "run"]) == 2
    assert words in capsys.readouterr().err
    assert not (here / "run").exists()


def test_its_tool_and_its_panels_are_found_by_name(here: Path) -> None:
    assert here
    assert find_spec_type("brush") is not None
    panels = Panels()
    for _, add_panels in plugins.iterate_plugins(plugins.PANELS):
        add_panels(panels, None)
    assert [info.title for info in panels.infos()] == ["Count the beacons"]


def test_a_correction_that_cannot_be_imported_is_named_before_anything_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    info = tmp_path / "broken-2.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 2.1\n")
    (info / "entry_points.txt").write_text("[agribot.corrections]\nradar = no_such_module:Radar\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert main(["plugins"]) == 1
    assert "'radar' of broken 2.1" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="No module named 'no_such_module'; update or uninstall"):
        load("farm")


def test_a_correction_that_has_the_name_of_the_robots_own_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "other-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: other\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[agribot.corrections]\ngnss = builtins:print\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match="'gnss' has the name of a registered one; rename it"):
        load_corrections({"gnss": {}})
