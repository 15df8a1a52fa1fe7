from __future__ import annotations

import json

import pytest

pytest.importorskip("onnx")

from agribot.cli.main import main
from agribot.lab.bench.perception import INT8, ORIGINAL, format_table


def test_every_network_is_timed_against_the_original_of_the_same_run(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["bench", "perception", "--networks", f"agribot-s,agribot-s{INT8}"]
    words += ["--size", "96x64", "--threads", "1", "--frames", "2", "--json"]
    assert main(words) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (result["width_px"], result["height_px"]) == (96, 64)
    rows = {row["network"]: row for row in result["networks"]}
    assert list(rows) == ["agribot-s", "agribot-s" + INT8, ORIGINAL]
    assert rows[ORIGINAL]["times_as_fast"] == 1.0
    for row in rows.values():
        assert row["times_as_fast"] == pytest.approx(rows[ORIGINAL]["cpu_ms"] / row["cpu_ms"])
        assert row["wall_ms"] >= row["wall_best_ms"] > 0.0
        assert f"{row['network']} " in format_table(result)
    assert (result["threads"], result["weights"]) == (1, "random")
