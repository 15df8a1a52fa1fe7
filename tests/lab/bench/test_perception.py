from __future__ import annotations

import pytest

pytest.importorskip("onnx")

from agribot.lab.bench.perception import INT8, ORIGINAL, format_table, time_networks


def test_every_network_is_timed_against_the_original_of_the_same_run() -> None:
    result = time_networks(
        networks=("agribot-s", "agribot-s" + INT8), threads=1, frames=2, size_px=(64, 96)
    )
    rows = {row["network"]: row for row in result["networks"]}
    assert list(rows) == ["agribot-s", "agribot-s" + INT8, ORIGINAL]
    assert rows[ORIGINAL]["times_as_fast"] == 1.0
    for row in rows.values():
        assert row["times_as_fast"] == pytest.approx(rows[ORIGINAL]["cpu_ms"] / row["cpu_ms"])
        assert row["wall_ms"] >= row["wall_best_ms"] > 0.0
        assert f"{row['network']} " in format_table(result)
    assert (result["threads"], result["weights"]) == (1, "random")
