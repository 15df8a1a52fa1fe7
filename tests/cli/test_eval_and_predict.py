"""The commands that run a network over pictures, from the command line to their files."""

from __future__ import annotations

import csv
import errno
import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from PIL import Image

from agribot.autonomy.perceive.pictures import classify, see_picture
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.cli.data.result_names import name_results
from agribot.cli.main import main
from agribot.core.fact_text import render
from agribot.core.facts import TooDark
from agribot.lab.train.card import ModelCard, hash_file
from agribot.lab.train.simulated import draw_random_field
from agribot.sim.random_scenes import DENSE
from tests.lab.train.photo_folder import photo_folder, spoil

EVAL_KEYS = {
    "dataset", "images", "height_px", "width_px", "model", "iou", "miou", "precision", "recall",
    "f1", "boundary_f1", "calibration_error", "plant_calibration_error", "confusion", "params",
    "fps_cpu", "doubt_median",
}  # fmt: skip


def result_of(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(capsys.readouterr().out.strip().splitlines()[-1])
    return found


def test_eval_reports_one_pooled_confusion_matrix(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = photo_folder(tmp_path / "photos", 3)
    assert main(["eval", str(folder), "--data", "cwfid", "--json"]) == 0
    result = result_of(capsys)
    assert set(result) == EVAL_KEYS
    assert (result["dataset"], result["model"], result["images"]) == ("cwfid", "agribot-plants", 3)
    assert (result["height_px"], result["width_px"]) == (480, 640)
    assert result["params"] == 2_226_909
    assert result["fps_cpu"] > 0.0
    counts = np.zeros((3, 3), int)
    segmenter = Segmenter("agribot-plants")
    doubts = []
    for index in range(3):
        image = np.asarray(Image.open(folder / "images" / f"{index:03d}_image.png"))
        mask = np.asarray(Image.open(folder / "annotations" / f"{index:03d}_annotation.png"))
        truth = np.where(mask[..., 0] > 0, 0, np.where(mask[..., 1] > 0, 1, 2))
        seen = see_picture(segmenter, image)
        np.add.at(counts, (truth, seen.classes.class_id), 1)
        assert seen.class_map.doubt is not None
        doubts.append(seen.class_map.doubt)
    assert None not in doubts
    assert result["doubt_median"] == np.median([doubt for doubt in doubts if doubt is not None])
    assert result["confusion"] == counts.tolist()
    hits = np.diag(counts)
    union = counts.sum(axis=0) + counts.sum(axis=1) - hits
    assert list(result["iou"].values()) == pytest.approx((hits / union).tolist())
    assert result["miou"] == pytest.approx(float((hits / union).mean()))


def test_eval_prints_its_table_where_a_shell_can_catch_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = photo_folder(tmp_path / "photos", 2)
    assert main(["eval", str(folder), "--data", "cwfid"]) == 0
    printed = capsys.readouterr()
    assert [line.split()[0] for line in printed.out.splitlines()[1:5]] == [
        "weed", "crop", "soil", "mIoU",
    ]  # fmt: skip
    assert "over 2 images" in printed.out
    assert "000_image.png: mIoU" in printed.err


def test_eval_reads_masks_whose_values_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = photo_folder(tmp_path / "photos", 2)
    words = ["eval", str(folder), "--model", "agribot-sim", "--json"]
    assert main([*words, "--data", "cwfid"]) == 0
    expected = result_of(capsys)
    for path in (folder / "annotations").iterdir():
        red, green, _ = np.moveaxis(np.asarray(Image.open(path)), -1, 0)
        Image.fromarray(np.where(red > 0, 2, np.where(green > 0, 1, 0)).astype(np.uint8)).save(path)
    assert main([*words, "--ids", "0=soil,1=crop,2=weed"]) == 0
    assert result_of(capsys)["confusion"] == expected["confusion"]


@pytest.mark.parametrize(
    "words", [("eval", "PHOTOS"), ("export", "agribot-sim", "-o", "OUT", "--judge", "PHOTOS")]
)
def test_nothing_is_judged_on_masks_whose_classes_look_swapped(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = photo_folder(tmp_path / "photos", 2)
    for path in (folder / "annotations").iterdir():  # soil 0, crop 1, weed 2
        red, green, _ = np.moveaxis(np.asarray(Image.open(path)), -1, 0)
        Image.fromarray(np.where(red > 0, 2, np.where(green > 0, 1, 0)).astype(np.uint8)).save(path)
    places = {"PHOTOS": str(folder), "OUT": str(tmp_path / "small.onnx")}
    assert main([places.get(word, word) for word in words]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = (text for text in printed.err.splitlines() if "covers" in text)
    assert "weed covers" in line
    assert "--ids 0=soil,1=crop,2=weed" in line


def test_eval_judges_the_rest_names_broken_files_and_ends_with_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = photo_folder(tmp_path / "photos", 7)
    broken = spoil(folder)
    words = ["eval", str(folder), "--model", "agribot-sim", "--json"]
    assert main([*words, "--out", str(tmp_path / "judged")]) == 1
    printed = capsys.readouterr()
    assert json.loads(printed.out.splitlines()[-1])["images"] == 2
    assert all(f"{name}:" in printed.err for name in broken)
    details = json.loads((tmp_path / "judged" / "eval.json").read_text(encoding="utf-8"))
    assert len(details["problems"]) == len(broken)
    assert len(details["by_image"]) == 2
    for name in ("confusion", "reliability", "curves", "images", "worst"):
        assert (tmp_path / "judged" / f"{name}.png").is_file()


def test_masks_in_which_nothing_is_labelled_judge_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = photo_folder(tmp_path / "photos", 2)
    first, second = sorted((folder / "annotations").iterdir())
    ignored = Image.fromarray(np.full_like(np.asarray(Image.open(first))[..., 0], 255))
    ignored.save(first)
    assert main(["eval", str(folder), "--json"]) == 1
    printed = capsys.readouterr()
    assert json.loads(printed.out.splitlines()[-1])["images"] == 1
    assert "000_annotation.png: every pixel is ignored; label some" in printed.err
    ignored.save(second)
    export = ["export", "agribot-sim", "--judge", str(folder), "-o", str(tmp_path / "a.onnx")]
    for words in (["eval", str(folder)], export, [*export, "--auto"]):
        assert main(words) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert any(said in printed.err for said in ("can be read", "every pixel is ignored"))


@pytest.mark.parametrize(
    "words",
    [
        ("eval",),
        ("eval", "nowhere"),
        ("eval", ".", "--model", "agribot-moon"),
        ("predict", "nowhere/*.png", "-o", "out"),
        ("export", "agribot-sim", "-o", "a.onnx", "--precision", "int8"),
        ("export", "agribot-sim", "-o", "a.txt"),
        ("export", "agribot-sim", "-o", "a.onnx", "--size", "500x300"),
        ("models", "agribot-moon"),
        ("live", "no-such-video.mp4"),
        ("live", "99999999999999999999"),
        ("live", "²"),
        ("train", "--data", "cwfid", "--out", "o"),
        ("train", "--data", "folder", "--data-dir", ".", "--model", "moon", "--out", "o"),
    ],
)
def test_wrong_use_is_one_line_and_status_two(
    words: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert said[0].startswith(f"agribot {words[0]}: ")
    assert "internal error" not in said[0]


def test_eval_asks_which_of_two_folders_is_meant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = photo_folder(tmp_path / "photos", 1)
    assert main(["eval", str(folder), "--data-dir", str(tmp_path / "others")]) == 2
    assert "others: two folders; give one" in capsys.readouterr().err


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_predict_writes_pictures_and_tables_that_agree(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = photo_folder(tmp_path / "photos", 2) / "images"
    Image.open(folder / "000_image.png").save(folder / "photo.jpg")
    Image.open(folder / "000_image.png").save(folder / "scan.tif")
    out = tmp_path / "seen"
    words = ["predict", str(folder), "-o", str(out), "--model", "agribot-sim", "--least-px", "1"]
    assert main([*words, "--json"]) == 0
    assert result_of(capsys)["pictures"] == 4
    areas = rows(out / "areas.csv")
    assert [row["image"] for row in areas] == [
        "000_image.png", "001_image.png", "photo.jpg", "scan.tif",
    ]  # fmt: skip
    plants = rows(out / "plants.csv")
    for row in areas:
        mask = np.asarray(Image.open(out / f"{Path(row['image']).stem}-mask.png"))
        for kind, channel in (("weed", 0), ("crop", 1), ("soil", 2)):
            assert int(row[f"{kind}_px"]) == int((mask[..., channel] == 255).sum())
        own = [plant for plant in plants if plant["image"] == row["image"]]
        for kind in ("weed", "crop"):
            sizes = [int(plant["area_px"]) for plant in own if plant["class"] == kind]
            assert (len(sizes), sum(sizes)) == (int(row[f"{kind}_count"]), int(row[f"{kind}_px"]))
    with Image.open(out / "scan-panel.png") as panel:
        assert panel.width == 3 * int(areas[-1]["width_px"])
    # A lossless copy of a picture is seen the same.
    assert areas[0]["weed_px"] == areas[-1]["weed_px"]


def test_predict_lists_the_stems_of_a_network_that_finds_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "photos").mkdir()
    view = next(
        draw_random_field(np.random.default_rng([6, 91]), 1, DENSE._replace(post_share=0.0))
    )
    Image.fromarray(view.image_rgb).resize((800, 600)).save(tmp_path / "photos/field.png")
    words = ["predict", str(tmp_path / "photos"), "-o", str(tmp_path), "--only", "mask", "--json"]
    assert main([*words, "--model", "agribot-plants"]) == 0
    result, plants = result_of(capsys), rows(tmp_path / "plants.csv")
    wanted = view.plants.stem_px * 1.25
    found = np.array([(float(plant["u_px"]), float(plant["v_px"])) for plant in plants])
    gaps_px = np.hypot(*(wanted[:, None] - found[None]).transpose(2, 0, 1)).min(axis=0)
    assert len(gaps_px) > 10 and np.median(gaps_px) < 8.0
    for plant in plants:
        weed, crop = float(plant["weed_probability"]), float(plant["crop_probability"])
        assert weed + crop == pytest.approx(1.0, abs=1e-3)
        named = "crop" if crop > weed else "weed"
        assert plant["class"] == (named if max(weed, crop) >= 0.6 else "unknown")
    counted = ("weed_count", "crop_count", "unknown_count")
    assert sum(result[name] for name in counted) == len(plants)
    (area,) = rows(tmp_path / "areas.csv")
    assert 0.05 < float(area["doubt"]) < 0.6 and area["unfit"] == ""
    assert (result["doubt_median"], result["unfit_pictures"]) == (float(area["doubt"]), 0)
    assert main([*words, "--model", "agribot-plants", "--tile", "400x300"]) == 0
    assert not rows(tmp_path / "plants.csv")[0]["weed_probability"]


def test_predict_says_of_which_pictures_the_robot_would_believe_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.new("RGB", (64, 48)).save(tmp_path / "night.png")
    words = ["predict", str(tmp_path / "night.png"), "-o", str(tmp_path / "seen"), "--only", "mask"]
    assert main([*words, "--json"]) == 0
    result = result_of(capsys)
    assert (result["doubt_median"], result["unfit_pictures"]) == (None, 1)
    (area,) = rows(tmp_path / "seen" / "areas.csv")
    assert area["unfit"] == render(TooDark()) and not area["doubt"]


def test_pictures_of_one_name_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    for day in ("monday", "tuesday"):
        (tmp_path / day).mkdir()
        Image.new("RGB", (64, 48)).save(tmp_path / day / "a.png")
    Image.new("RGB", (64, 48)).save(tmp_path / "monday" / "b.png")
    days = [str(tmp_path / day) for day in ("monday", "tuesday")]
    out = tmp_path / "seen"
    assert main(["predict", *days, "--model", "agribot-sim", "-o", str(out)]) == 0
    names = [row["image"] for row in rows(out / "areas.csv")]
    assert names == [f"{days[0]}/a.png", "b.png", f"{days[1]}/a.png"]


def test_frames_of_a_video_and_pictures_share_no_file(tmp_path: Path) -> None:
    names = ["film.avi", "film-000000.png", "film.png", "a-1000000.png", "film-7.png", "a.mkv"]
    for files in (names, names[::-1]):
        stems = name_results([Path(name) for name in files])
        made = [f"{stem}-000000" if name.endswith((".avi", ".mkv")) else stem
                for name, stem in zip(files, stems, strict=True)]  # fmt: skip
        made += [f"{stem}-1000000" for stem in stems if f"{stem}-000000" in made]
        assert len(set(made)) == len(made)
        assert stems[files.index("film-7.png")] == "film-7", "which is no name of a frame"


def test_a_full_disk_is_told_with_the_file_that_found_no_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.new("RGB", (64, 48)).save(tmp_path / "a.png")
    words = ["predict", str(tmp_path / "a.png"), "--model", "agribot-sim", "-o"]
    full = tmp_path / "tables"
    full.mkdir()
    (full / "areas.csv").symlink_to("/dev/full")
    assert main([*words, str(full)]) == 2
    assert f"cannot write {full / 'areas.csv'}: No space left" in capsys.readouterr().err

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("agribot.core.whole_file._write_new", refuse)
    assert main([*words, str(tmp_path / "seen")]) == 2
    said = capsys.readouterr().err
    assert f"cannot write {tmp_path / 'seen' / 'a-mask.png'}: No space left" in said
    assert "internal error" not in said


def test_predict_replaces_nothing_that_it_did_not_write(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.new("RGB", (64, 48)).save(tmp_path / "a.jpg")
    painted = tmp_path / "a-mask.png"
    painted.write_bytes(b"painted by hand")
    words = ["predict", str(tmp_path / "a.jpg"), "--model", "agribot-sim", "-o"]
    assert main([*words, str(tmp_path)]) == 2
    assert "a-mask.png is there, of no earlier call" in capsys.readouterr().err
    assert painted.read_bytes() == b"painted by hand"
    for _ in range(2):
        assert main([*words, str(tmp_path / "seen")]) == 0
    assert (tmp_path / "seen" / "a-mask.png").is_file()


def test_predict_takes_patterns_and_leaves_broken_pictures_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = photo_folder(tmp_path / "photos", 3) / "images"
    (folder / "001_image.png").write_bytes(b"")
    out = tmp_path / "seen"
    words = ["predict", str(folder / "*_image.png"), "-o", str(out), "--only", "overlay"]
    words += ["--model", "agribot-sim"]
    assert main([*words, "--format", "jpg", "--tile", "64x48"]) == 1
    assert "001_image.png: is empty" in capsys.readouterr().err
    assert sorted(path.name for path in out.iterdir()) == [
        "000_image-overlay.jpg", "002_image-overlay.jpg", "areas.csv", "plants.csv",
    ]  # fmt: skip


def test_predict_goes_through_a_video_frame_by_frame(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    film = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (128, 96))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no MJPEG")
    for grey in (60, 120, 180):
        writer.write(np.full((96, 128, 3), grey, np.uint8))
    writer.release()
    out = tmp_path / "seen"
    assert main(["predict", str(film), "-o", str(out), "--only", "mask"]) == 0
    assert [row["frame"] for row in rows(out / "areas.csv")] == ["0", "1", "2"]
    assert (out / "film-000002-mask.png").is_file()


def test_models_lists_the_default_with_its_licence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", "--json"]) == 0
    result = result_of(capsys)
    assert result["default"] == "agribot-plants"
    assert result["models"]["agribot-sim"]["license"] == "Apache-2.0"
    assert main(["models", "agribot-sim"]) == 0
    assert "Licence of the weights: Apache-2.0" in capsys.readouterr().err


def test_an_export_at_another_size_answers_at_that_size(tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    out = tmp_path / "small.onnx"
    assert main(["export", "agribot-sim", "-o", str(out), "--size", "320x256"]) == 0
    image_rgb = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    assert Segmenter(out).segment(image_rgb).class_id.shape == (256, 320)


@pytest.mark.slow
def test_eight_bits_make_a_smaller_file_that_mostly_agrees(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("onnx")
    folder = photo_folder(tmp_path / "photos", 3)
    out = tmp_path / "int8.onnx"
    words = ["export", "agribot-sim", "-o", str(out), "--precision", "int8", "--size", "320x256"]
    words += ["--calibrate", str(folder / "images"), "--judge", str(folder), "--json"]
    assert main(words) == 0
    result = result_of(capsys)
    assert result["bytes"] < 0.4 * 2_892_099
    assert abs(result["after"]["miou"] - result["before"]["miou"]) < 0.1
    image_rgb = np.asarray(Image.open(folder / "images" / "000_image.png"))
    whole, small = Segmenter("agribot-sim"), Segmenter(out)
    same = classify(whole, image_rgb).class_id == classify(small, image_rgb).class_id
    assert same.mean() > 0.9
    card = msgspec.json.decode(out.with_suffix(".json").read_bytes(), type=ModelCard)
    whole_card = msgspec.json.decode(whole.path.with_suffix(".json").read_bytes(), type=ModelCard)
    assert (card.precision, card.input_width_px, card.input_height_px) == ("int8", 320, 256)
    assert (card.sha256, card.file_bytes) == (hash_file(out), out.stat().st_size)
    assert (card.exported_from, card.test) == (whole_card.sha256, whole_card.test)
    assert card.most_doubt is None, "it finds no stems"
    said = out.with_suffix(".md").read_text(encoding="utf-8")
    assert f"Exported from: SHA-256 `{whole_card.sha256}`, whose scores these are" in said
