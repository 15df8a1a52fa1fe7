"""A robot that knows its row too little finds it, or says that it cannot."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from agribot.app.simulated_run import simulate
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import RunConfig, load
from agribot.core.world import WorldSpec
from agribot.description.worlds_sdf import load_run_world
from tests import nightly
from tests.mission.paper_camera import CameraOnPaper

SETTINGS = ["seed=1", "perception.enabled=false", "record.enabled=false", 'world="rows-10x12"',
            "sim.weed_density_per_m2=0", "field.row_count=2", "duration_s=90"]  # fmt: skip


@pytest.mark.parametrize(
    "off_m",
    [
        0.25,
        pytest.param(
            -0.25,
            marks=nightly.by_day(
                "test_put_down_on_a_mark_that_is_known_to_a_quarter_row_only_"
                "it_finds_its_row_by_the_camera"
            ),
        ),
    ],
)
def test_put_down_on_a_mark_that_is_known_to_a_quarter_row_only_it_finds_its_row_by_the_camera(
    off_m: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def shifted(settings: RunConfig) -> WorldSpec:
        place = {"spawn_xy_map_m": (-1.6, off_m), "spawn_yaw_map_rad": 0.0}
        return msgspec.structs.replace(load_run_world(settings), **place)

    monkeypatch.setattr("agribot.app.run_world.load_run_world", shifted)
    config = load("rows-10x12", [*SETTINGS, "field.start_std_m=0.29", "field.start_map_m=[-1.6,0]"])
    with simulate(config, tmp_path / "run") as session:
        session.stack.perception = CameraOnPaper(session, lay_rows(session.config.field))
        for _ in session.ticks():
            truth = session.simulator.truth()
            if truth.x_map_m > 4.0:
                break
        report = session.finish()
    assert truth.x_map_m > 4.0, report.reason
    assert abs(truth.y_map_m) < 0.05
    assert report.tracking.plants_crushed == 0
