"""A mission that does damage says so: what was crushed by what, and who was touched."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import agribot
from agribot.app.rerun import compare_passes, read_pass, rerun
from agribot.app.simulated_run import SimulatedRun
from agribot.description.loader import export_urdf
from agribot.record.events import read_events
from agribot.record.map_figure import draw_map
from agribot.record.report import Report, read_report
from tests.mission.conftest import start_before_a_row

QUICK = ("sim.sensors=rtk", "perception.enabled=false", "record.enabled=false", "seed=1")
# 28 cm under it the robot stands on the ground: 6 cm are left.
PLATE = (
    '<collision><origin xyz="0 0 -0.21"/><geometry><box size="0.5 0.5 0.02"/></geometry>'
    "</collision></link>"
)
WORKER = """<actor name="worker"><agribot:kind>person_walking</agribot:kind><script>
<loop>false</loop><trajectory id="0" type="walk">{points}</trajectory></script></actor>
"""


def _run(settings: agribot.RunConfig, out: Path) -> tuple[Report, SimulatedRun]:
    with agribot.simulate(settings, out) as run:
        for _ in run.ticks():
            pass
        report = run.finish()
    assert read_report(out / "report.json") == report
    return report, run


def test_a_robot_with_a_low_belly_reports_the_row_that_it_drove_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = export_urdf("agribot")
    start = text.index('<link name="base_link"')
    end = text.index("</link>", start)
    low = tmp_path / "low.urdf"
    low.write_text(text[:end] + PLATE + text[end + len("</link>") :])
    settings = agribot.load(
        "farm", [*QUICK, f"robot={low}", "field.row_count=1", *start_before_a_row(monkeypatch)]
    )
    report, run = _run(settings, tmp_path / "run")
    by = report.tracking.plants_crushed_by
    assert (by.wheel, by.belly, by.implement) == (0, 6, 0)
    assert report.tracking.plants_crushed == 6 and not report.ok
    assert report.reason == "1 of 1 rows, but 6 crop plants were crushed by the belly"
    told = [
        event for event in read_events(tmp_path / "run" / "events.jsonl") if event.kind == "truth"
    ]
    assert len(told) == 6 and all("crushed by the belly" in event.reason for event in told)
    assert run._data().crushed == tuple(sorted(run.simulator.crushed))
    (axes,) = draw_map(run._data()).axes
    (crosses,) = [line for line in axes.lines if line.get_label() == "crushed crop"]
    assert len(np.asarray(crosses.get_xdata())) == 6
    assert not run.simulator.plants.is_standing[list(run.simulator.crushed)].any()


def _visit(folder: Path, *places: str) -> Path:
    """Make a farm in which a worker walks from place to place, and stays at the last."""
    from agribot.description.sdf_export import write_world
    from agribot.description.worlds_sdf import load_world

    world = folder / "farm.world"
    write_world(load_world("Farm"), world)
    points = "".join(
        f"<waypoint><time>{5 * k}</time><pose>{place} 0 0 0 -1.57</pose></waypoint>"
        for k, place in enumerate(places)
    )
    worker = WORKER.format(points=points)
    world.write_text(world.read_text().replace("</world>", f"{worker}</world>"))
    return world


def test_a_robot_with_a_lidar_waits_for_a_person_asks_and_replays_the_same(tmp_path: Path) -> None:
    world = _visit(tmp_path, "4 3", "1 3")
    settings = agribot.load("farm", [
        *QUICK, f"world={world}", "duration_s=36", "sim.lidar=true", "record.enabled=true",
        "mission.stall_timeout_s=5",
    ])  # fmt: skip
    report, _ = _run(settings, tmp_path / "run")
    nearest_m = report.safety.person_distance_min_m
    assert nearest_m is not None and 1.5 < nearest_m < 2.5
    (stop,) = report.safety.stops
    assert stop.code == "obstacle_in_way" and 1.8 < stop.numbers["way_m"] < 2.0
    assert report.safety.waits_for_obstacles == 1
    (asked,) = report.safety.interventions
    assert (asked.code, asked.numbers["waited_s"]) == ("obstacle_stays", 5.0)
    path = tmp_path / "run" / "run.mcap"
    again, _ = rerun(path, agribot.load(str(tmp_path / "run" / "config.toml")))
    assert compare_passes(read_pass(path), again).first is None


def test_a_mission_with_a_person_in_its_way_tells_how_near_it_came(tmp_path: Path) -> None:
    world = _visit(tmp_path, "-2 6", "-2 1")
    settings = agribot.load("farm", [*QUICK, f"world={world}", "duration_s=20"])
    report, _ = _run(settings, tmp_path / "run")
    assert report.safety.person_distance_min_m == 0.0
    told = [e.reason for e in read_events(tmp_path / "run" / "events.jsonl") if e.kind == "truth"]
    assert told[0] == "touched the person 'worker'"
    assert report.safety.stops, "the bumper must stop the robot"


def test_a_real_robot_knows_nothing_of_it() -> None:
    report = Report(profile="x", seed=0, sensors="rtk", version="0", ok=False, reason="")
    assert (
        report.tracking.plants_brushed is None and report.tracking.plants_crushed_by.belly is None
    )
    assert report.safety.person_distance_min_m is None
