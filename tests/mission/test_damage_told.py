"""A mission that does damage says so: what was crushed by what, and who was touched."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import agribot
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
<loop>false</loop><trajectory id="0" type="walk">
<waypoint><time>0</time><pose>-2 6 0 0 0 -1.57</pose></waypoint>
<waypoint><time>5</time><pose>-2 1 0 0 0 -1.57</pose></waypoint></trajectory></script></actor>
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


def test_a_mission_with_a_person_in_its_way_tells_how_near_it_came(tmp_path: Path) -> None:
    from agribot.description.sdf_export import write_world
    from agribot.description.worlds_sdf import load_world

    world = tmp_path / "farm.world"
    write_world(load_world("Farm"), world)
    text = world.read_text()
    world.write_text(text.replace("</world>", WORKER + "</world>"))
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
