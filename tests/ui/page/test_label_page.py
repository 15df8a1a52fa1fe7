"""The page of `agribot label` in a real browser: what is painted is the mask on the disk."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import BrowserContext, Page, expect

from agribot.core.messages import PlantClass
from agribot.lab.labelling.label_folder import LabelFolder
from agribot.ui.server.label_page import PAGE, PAGE_DIR, serve_labels
from tests import nightly
from tests.lab.labelling.photographs import HEIGHT, WIDTH, make_photographs, open_folder
from tests.waiting import PATIENCE_S, wait_for

BEET = (slice(20, 50), slice(15, 45))
THISTLE = (slice(50, 80), slice(75, 105))


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return make_photographs(tmp_path / "photos")


@pytest.fixture
def labels(root: Path) -> LabelFolder:
    if not (PAGE_DIR / PAGE).is_file():
        pytest.fail("The page is not built: run `pip install -e .` or `npm run build` in web/.")
    labels = open_folder(root)
    labels.judge_all(lambda: False)
    return labels


@pytest.fixture
def page(context: BrowserContext, labels: LabelFolder) -> Iterator[Page]:
    with serve_labels(labels, 0) as url:
        page = context.new_page()
        foreign: list[str] = []
        page.on(
            "request", lambda r: None if r.url.startswith((url, "blob:")) else foreign.append(r.url)
        )
        page.goto(url)
        expect(page.locator(".picture-name")).to_have_text("murky")
        yield page
        page.close()
        assert foreign == []  # works without a network


def drag(page: Page, *points: tuple[float, float]) -> None:
    """Drag over the picture, in its pixels."""
    box = page.locator(".overlay").bounding_box()
    assert box
    scale = box["width"] / WIDTH
    for i, (u, v) in enumerate(points):
        page.mouse.move(box["x"] + scale * u, box["y"] + scale * v, steps=4)
        if i == 0:
            page.mouse.down()
    page.mouse.up()


def saved(page: Page) -> None:
    expect(page.locator(".saved")).to_have_text("saved")


def read_mask(path: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    image = Image.open(path)
    assert (image.mode, image.size) == ("L", (WIDTH, HEIGHT))
    return np.asarray(image)


def test_what_is_painted_is_saved_found_again_and_finished(root: Path, page: Page) -> None:
    page.keyboard.press("f")
    expect(page.locator(".outlines")).to_be_visible()
    page.keyboard.press("1")
    for v in range(22, 50, 4):
        drag(page, (17, v), (43, v))
    expect(page.locator(".state")).to_have_text("begun")
    saved(page)
    draft = read_mask(root / ".label" / "drafts" / "murky.png")
    assert (draft[BEET] == PlantClass.CROP).mean() > 0.97
    assert (draft[THISTLE] == PlantClass.WEED).all()  # as the network said
    assert not list((root / "masks").iterdir())
    page.reload()
    expect(page.locator(".picture-name")).to_have_text("murky")
    page.keyboard.press("b")
    page.keyboard.press("3")
    drag(page, (90, 65), (90, 65))  # a hole of soil in the thistle
    page.keyboard.press("4")
    drag(page, (60, 10), (70, 10))
    page.keyboard.press("Control+z")
    saved(page)
    page.keyboard.press("Enter")
    expect(page.locator(".picture-name")).to_have_text("dim")
    mask = read_mask(root / "masks" / "murky.png")
    assert (mask[BEET] == PlantClass.CROP).mean() > 0.97
    hole = mask[THISTLE] == PlantClass.SOIL
    assert hole.sum() == pytest.approx(np.pi * 8**2, rel=0.1)
    assert mask[65, 90] == PlantClass.SOIL
    assert not (mask == 255).any()  # undone
    expect(page.locator(".count")).to_have_text("1 of 3 labelled")


def test_the_second_of_two_who_finish_a_picture_is_told_and_sees_the_first_ones(
    root: Path, page: Page
) -> None:
    second = page.context.new_page()
    second.goto(page.url)
    expect(second.locator(".picture-name")).to_have_text("murky")
    page.keyboard.press("3")
    drag(page, (90, 65), (90, 65))
    saved(page)
    page.keyboard.press("Enter")
    expect(page.locator(".picture-name")).to_have_text("dim")
    first = read_mask(root / "masks" / "murky.png")
    second.keyboard.press("1")
    drag(second, (20, 25), (40, 45))
    expect(second.locator(".problem")).to_contain_text("somebody else has saved murky")
    expect(second.locator(".problem")).to_contain_text(".label/kept/murky-1.png")
    kept = read_mask(root / ".label" / "kept" / "murky-1.png")
    assert (kept == PlantClass.CROP).any()
    assert (read_mask(root / "masks" / "murky.png") == first).all()
    expect(second.locator(".picture-name")).to_have_text("murky")
    second.keyboard.press("4")
    drag(second, (60, 10), (70, 10))  # on what the first one saved
    saved(second)
    second.keyboard.press("Enter")
    expect(second.locator(".picture-name")).to_have_text("dim")
    joined = read_mask(root / "masks" / "murky.png")
    assert joined[65, 90] == PlantClass.SOIL
    assert (joined[joined != first] == 255).all()
    second.close()


@nightly.by_day(
    "tests/ui/page/test_build.py::test_the_page_type_checks_and_its_pure_parts_pass_their_tests",
    "tests/lab/labelling/test_guesses.py::"
    "test_all_leaves_of_a_plant_have_its_number_out_to_their_edges_whatever_they_are_called",
)
def test_plants_are_named_by_clicks_and_strokes_wait_for_what_is_computed(
    root: Path, labels: LabelFolder, page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed, find_plants = threading.Event(), labels.find_plants
    monkeypatch.setattr(
        labels,
        "find_plants",
        lambda number: find_plants(number) if computed.wait(PATIENCE_S) else None,
    )
    page.keyboard.press("p")
    expect(page.locator(".computing")).to_have_text("computing plants…")
    drag(page, (30, 35), (30, 35))  # the beet, which the network calls a weed
    drag(page, (60, 10), (60, 10))  # soil
    expect(page.locator(".computing")).to_have_text("computing plants… 2 strokes wait")
    expect(page.locator(".saved")).to_have_text("not saved yet")
    page.keyboard.press("Enter")
    computed.set()
    expect(page.locator(".picture-name")).to_have_text("dim")
    mask = read_mask(root / "masks" / "murky.png")
    assert (mask[BEET] == PlantClass.CROP).all()
    assert (mask[THISTLE] == PlantClass.WEED).all()
    assert (mask == PlantClass.CROP).sum() == mask[BEET].size
    page.get_by_role("button", name="All weed is crop").click()
    page.keyboard.press("2")
    page.keyboard.press("r")
    drag(page, (80, 60), (120, 60))  # from the thistle to soil
    saved(page)
    draft = read_mask(root / ".label" / "drafts" / "dim.png")
    assert (draft[BEET] == PlantClass.CROP).all()
    assert (draft[55:66, 80:105] == PlantClass.WEED).all()
    assert (draft != PlantClass.SOIL).sum() == mask[BEET].size + mask[THISTLE].size
    expect(page.locator(".computing")).to_be_hidden()


@nightly.by_day("test_what_is_painted_is_saved_found_again_and_finished")
def test_keys_go_from_picture_to_picture_and_change_nothing(root: Path, page: Page) -> None:
    page.keyboard.press("ArrowRight")
    expect(page.locator(".picture-name")).to_have_text("dim")
    page.keyboard.press("ArrowRight")
    expect(page.locator(".picture-name")).to_have_text("clear")
    page.keyboard.press("ArrowLeft")
    expect(page.locator(".picture-name")).to_have_text("dim")
    assert not (root / ".label" / "drafts").exists()
    assert not list((root / "masks").iterdir())


@nightly.by_day("test_what_is_painted_is_saved_found_again_and_finished")
def test_the_wheel_zooms_to_where_the_pointer_is_and_painting_stays_in_place(
    root: Path, page: Page
) -> None:
    box = page.locator(".overlay").bounding_box()
    assert box
    at = (box["x"] + box["width"] / 4, box["y"] + box["height"] / 3)  # pixel (30, 30)
    page.mouse.move(*at)
    page.mouse.wheel(0, -500)
    page.keyboard.press("3")
    page.mouse.down()
    page.mouse.up()
    saved(page)
    draft = read_mask(root / ".label" / "drafts" / "murky.png")
    rows, columns = np.nonzero(draft[BEET] == PlantClass.SOIL)
    assert rows.mean() + 20.5 == pytest.approx(30, abs=0.7)
    assert columns.mean() + 15.5 == pytest.approx(30, abs=0.7)


@nightly.by_day("test_what_is_painted_is_saved_found_again_and_finished")
def test_enter_that_is_held_finishes_the_picture_that_was_looked_at_alone(page: Page) -> None:
    page.keyboard.down("Enter")
    expect(page.locator(".picture-name")).to_have_text("dim")
    page.keyboard.down("Enter")  # as a keyboard repeats it
    page.keyboard.up("Enter")
    page.reload()
    expect(page.locator(".picture-name")).to_have_text("dim")
    expect(page.locator(".count")).to_have_text("1 of 3 labelled")


def test_a_stroke_ends_with_its_picture_and_is_kept(root: Path, page: Page) -> None:
    box = page.locator(".overlay").bounding_box()
    assert box
    page.mouse.move(box["x"] + 60, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 90, box["y"] + 60)
    page.keyboard.press("ArrowRight")
    expect(page.locator(".picture-name")).to_have_text("dim")
    page.mouse.move(box["x"] + 300, box["y"] + 200)
    page.mouse.up()
    assert [path.name for path in (root / ".label" / "drafts").iterdir()] == ["murky.png"]
    expect(page.locator(".state")).to_have_text("not labelled")


def test_a_picture_that_cannot_be_read_bars_the_way_to_no_other(root: Path, page: Page) -> None:
    (root / "images" / "dim.png").write_bytes(b"no picture")
    page.keyboard.press("ArrowRight")
    expect(page.locator(".picture-name")).to_have_text("dim")
    expect(page.locator(".problem")).to_contain_text("dim.png")
    page.keyboard.press("ArrowRight")
    expect(page.locator(".picture-name")).to_have_text("clear")
    page.keyboard.press("Enter")
    expect(page.locator(".picture-name")).to_have_text("murky")
    page.keyboard.press("Enter")
    expect(page.locator(".count")).to_have_text("2 of 3 labelled")
    expect(page.locator(".picture-name")).to_have_text("murky")


def test_what_could_not_be_saved_is_saved_as_soon_as_it_can_be(root: Path, page: Page) -> None:
    full = {"error": "make room on the disk"}
    page.route("**/classes?done=0", lambda route: route.fulfill(status=422, json=full))
    drag(page, (60, 60), (70, 60))
    expect(page.locator(".problem")).to_have_text(full["error"])
    expect(page.locator(".saved")).to_have_text("not saved yet")
    page.unroute("**/classes?done=0")
    saved(page)
    assert (root / ".label" / "drafts" / "murky.png").is_file()


@nightly.by_day("test_what_is_painted_is_saved_found_again_and_finished")
def test_a_picture_of_few_pixels_is_not_made_smaller_by_the_key_for_larger(
    root: Path, page: Page
) -> None:
    Image.fromarray(np.full((5, 6, 3), 90, np.uint8)).save(root / "images" / "dim.png")
    page.keyboard.press("ArrowRight")
    expect(page.locator(".picture-name")).to_have_text("dim")
    widths = [width(page)]
    for key in ("+", "-", "0"):
        page.keyboard.press(key)
        widths.append(width(page))
    assert widths == pytest.approx([widths[0], widths[0], 0.8 * widths[0], widths[0]])


def width(page: Page) -> float:
    box = page.locator(".overlay").bounding_box()
    assert box
    return box["width"]


@nightly.by_day("test_what_is_painted_is_saved_found_again_and_finished")
def test_keys_work_after_a_slider_was_moved(page: Page) -> None:
    size = page.get_by_label("Brush size")
    size.focus()
    page.keyboard.press("ArrowRight")
    expect(size).to_have_value("9")
    expect(page.locator(".picture-name")).to_have_text("murky")
    page.keyboard.press("f")
    expect(page.get_by_role("button", name="Superpixels")).to_have_attribute("aria-pressed", "true")


def test_everything_is_within_the_display_and_large_enough_for_a_finger(page: Page) -> None:
    for size in ((1400, 850), (390, 844), (640, 320)):  # wide, a phone, a phone on its side
        page.set_viewport_size({"width": size[0], "height": size[1]})
        check_size(page, size)


def check_size(page: Page, size: tuple[int, int]) -> None:
    fit = "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    wait_for(lambda: page.evaluate(fit) == list(size), f"a page that fits {size}")
    for name in ("Crop", "Weed", "Soil", "Ignore", "Brush", "Done, next", "Next picture"):
        box = page.get_by_role("button", name=name).first.bounding_box()
        assert box, name
        assert min(box["width"], box["height"]) >= 44, name
        assert box["x"] >= 0, name
        assert box["x"] + box["width"] <= size[0], name
        assert box["y"] + box["height"] <= size[1], name
    overlay = page.locator(".overlay").bounding_box()
    assert overlay
    assert overlay["width"] > 0.5 * min(size)
