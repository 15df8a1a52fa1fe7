"""A new weeding tool is one file and a registration; this is such a file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import msgspec
import numpy as np
import pytest

import agribot
from agribot.app.simulated_run import simulate
from agribot.core.config import Positive, TreatmentConfig, load
from agribot.core.errors import DescriptionError, PlatformError
from agribot.core.implement import kind as kinds
from agribot.core.implement.kind import ImplementKind, Pull, ReportLine, register_implement
from agribot.core.implement.plants import PlantMap
from agribot.core.implement.spec import ImplementSpec, StateLine
from agribot.core.messages import Estimate, FloatArray, ImplementCommand
from agribot.core.world import WorldSpec
from agribot.description.loader import export_urdf, load_robot
from agribot.record.page import render_report
from agribot.record.replay import read_ticks


class BrushSpec(ImplementSpec, frozen=True, kw_only=True):
    """One brush across the robot that turns at `turns_hz` while it works."""

    kind: ClassVar[str] = "brush"
    sections: ClassVar[str] = "brushes"
    verb: ClassVar[str] = "brushed"
    works_backwards: ClassVar[bool] = False

    turns_hz: Positive = 3.0

    def describe(self, command: ImplementCommand) -> tuple[StateLine, ...]:
        return (StateLine("Brush", "turns" if command.is_on else "stands"),)


class Brush:
    """Turns where it is allowed to."""

    def __init__(self, spec: BrushSpec, config: TreatmentConfig) -> None:
        self._spec, self._ticks = spec, 0

    def step(self, estimate: Estimate, plants: PlantMap, *, may_work: bool) -> ImplementCommand:
        self._ticks += may_work
        setpoints = {"turns_hz": self._spec.turns_hz} if may_work else {}
        return ImplementCommand(sections_on=(may_work,), setpoints=setpoints)

    def report(self) -> tuple[ReportLine, ...]:
        return (ReportLine("ticks brushed", self._ticks),)


class OtherBrush(Brush):
    """Another mind for the same brush."""


class BrushEffect:
    """Brushes away what comes under its middle."""

    def __init__(self, spec: BrushSpec, world: WorldSpec, base_height_m: float) -> None:
        self._spec, self._is_on = spec, False
        self._plants_m = np.array([(p.x_map_m, p.y_map_m) for p in world.plants]).reshape(-1, 2)
        self.treated: dict[int, float] = {}
        self.worked_m2 = 0.0

    def command(self, t_s: float, command: ImplementCommand) -> None:
        if len(command.sections_on) > 1:
            raise PlatformError("a brush is one section")
        self._is_on = command.is_on and command.setpoints["turns_hz"] == self._spec.turns_hz

    def update(self, t_s: float, before: FloatArray, after: FloatArray, dt_s: float) -> None:
        if self._is_on:
            self.worked_m2 += self._spec.width_m * float(np.hypot(*(after - before)[:2]))
            gaps_m = np.hypot(*(self._plants_m - after[:2]).T)
            for index in np.flatnonzero(gaps_m < self._spec.width_m / 2.0):
                self.treated.setdefault(int(index), t_s)

    def pull(self) -> Pull | None:
        return None


BRUSH = ImplementKind(BrushSpec, Brush, BrushEffect)
TAGS = """
<brush>
  <x_body_m>-0.2</x_body_m>
  <section_count>1</section_count>
  <section_spacing_m>0.5</section_spacing_m>
  <section_width_m>0.4</section_width_m>
  <latency_s>0</latency_s>
</brush>
"""


@pytest.fixture(autouse=True)
def _own_register(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kinds, "_registered", {})


@pytest.fixture
def sweeper(tmp_path: Path) -> Iterator[str]:
    """The packaged robot with a brush instead of its boom."""
    head, _, rest = export_urdf().partition("<sprayer>")
    path = tmp_path / "sweeper.urdf"
    path.write_text(head + TAGS.strip() + rest.partition("</sprayer>")[2], encoding="utf-8")
    yield str(path)


def test_a_brush_from_one_file_and_a_registration_works_through_a_run_to_its_report(
    sweeper: str, tmp_path: Path
) -> None:
    register_implement(BRUSH)
    settings = load(
        "farm", [f"robot={sweeper}", "perception.enabled=false", "duration_s=28", "seed=1"]
    )
    with simulate(settings, tmp_path / "run") as run:
        for _ in run.ticks():
            pass
        report = run.finish()
        page = render_report(report, run._data())
    assert report.implement is not None
    assert (report.implement.kind, report.implement.verb) == ("brush", "brushed")
    assert report.implement.width_m == pytest.approx(0.5)
    told = json.loads((tmp_path / "run" / "report.json").read_text())["implement"]
    assert told["worked_m2"] > 0.5
    assert told["lines"][0]["name"] == "ticks brushed" and told["lines"][0]["value"] > 100
    assert "Brush: ticks brushed" in page
    ticks = list(read_ticks(tmp_path / "run" / "run.mcap"))
    working = [tick for tick in ticks if tick.command.implement.is_on]
    assert working and all(tick.command.drive.v_mps > 0.0 for tick in working)
    assert all(tick.command.implement.setpoints == {"turns_hz": 3.0} for tick in working)
    assert run.simulator.treated


def test_its_numbers_come_from_the_robots_description(sweeper: str) -> None:
    register_implement(BRUSH)
    brush = load_robot(sweeper).implement
    assert brush == BrushSpec(
        x_body_m=-0.2, section_count=1, section_spacing_m=0.5, section_width_m=0.4, latency_s=0.0
    )
    assert load_robot(sweeper).tool_x_m == -0.2


def test_a_kind_that_nobody_registered_is_told_and_left_out(sweeper: str) -> None:
    robot = load_robot(sweeper)
    assert robot.implement is None
    assert any("<brush> is unknown" in warning for warning in robot.warnings)


def test_an_installed_package_brings_its_kind_by_an_entry_point(
    sweeper: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    metadata = tmp_path / "site" / "my_brush-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: my-brush\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[agribot.implements]\nbrush = {__name__}:BRUSH\n")
    monkeypatch.syspath_prepend(tmp_path / "site")
    assert isinstance(load_robot(sweeper).implement, BrushSpec)


def test_a_second_kind_of_the_same_name_is_refused() -> None:
    register_implement(BRUSH)
    register_implement(BRUSH)
    with pytest.raises(DescriptionError, match="'brush' already"):
        register_implement(BRUSH._replace(control=OtherBrush))

    class Boom(BrushSpec, frozen=True, kw_only=True):
        kind: ClassVar[str] = "sprayer"

    with pytest.raises(DescriptionError, match="'sprayer' already"):
        register_implement(BRUSH._replace(spec=Boom))


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("<section_count>1</section_count>", "<section_count>0</section_count>", "section_count"),
        ("<section_count>1</section_count>", "<section_count>1.5</section_count>", "int"),
        ("<latency_s>0</latency_s>", "", "<latency_s> is missing"),
        ("</brush>", "</brush><sprayer><x_body_m>0</x_body_m></sprayer>", "is missing"),
    ],
)
def test_a_description_that_does_not_fit_is_refused_with_the_place(
    sweeper: str, old: str, new: str, problem: str
) -> None:
    register_implement(BRUSH)
    path = Path(sweeper)
    path.write_text(path.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with pytest.raises(DescriptionError, match=problem):
        load_robot(sweeper)


def test_two_implements_on_one_robot_are_refused(tmp_path: Path) -> None:
    register_implement(BRUSH)
    path = tmp_path / "both.urdf"
    path.write_text(export_urdf().replace("<sprayer>", TAGS + "<sprayer>"), encoding="utf-8")
    with pytest.raises(DescriptionError, match="2 implements"):
        load_robot(str(path))


def test_the_seam_is_part_of_the_public_api() -> None:
    assert agribot.register_implement is register_implement
    assert agribot.ImplementKind is ImplementKind
    assert msgspec.structs.fields(agribot.ImplementSpec)[0].name == "x_body_m"
