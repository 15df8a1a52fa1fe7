"""`agribot eval --data rows`, from the command line to its files."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from agribot.cli.main import main
from agribot.core.config import DEFAULT_MODEL
from agribot.core.messages import PlantClass
from agribot.lab.train.networks import read_card
from tests import nightly
from tests.lab.rows.drawn_rows import ColourNetwork, draw_field, draw_labels, write_rows

ROWS, WEEDS = (-1.0, 0.0, 1.0), (-0.5, 0.5)
KEYS = {"pictures", "on_rows", "between_rows", "balanced", "line"}
LINE_KEYS = {
    "found", "angle_deg_median", "angle_deg_p95", "offset_ratio_median", "angle_within_2_sigma",
    "offset_within_2_sigma",
}  # fmt: skip
DATA = Path(os.environ.get("AGRIBOT_DATA", "")) / "crdld-rows"
NEAR = 0.06  # between a fifth of the photographs and those of the card


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> None:
    use_network(monkeypatch, ColourNetwork())


def use_network(monkeypatch: pytest.MonkeyPatch, network: ColourNetwork) -> None:
    monkeypatch.setattr("agribot.lab.train.networks.open_network", lambda *_: network)


def write_field(folder: Path, names: tuple[str, ...] = ("1", "2")) -> Path:
    return write_rows(folder, {name: draw_field(ROWS, WEEDS) for name in names}, ROWS)


def result_of(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(capsys.readouterr().out.strip().splitlines()[-1])
    return found


def test_eval_of_rows_reports_what_stands_on_and_between_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], network: None
) -> None:
    assert main(["eval", str(write_field(tmp_path)), "--data", "rows", "--json"]) == 0
    result = result_of(capsys)
    assert result.keys() == KEYS
    assert result["line"].keys() == LINE_KEYS
    assert (result["pictures"], result["balanced"]) == (2, 1.0)
    assert result["line"]["found"] == 1.0
    assert result["line"]["angle_deg_p95"] < 1.0
    assert result["line"]["offset_ratio_median"] < 0.02


def test_eval_of_rows_pools_the_pixels_of_all_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    use_network(monkeypatch, ColourNetwork(weed=PlantClass.SOIL))
    pictures = {"1": draw_field(ROWS, WEEDS), "2": draw_field(ROWS)}
    folder = write_rows(tmp_path, pictures, ROWS)
    assert main(["eval", str(folder), "--data", "rows", "--json"]) == 0
    assert result_of(capsys)["balanced"] == 0.5


def test_eval_of_rows_tells_conditions_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], network: None
) -> None:
    folder = write_field(tmp_path, ("shadow_1", "sun_1", "sun_2"))
    assert main(["eval", str(folder), "--data", "rows", "--json"]) == 0
    conditions = result_of(capsys)["by_condition"]
    assert {name: one["pictures"] for name, one in conditions.items()} == {"shadow": 1, "sun": 2}


def test_eval_of_rows_draws_the_worst_pictures(tmp_path: Path, network: None) -> None:
    folder = write_field(tmp_path / "field")
    assert main(["eval", str(folder), "--data", "rows", "--out", str(tmp_path / "out")]) == 0
    details = json.loads((tmp_path / "out" / "eval.json").read_text(encoding="utf-8"))
    assert [one["picture"] for one in details["by_picture"]] == ["1.png", "2.png"]
    with Image.open(tmp_path / "out" / "worst.png") as sheet:
        assert sheet.width == 990


def test_labels_without_lines_are_left_out_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], network: None
) -> None:
    folder = write_field(tmp_path)
    Image.new("L", (256, 256)).save(folder / "labels" / "1.png")
    assert main(["eval", str(folder), "--data", "rows", "--json"]) == 1
    printed = capsys.readouterr()
    assert json.loads(printed.out.splitlines()[-1])["pictures"] == 1
    assert "1.png: shows no line" in printed.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere"], "nowhere is no folder"),
        (["bare"], "no pair of folders with images (images) and masks (labels)"),
        (["field", "--ids", "0=weed"], "leave it out with --data rows"),
        (["empty"], "no picture can be judged; the first problem"),
    ],
)
def test_eval_of_rows_refuses_what_shows_none(
    words: list[str],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    network: None,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_field(tmp_path / "field")
    (tmp_path / "bare").mkdir()
    empty = write_field(tmp_path / "empty", ("1",))
    draw_labels(()).save(empty / "labels" / "1.png")
    assert main(["eval", *words, "--data", "rows"]) == 2
    assert message in capsys.readouterr().err


@nightly.by_day("test_eval_of_rows_reports_what_stands_on_and_between_them")
@pytest.mark.skipif(not DATA.is_dir(), reason="AGRIBOT_DATA holds no crdld-rows")
def test_the_card_says_how_the_default_network_names_plants_on_photographed_rows(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["--data", "rows", "--folds", "5", "--fold", "0", "--json"]
    assert main(["eval", str(DATA), *words]) == 0
    result, stated = result_of(capsys), read_card(DEFAULT_MODEL)["rows"]
    assert result["pictures"] == 60
    assert result["balanced"] == pytest.approx(stated["balanced"], abs=NEAR)
    assert result["on_rows"] == pytest.approx(stated["on_rows"], abs=NEAR)
    assert result["between_rows"] == pytest.approx(stated["between_rows"], abs=2.0 * NEAR)
