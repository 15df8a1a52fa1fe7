"""Labels of other tools become the classes that were drawn, or are refused with the reason."""

from __future__ import annotations

import base64
import io
import json
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from agribot.cli.main import main
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.run_lengths import compress, decompress
from agribot.lab.train.photographs import find_pairs, read_pair

WIDTH, HEIGHT = 80, 60
BEET = [(8, 6), (28, 6), (28, 26), (8, 26)]  # corners, from the picture's corner
THISTLE = [(50, 30), (70, 30), (70, 50)]
NAMES = ("--classes", "crop=beet", "weed=*")


def truth() -> ByteArray:
    """The classes that all the files below say: a square beet, and half a square of thistle."""
    label = np.full((HEIGHT, WIDTH), PlantClass.SOIL, np.uint8)
    label[6:26, 8:28] = PlantClass.CROP
    down, right = np.mgrid[30:50, 50:70] + 0.5
    label[30:50, 50:70][right - 50 > down - 30] = PlantClass.WEED
    return label


def draw(folder: Path, name: str = "a.png", label: ByteArray | None = None) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    is_plant = (truth() if label is None else label) != PlantClass.SOIL
    image = np.where(is_plant[..., None], (60, 150, 50), (130, 100, 80)).astype(np.uint8)
    Image.fromarray(image).save(folder / name)


def mask_of(kind: PlantClass) -> npt.NDArray[np.bool_]:
    mask: npt.NDArray[np.bool_] = truth() == kind
    return mask


def runs_of(line: npt.NDArray[np.bool_]) -> list[int]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
    counts: list[int] = np.diff(np.concatenate([[0], edges, [line.size]])).tolist()
    return counts


def flat(points: list[tuple[int, int]]) -> list[int]:
    return [number for point in points for number in point]


def labelme() -> dict[str, Any]:
    part = io.BytesIO()
    Image.fromarray(mask_of(PlantClass.WEED)[30:50, 50:70]).save(part, format="PNG")
    mask = base64.b64encode(part.getvalue()).decode()
    return {
        "version": "5.4.1", "imagePath": "..\\photos\\a.png", "imageData": None,
        "imageHeight": HEIGHT, "imageWidth": WIDTH,
        "shapes": [
            {"label": "beet", "points": [*BEET], "shape_type": "polygon"},
            {"label": "thistle", "points": [[50, 30], [69, 49]], "shape_type": "mask",
             "mask": mask},
        ],
    }  # fmt: skip


def coco(*, is_compressed: bool = True) -> dict[str, Any]:
    runs = runs_of(mask_of(PlantClass.WEED).ravel(order="F"))
    counts: Any = compress(runs) if is_compressed else runs
    return {
        "images": [{"id": 7, "file_name": "photos/a.png", "width": WIDTH, "height": HEIGHT}],
        "categories": [{"id": 1, "name": "beet"}, {"id": 2, "name": "thistle"}],
        "annotations": [
            {"image_id": 7, "category_id": 1, "segmentation": [flat(BEET)], "iscrowd": 0},
            {"image_id": 7, "category_id": 2, "iscrowd": 1,
             "segmentation": {"size": [HEIGHT, WIDTH], "counts": counts}},
        ],
    }  # fmt: skip


def cvat() -> str:
    points = ";".join(f"{u},{v}" for u, v in BEET)
    rle = ", ".join(map(str, runs_of(mask_of(PlantClass.WEED)[30:50, 50:70].ravel())))
    return f"""<?xml version="1.0"?><annotations><version>1.1</version>
      <image id="0" name="a.png" width="{WIDTH}" height="{HEIGHT}">
        <mask label="thistle" rle="{rle}" left="50" top="30" width="20" height="20" z_order="1"/>
        <polygon label="beet" points="{points}" z_order="0"/>
      </image></annotations>"""


def yolo() -> str:
    lines = ((0, BEET), (1, THISTLE))
    return "\n".join(
        f"{kind} " + " ".join(f"{u / WIDTH} {v / HEIGHT}" for u, v in points)
        for kind, points in lines
    )


def brush(mask: npt.NDArray[np.bool_]) -> list[int]:
    """Pack as Label Studio's brush does, each run of the alpha channel as runs of values."""
    values = np.repeat(mask.ravel() * 255, 4)
    bits = f"{values.size:032b}" + f"{7:05b}" + "".join(f"{n:04b}" for n in (2, 4, 7, 15))
    edges = np.flatnonzero(np.diff(values)) + 1
    for run in np.split(values, edges):
        bits += f"1{3:02b}{run.size - 1:016b}{run[0]:08b}"
    bits += "0" * (-len(bits) % 8)
    return [int(bits[i : i + 8], 2) for i in range(0, len(bits), 8)]


def label_studio() -> list[dict[str, Any]]:
    size = {"original_width": WIDTH, "original_height": HEIGHT}
    points = [(100 * u / WIDTH, 100 * v / HEIGHT) for u, v in BEET]
    strokes = {"format": "rle", "rle": brush(mask_of(PlantClass.WEED)), "brushlabels": ["thistle"]}
    results = [
        {"type": "polygonlabels", "value": {"points": points, "polygonlabels": ["beet"]}, **size},
        {"type": "brushlabels", "value": strokes, **size},
    ]
    return [
        {
            "id": 1,
            "data": {"image": "/data/upload/2/0123abcd-a.png"},
            "annotations": [{"was_cancelled": False, "result": results}],
        }
    ]


def write_yolo(folder: Path) -> None:
    (folder / "labels").mkdir()
    (folder / "labels" / "a.txt").write_text(yolo())
    (folder / "data.yaml").write_text("names:\n  0: beet\n  1: thistle\n")


def save_json(make: Callable[[], Any]) -> Callable[[Path], None]:
    return lambda folder: void((folder / "labels.json").write_text(json.dumps(make())))


def void(_: object) -> None:
    return None


WRITERS: dict[str, Callable[[Path], None]] = {
    "labelme": save_json(labelme),
    "coco": save_json(coco),
    "coco, plain run lengths": save_json(lambda: coco(is_compressed=False)),
    "cvat": lambda folder: void((folder / "annotations.xml").write_text(cvat())),
    "yolo": write_yolo,
    "label-studio": save_json(label_studio),
}


def check_drawn(label: ByteArray) -> None:
    wrong = label != truth()
    # A polygon's edge may take the pixels that it cuts; never more than a ring of one pixel.
    assert wrong.sum() <= 4 * 20 + 3 * 20
    inner = np.zeros_like(wrong)
    inner[8:24, 10:26] = inner[33:40, 62:68] = inner[:4] = True
    assert not (wrong & inner).any()


@pytest.mark.parametrize("tool", WRITERS)
def test_what_was_drawn_in_a_tool_is_what_the_product_trains_on(tool: str, tmp_path: Path) -> None:
    draw(tmp_path / "images")
    WRITERS[tool](tmp_path)
    labels = tmp_path / "labels" if tool == "yolo" else tmp_path
    out = tmp_path / "set"
    assert main(["dataset", "import", str(labels), *NAMES, "--out", str(out)]) == 0
    ((pair,), problems) = find_pairs(out, "folder")
    assert problems == []
    image_rgb, label = read_pair(pair)
    assert image_rgb.shape == (HEIGHT, WIDTH, 3)
    check_drawn(label)
    assert main(["dataset", "check", str(out)]) == 0


def test_run_lengths_come_back_as_they_went() -> None:
    rng = np.random.default_rng(3)
    counts = rng.integers(0, 100_000, 50).tolist()
    assert decompress(compress(counts)) == counts


def imported(tmp_path: Path, value: Any, *words: str, name: str = "labels.json") -> int:
    text = value if isinstance(value, str) else json.dumps(value)
    (tmp_path / name).write_text(text)
    if not (tmp_path / "images").is_dir():
        draw(tmp_path / "images")
    files = [str(tmp_path / name), "--out", str(tmp_path / "set")]
    return main(["dataset", "import", *files, *(words or NAMES)])


BOMB = '<!DOCTYPE a [<!ENTITY b "bbbb"><!ENTITY c "&b;&b;&b;">]><annotations>&c;</annotations>'


def outside() -> dict[str, Any]:
    value = labelme()
    value["shapes"][0]["points"][1] = (WIDTH + 40, 6)
    return value


def larger() -> dict[str, Any]:
    value = coco()
    value["images"][0] |= {"width": HEIGHT, "height": WIDTH}
    value["annotations"].pop()
    return value


def cut_runs() -> dict[str, Any]:
    value = coco(is_compressed=False)
    value["annotations"][1]["segmentation"]["counts"].pop()
    return value


def boxes() -> dict[str, Any]:
    value = coco()
    value["annotations"][0]["segmentation"] = []
    return value


def two_of_one_number(kind: str) -> Callable[[], dict[str, Any]]:
    """Make what a careless merge of two files makes: two pictures, or classes, of one number."""

    def make() -> dict[str, Any]:
        value = coco()
        name = "file_name" if kind == "images" else "name"
        value[kind].append(value[kind][0] | {name: "another"})
        return value

    return make


def bomb() -> dict[str, Any]:
    """Make a mask whose picture says that it is larger than any memory."""
    value = labelme()
    png = bytearray(base64.b64decode(value["shapes"][1]["mask"]))
    png[16:24] = (30_000).to_bytes(4, "big") * 2  # width and height
    png[29:33] = zlib.crc32(png[12:29]).to_bytes(4, "big")
    value["shapes"][1]["mask"] = base64.b64encode(png).decode()
    return value


def stroke_cut_off() -> list[dict[str, Any]]:
    value = label_studio()
    value[0]["annotations"][0]["result"][1]["value"]["rle"] = brush(mask_of(PlantClass.WEED))[:40]
    return value


@pytest.mark.parametrize(
    ("name", "make", "reason"),
    [
        ("labels.json", lambda: json.dumps(coco())[:-40], "is no whole JSON file"),
        ("labels.json", lambda: "[" * 100_000, "is no whole JSON file"),
        ("labels.xml", lambda: cvat()[:-40], "is no whole CVAT file"),
        ("labels.xml", lambda: BOMB, "document type declarations are not accepted"),
        ("labels.json", outside, r"reaches (120, 6), outside the picture of 80 x 60"),
        ("labels.json", larger, "turned on its side"),
        ("labels.json", cut_runs, "it was cut off"),
        ("labels.json", two_of_one_number("images"), "two of image 7, photos/a.png and another"),
        ("labels.json", two_of_one_number("categories"), "two of category 1, beet and another"),
        ("labels.json", bomb, "a mask that is no picture (Image size (900000000 pixels) exceeds"),
        ("labels.json", boxes, "is a box without an outline"),
        ("labels.json", stroke_cut_off, "a brush stroke that was cut off"),
        ("a.txt", lambda: "0 0.1 0.1 0.2 0.2 0.3 0.3 0.4", "an odd count"),
        ("a.txt", lambda: "0 0.5 0.5 0.2 0.2", "a box; export segmentations"),
        ("a.txt", lambda: "0 10 10 20 10 20 20", "are these pixels?"),
        ("labels.json", lambda: {"rows": []}, "is of no known format; say which with --format"),
    ],
)
def test_labels_that_cannot_be_right_are_refused_in_one_line(
    name: str,
    make: Callable[[], Any],
    reason: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert imported(tmp_path, make(), name=name) == 2
    (line,) = (text for text in capsys.readouterr().err.splitlines() if "agribot dataset:" in text)
    assert reason in line
    assert name in line or "a.png" in line
    assert not (tmp_path / "set").exists()


def test_a_name_that_nobody_explained_is_asked_about(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(tmp_path, coco(), "--classes", "crop=beet") == 2
    said = capsys.readouterr().err
    assert "without a meaning here: thistle" in said
    assert "--classes crop=beet,maize weed=*" in said
    assert imported(tmp_path, coco(), "--classes", "crops=beet") == 2
    assert "a class of weed, crop, soil, ignore" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("flip", "said"), [(np.fliplr, "left to right"), (np.flipud, "upside down")]
)
def test_labels_whose_axes_are_mirrored_are_refused_with_the_axis(
    flip: Callable[[ByteArray], ByteArray],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    draw(tmp_path / "images", label=flip(truth()))
    assert imported(tmp_path, coco()) == 2
    assert f"they would when mirrored {said}" in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


def test_one_bad_picture_is_left_out_by_name_and_the_rest_is_imported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    draw(tmp_path / "images")
    draw(tmp_path / "images", "b.png")
    value = coco()
    size = {"width": WIDTH, "height": HEIGHT}
    value["images"] += [
        {"id": 8, "file_name": "b.png", **size},
        {"id": 9, "file_name": "gone.png", **size},
    ]
    value["annotations"].append({"image_id": 9, "category_id": 1, "segmentation": [flat(BEET)]})
    assert imported(tmp_path, value, *NAMES, "--json") == 1
    printed = capsys.readouterr()
    report = json.loads(printed.out.splitlines()[-1])
    assert report["pictures"] == 1
    assert report["unlabelled"] == ["b.png"]
    assert "left out: gone.png: no picture of this name" in printed.err
    assert "--keep-empty takes them as bare soil" in printed.err
    assert imported(tmp_path, value) == 2
    assert "is there already; give a new folder" in capsys.readouterr().err


def test_no_name_in_a_file_of_labels_leads_out_of_the_folders_that_were_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    draw(tmp_path / "secret", "a.png")
    (tmp_path / "given").mkdir()
    value = coco()
    value["images"][0]["file_name"] = str(tmp_path / "secret" / "a.png")
    (tmp_path / "given" / "labels.json").write_text(json.dumps(value))
    words = [str(tmp_path / "given" / "labels.json"), *NAMES, "--out", str(tmp_path / "set")]
    assert main(["dataset", "import", *words]) == 2
    assert "no picture of this name" in capsys.readouterr().err


def with_clicks_labelme() -> dict[str, Any]:
    value = labelme()
    value["shapes"] += [
        {"label": "beet", "points": [[40, 40], [41, 40]], "shape_type": "polygon"},
        {"label": "beet", "points": [[40, 40], [41, 40], [42, 40]], "shape_type": "polygon"},
        {"label": "beet", "points": [[40, 40]], "shape_type": "point"},
        {"label": "beet", "points": [[40, 40], [40, 44]], "shape_type": "rectangle"},
    ]
    return value


def with_clicks_coco() -> dict[str, Any]:
    value = coco()
    value["annotations"] += [
        {"image_id": 7, "category_id": 1, "segmentation": [[40, 40, 41, 40]]},
        {"image_id": 7, "category_id": 1, "segmentation": [], "bbox": [40, 40, 0, 0]},
        {"image_id": 7, "category_id": 1, "segmentation": [[]]},
        {"image_id": 7, "category_id": 1, "segmentation": [[40, 40]]},
    ]
    value["annotations"][0]["segmentation"].append([1, 1, 2, 2])
    return value


def with_clicks_label_studio() -> list[dict[str, Any]]:
    value = label_studio()
    size = {"original_width": WIDTH, "original_height": HEIGHT}
    for points in ([], [[10, 10], [11, 11]]):
        click = {"points": points, "polygonlabels": ["beet"]}
        value[0]["annotations"][0]["result"].append(
            {"type": "polygonlabels", "value": click, **size}
        )
    place = {"x": 3.0, "y": 4.0, "width": 0.5, "keypointlabels": ["beet"]}
    value[0]["annotations"][0]["result"] += [
        {"type": "keypointlabels", "value": place, **size},
        {"type": "rectanglelabels", "value": {**place, "width": 0, "height": 2}, **size},
        {"type": "rating", "value": {"rating": 4}},
        {"type": "number", "value": {"number": 4}},
        {"type": "taxonomy", "value": {"taxonomy": [["a", "b"]]}},
        {"type": "relation", "from_id": "x", "to_id": "y", "direction": "right"},
    ]
    return value


def with_clicks_cvat() -> str:
    shapes = '<polygon label="beet" points="40,40;41,40" z_order="0"/>'
    shapes += '<points label="beet" points="40,40" z_order="0"/><polygon label="beet" points=""/>'
    shapes += '<box label="beet" xtl="40.0" ytl="40.0" xbr="40.0" ybr="44.0" z_order="0"/>'
    return cvat().replace("</image>", f"{shapes}</image>")


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("labels.json", with_clicks_labelme),
        ("labels.json", with_clicks_coco),
        ("labels.json", with_clicks_label_studio),
        ("labels.xml", with_clicks_cvat),
    ],
)
def test_a_shape_that_covers_nothing_is_left_out_by_name_and_its_picture_kept(
    name: str, make: Callable[[], Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(tmp_path, make(), *NAMES, "--json", name=name) == 0
    printed = capsys.readouterr()
    report = json.loads(printed.out.splitlines()[-1])
    assert len(report["without_area"]) == 4
    assert "4 shapes without an area were left out (a.png: " in printed.err
    check_drawn(np.asarray(Image.open(tmp_path / "set" / "masks" / "a.png")))


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\n".join(f"{line} 0.913" for line in text.split("\n")) + "\n",
        lambda text: "\n".join(f"{line} 0.9 {5 - k}" for k, line in enumerate(text.split("\n"))),
        lambda text: "\n".join(f"{float(line[0])}{line[1:]}" for line in text.split("\n")),
        lambda text: "\n".join(f"{float(line[0]):.18e}{line[1:]}" for line in text.split("\n")),
        lambda text: "\ufeff" + text.replace("\n", "\r\n"),
    ],
    ids=["how sure it was", "how sure, and its track", "numpy", "savetxt", "mark"],
)
def test_labels_that_a_network_or_an_editor_wrote_are_read(
    change: Callable[[str], str], tmp_path: Path
) -> None:
    names = ("--classes", "crop=0", "weed=1")
    assert imported(tmp_path, change(yolo()), *names, name="a.txt") == 0
    check_drawn(np.asarray(Image.open(tmp_path / "set" / "masks" / "a.png")))


def test_a_line_that_was_cut_off_is_not_taken_for_one_with_a_confidence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = yolo().rpartition(" ")[0]
    assert imported(tmp_path, text, "--classes", "crop=0", "weed=1", name="a.txt") == 2
    assert "an odd count: it was cut off" in capsys.readouterr().err


def test_texts_about_a_set_beside_its_labels_are_no_labels(tmp_path: Path) -> None:
    draw(tmp_path / "images")
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "a.txt").write_text(yolo())
    for name in ("README.dataset.txt", "README.roboflow.txt", "train.txt", "LICENSE.txt"):
        (tmp_path / "labels" / name).write_text("https://universe.roboflow.com/beets\n")
    words = [str(tmp_path / "labels"), "--out", str(tmp_path / "set"), "--classes"]
    assert main(["dataset", "import", *words, "crop=0", "weed=1"]) == 0
