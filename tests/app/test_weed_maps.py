"""The weed map of a run: from its folder, its recording, or the job of a run that was cut off."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.app.run_recording import EARLIER_ATTACHMENT
from agribot.app.simulated_run import simulate
from agribot.app.weed_maps import open_map
from agribot.app.whole_job import FILE_NAME, JobSoFar
from agribot.autonomy.weeds.merge import merge_maps
from agribot.autonomy.weeds.plant_table import OUTCOMES
from agribot.autonomy.weeds.track import Track
from agribot.core import config
from agribot.core.errors import RecordingError
from agribot.record.mcap_file import read_attachment

QUICK = ["duration_s=0.4", "perception.enabled=false"]


def track(id: int, x_map_m: float, treated_s: float | None = None) -> Track:
    return Track(
        id=id, x_map_m=x_map_m, y_map_m=2.0, own_var_m2=1e-4, xx_m2=1e-4, xy_m2=0.0, yy_m2=1e-4,
        weed_logit=3.0, exists_logit=5.0, area_m2=1e-3, sightings=9, first_seen_s=0.1,
        last_seen_s=0.2, treated_s=treated_s, is_confirmed=True,
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with two weeds on its map, one of them treated."""
    out = tmp_path_factory.mktemp("runs") / "first"
    with simulate(config.load("farm", QUICK), out) as session:
        session.weed_map.restore([track(1, 3.0), track(2, 4.0, treated_s=0.3)])
        for _ in session.ticks():
            pass
        session.finish()
    return out


def test_a_run_and_its_recording_have_the_same_map(folder: Path) -> None:
    from_file, from_recording = open_map(str(folder)), open_map(str(folder / "run.mcap"))
    assert from_file.maps == from_recording.maps == ("first",)
    assert [OUTCOMES[code] for code in from_file.rows["outcome"]] == ["missed", "treated"]
    assert merge_maps([from_file, from_recording]).rows.tobytes() == from_file.rows.tobytes()


def test_a_run_that_was_cut_off_has_its_map_in_its_job(folder: Path, tmp_path: Path) -> None:
    whole, cut = open_map(str(folder)), tmp_path / "first"
    cut.mkdir()
    for name in ("run.mcap", FILE_NAME):
        (cut / name).write_bytes((folder / name).read_bytes())
    found = open_map(str(cut))
    assert np.array_equal(found.rows["id"], whole.rows["id"])
    assert np.allclose(found.xy_m, whole.xy_m, atol=1e-4)
    assert found.maps == whole.maps  # so that merging with the run that went on counts it once


def test_a_run_that_goes_on_leaves_a_map_of_the_same_name(folder: Path) -> None:
    job = msgspec.json.decode((folder / FILE_NAME).read_bytes(), type=JobSoFar)
    assert Path(job.runs[0].folder).name == "first"
    out = folder.with_name("second")
    with simulate(config.load("farm", QUICK), out, earlier=job) as session:
        for _ in session.ticks():
            pass
        session.finish()
    first, second = open_map(str(folder)), open_map(str(out))
    assert second.maps == ("first",)
    assert second.rows["id"].tolist() == [1, 2]
    assert len(merge_maps([first, second]).rows) == 2
    assert json.loads(read_attachment(out / "run.mcap", EARLIER_ATTACHMENT))


def test_a_folder_without_a_map_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"holds no weed map: neither weeds.geojson nor"):
        open_map(str(tmp_path))
    with pytest.raises(RecordingError, match="write NAME=PATH"):
        open_map(f"={tmp_path}")
