"""Several runs of one job as one, from what they left on the disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from agribot.app.whole_job import RECORDING, series_of
from agribot.core.config import load
from agribot.record.recorder import RunRecorder
from agribot.record.report import RunOfJob
from agribot.record.series import SeriesTap
from tests.record import record_samples as samples


def test_what_a_killed_run_recorded_after_its_last_account_is_in_no_part_of_the_series(
    tmp_path: Path,
) -> None:
    records = samples.ticks(100, seed=4)
    folder, taken_over_s = tmp_path / "first", records[60].batch.t_s
    recorder = RunRecorder(folder / RECORDING, load("farm"), samples.robot(), samples.URDF)
    own = SeriesTap()
    for record in records:
        t_s = record.batch.t_s
        recorder.truth(t_s, (t_s, 0.0, 0.0))
        recorder(record)
        own(record)
        own.truth(t_s, (taken_over_s + t_s, 0.0, 0.0))
    recorder.close()
    earlier = (RunOfJob(folder=str(folder), run_s=taken_over_s),)
    series, lost = series_of(earlier, own.series(), tmp_path)
    assert lost == []
    assert len(series.t_s) == len(series.truth) == 61 + 100
    assert np.all(np.diff(series.t_s) >= 0.0)
    assert np.all(np.diff(series.truth[:, 0]) >= 0.0)
    assert np.allclose(series.truth[:, 1], series.truth[:, 0])
