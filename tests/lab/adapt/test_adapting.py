"""`agribot adapt` goes from pictures with rows to weights, and says what that brought."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("torch")

from agribot.autonomy.perceive.segmenter import Segmenter, model_path
from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.lab.adapt import adapting, field_training
from agribot.lab.adapt.field_training import Budget, choose_size_px
from agribot.lab.train.start import recognise_architecture
from tests.lab.adapt.test_row_teacher import write_photographs

BASE = "agribot-sim"


@pytest.fixture(autouse=True)
def small_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(field_training, "BATCH_SIZE", 2)
    monkeypatch.setattr(field_training, "CROP_PX", 64)
    monkeypatch.setattr(field_training, "CHECKPOINT_EVERY", 1)


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    folder = tmp_path / "photos"
    folder.mkdir()
    write_photographs(folder, 8, has_rows=True)
    return folder


def test_pictures_are_known_by_any_path_to_them_until_one_changes(
    photos: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(photos.parent)
    before = adapting._digest(photos)
    assert adapting._digest(Path("photos")) == before
    (photos / "0.png").write_bytes(b"another")
    assert adapting._digest(photos) != before


def adapt(photos: Path, out: Path, *budget: str) -> int:
    words = ["adapt", str(photos), "-o", str(out), "--model", BASE, "--json"]
    return main([*words, *(budget or ("--steps", "2"))])


def test_photographs_become_weights_with_figures_and_pictures_of_before_and_after(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "field.onnx"
    assert adapt(photos, out) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (result["pictures"], result["rows_seen"], result["steps"]) == (8, 8, 2)
    assert result["before"]["pictures"] == result["after"]["pictures"] == 1
    for figures in (result["before"], result["after"]):
        assert sum(figures["on_rows"].values()) == pytest.approx(1.0)
    assert 0.0 < result["cpu_s"] < 600.0
    with Image.open(result["sheet"]) as sheet:
        assert sheet.width == 3 * 360
    answer = Segmenter(out).segment(np.zeros((96, 128, 3), np.uint8))
    assert answer.class_id.shape == (96, 128)


def test_an_adaptation_that_was_stopped_goes_on_to_the_same_weights(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, stopped = tmp_path / "whole.onnx", tmp_path / "stopped.onnx"
    assert adapt(photos, whole) == 0

    def stop_at_first_step(text: str) -> None:
        if text.startswith("step 1/2"):
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("agribot.cli.data.adapt._print_line", stop_at_first_step)
        assert adapt(photos, stopped) == 130
    assert not stopped.exists()
    monkeypatch.setattr(adapting, "see_rows", None)  # its rows are seen already
    assert (
        adapt(photos, stopped, "--minutes", "0.01") == 0
    )  # the steps stay those of the first call
    assert stopped.read_bytes() == whole.read_bytes()


def test_pictures_without_rows_end_with_2_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    write_photographs(photos, 8, has_rows=False)
    assert adapt(photos, tmp_path / "field.onnx") == 2
    assert "agribot adapt: no rows to be seen" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["photos"]


def test_the_folder_of_another_adaptation_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "field-adapt"
    folder.mkdir()
    (folder / "taught.json").write_text('{"source": "/elsewhere", "files": "0", "base": "0"}')
    assert adapt(tmp_path, tmp_path / "field.onnx") == 2
    assert "holds an adaptation to /elsewhere" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--minutes", "0"], "--minutes 0: out of range; give more than 0"),
        (["--threads", "0"], "--threads 0: out of range; give at least 1"),
        (["-o", "field.txt"], "give a name that ends with .onnx"),
    ],
)
def test_options_out_of_range_are_refused_with_the_limit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], reason: str
) -> None:
    assert main(["adapt", str(tmp_path), "-o", "field.onnx", *words]) == 2
    assert reason in capsys.readouterr().err


def test_minutes_that_seeing_rows_uses_up_are_refused() -> None:
    with pytest.raises(ConfigError, match="leaves none to learn"):
        adapting._leave(Budget(minutes=1.0), spent_min=1.5)
    assert adapting._leave(Budget(minutes=10.0), spent_min=1.5).minutes == 8.5


def test_the_input_has_the_shape_of_the_pictures_and_the_area_of_the_base() -> None:
    base = Segmenter("agribot-sim")
    assert base.map_shape == (480, 640)
    assert choose_size_px(base, [(512, 512)]) == (512, 512)
    assert choose_size_px(base, [(768, 1024)]) == (480, 640)
    assert choose_size_px(base, [(200, 260)]) == (192, 256)


@pytest.mark.parametrize("name", ["agribot-sim", "agribot-plants"])
def test_the_network_that_a_file_holds_is_recognised_by_its_convolutions(name: str) -> None:
    assert recognise_architecture(model_path(name)) == name
