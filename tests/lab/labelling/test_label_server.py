"""What the page of `agribot label` asks for, and what comes to lie on the disk."""

from __future__ import annotations

import http.client
import json
import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")

from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.core.messages import PlantClass
from agribot.lab.labelling.label_folder import LabelFolder
from agribot.lab.labelling.superpixels import find_superpixels
from agribot.lab.train.photographs import find_pairs, read_label, read_pair
from agribot.ui.server.label_page import serve_labels
from tests.lab.labelling.photographs import (
    HEIGHT,
    NAMES,
    WIDTH,
    guess,
    make_photographs,
    open_folder,
)
from tests.waiting import PATIENCE_S

CLEAR, DIM, MURKY = range(len(NAMES))
Answer = tuple[int, dict[str, str], bytes]


class Client:
    """A browser with a page of this server, or one that pretends to be."""

    def __init__(self, url: str) -> None:
        self.host = url.removeprefix("http://").rstrip("/")

    def ask(self, method: str, path: str, body: bytes | None = None, **headers: str) -> Answer:
        sent = {"Host": self.host, "Origin": f"http://{self.host}", **headers}
        connection = http.client.HTTPConnection(self.host, timeout=60)
        try:
            connection.request(method, path, body, sent)
            answer = connection.getresponse()
            found = {name.lower(): value for name, value in answer.getheaders()}
            return answer.status, found, answer.read()
        finally:
            connection.close()

    def states(self) -> dict[str, str]:
        pictures = json.loads(self.ask("GET", "/api/v1/pictures")[2])["pictures"]
        return {one["name"]: one["state"] for one in pictures}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return make_photographs(tmp_path / "photos")


@pytest.fixture
def client(root: Path) -> Iterator[Client]:
    with serve_labels(open_folder(root), 0) as url:
        yield Client(url)


def drawn() -> bytes:
    """The beet is a crop, the thistle a weed, a corner counts for nothing."""
    label = np.full((HEIGHT, WIDTH), PlantClass.SOIL, np.uint8)
    label[20:50, 15:45], label[50:80, 75:105] = PlantClass.CROP, PlantClass.WEED
    label[:5, :5] = 255
    return label.tobytes()


def test_the_network_labels_first_and_its_least_certain_picture_comes_first(root: Path) -> None:
    labels = open_folder(root)
    assert [one.uncertainty for one in labels.list_pictures()] == [None] * 3
    labels.judge_all(lambda: False)
    assert [one.name for one in labels.list_pictures()] == ["murky", "dim", "clear"]
    found = labels.read_classes(MURKY)
    assert found.state == "new"
    assert (found.class_id[25:45, 20:40] == PlantClass.WEED).all()

    def never(_image: object) -> None:
        raise AssertionError("the network was asked again")

    again = LabelFolder(root, never, "guesser")  # type: ignore[arg-type]
    again.judge_all(lambda: False)
    assert [one.name for one in again.list_pictures()] == ["murky", "dim", "clear"]


def test_what_is_finished_is_what_a_training_reads(root: Path, client: Client) -> None:
    path = f"/api/v1/pictures/{DIM}/classes"
    assert client.ask("PUT", f"{path}?done=1", drawn())[0] == 204
    assert client.states() == {"clear": "new", "dim": "done", "murky": "new"}
    pairs, _ = find_pairs(root, "folder")
    ((pair,)) = pairs
    assert pair.mask == root / "masks" / "dim.png"
    assert read_pair(pair)[1].tobytes() == drawn()
    status, headers, body = client.ask("GET", path)
    assert (status, headers["x-state"], body) == (200, "done", drawn())
    assert (headers["x-width"], headers["x-height"]) == (str(WIDTH), str(HEIGHT))
    assert main(["dataset", "check", str(root), "--json"]) == 1  # two pictures have no mask yet


def test_what_is_only_begun_survives_a_restart_and_teaches_nobody(root: Path) -> None:
    with serve_labels(open_folder(root), 0) as url:
        path = f"/api/v1/pictures/{CLEAR}/classes?done=0"
        assert Client(url).ask("PUT", path, drawn())[0] == 204
    with pytest.raises(ConfigError, match="has no image with a mask"):
        find_pairs(root, "folder")
    with serve_labels(open_folder(root), 0) as url:
        client = Client(url)
        assert client.states()["clear"] == "draft"
        assert client.ask("GET", f"/api/v1/pictures/{CLEAR}/classes")[2] == drawn()
        assert client.ask("PUT", f"/api/v1/pictures/{CLEAR}/classes?done=1", drawn())[0] == 204
        assert client.states()["clear"] == "done"
    assert not list((root / ".label" / "drafts").iterdir())


@pytest.mark.parametrize("done", [0, 1])
def test_what_somebody_else_saved_meanwhile_is_not_replaced_and_nothing_drawn_is_lost(
    done: int, root: Path, client: Client
) -> None:
    path = f"/api/v1/pictures/{DIM}/classes"
    ours, theirs = drawn(), bytes([PlantClass.SOIL]) * (WIDTH * HEIGHT)
    read = client.ask("GET", path)[1]["etag"]
    status, saved, _ = client.ask("PUT", f"{path}?done={done}", theirs, **{"If-Match": read})
    assert status == 204
    status, _, answer = client.ask("PUT", f"{path}?done=1", ours, **{"If-Match": read})
    assert status == 409
    assert "somebody else has saved dim" in json.loads(answer)["error"]
    assert client.ask("GET", path)[2] == theirs
    kept = root / ".label" / "kept" / "dim-1.png"
    assert read_label(kept, {}).tobytes() == ours
    assert client.ask("PUT", f"{path}?done=0", ours, **{"If-Match": read})[0] == 409
    assert (root / ".label" / "kept" / "dim-2.png").is_file()
    assert client.ask("PUT", f"{path}?done=1", ours, **{"If-Match": saved["etag"]})[0] == 204
    assert client.ask("GET", path)[2] == ours


def test_a_save_whose_answer_was_lost_may_be_sent_again(root: Path, client: Client) -> None:
    path = f"/api/v1/pictures/{DIM}/classes"
    read = client.ask("GET", path)[1]["etag"]
    answers = [client.ask("PUT", f"{path}?done=1", drawn(), **{"If-Match": read}) for _ in "12"]
    assert [status for status, _, _ in answers] == [204, 204]
    assert answers[0][1]["etag"] == answers[1][1]["etag"] != read
    assert not (root / ".label" / "kept").exists()


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (b"\x00" * 7, "120 x 90 pixels"),
        (b"\x07" * (WIDTH * HEIGHT), "the classes hold other values"),
    ],
)
def test_classes_that_cannot_be_those_of_the_picture_are_refused(
    body: bytes, said: str, root: Path, client: Client
) -> None:
    status, _, answer = client.ask("PUT", f"/api/v1/pictures/{DIM}/classes?done=1", body)
    assert status in {400, 422}
    assert said in json.loads(answer)["error"]
    assert not list((root / "masks").iterdir())
    assert client.ask("GET", "/api/v1/pictures/99/classes")[0] == 404


def test_other_pages_and_other_names_of_this_machine_are_turned_away(client: Client) -> None:
    path = f"/api/v1/pictures/{DIM}/classes?done=1"
    assert client.ask("PUT", path, drawn(), Origin="http://evil.example")[0] == 403
    assert client.ask("GET", "/api/v1/pictures", Host="evil.example")[0] == 403
    assert client.ask("GET", "/../../../etc/passwd")[0] == 404
    assert "default-src 'self'" in client.ask("GET", "/")[1]["content-security-policy"]
    assert set(client.states().values()) == {"new"}


def test_masks_of_other_values_stay_masks_of_these_values(root: Path) -> None:
    (root / "masks").mkdir()
    values = np.zeros((HEIGHT, WIDTH), np.uint8)
    values[20:50, 15:45] = 1
    Image.fromarray(values).save(root / "masks" / "clear_mask.png")
    ids = {0: PlantClass.SOIL, 1: PlantClass.CROP, 2: PlantClass.WEED, 255: 255}
    labels = LabelFolder(root, guess, "guesser", ids)
    label = labels.read_classes(CLEAR).class_id.copy()
    assert (label[20:50, 15:45] == PlantClass.CROP).all()
    label[50:80, 75:105] = PlantClass.WEED
    labels.save(CLEAR, label, is_done=True)
    saved = np.asarray(Image.open(root / "masks" / "clear_mask.png"))
    assert (saved[50:80, 75:105] == 2).all()
    assert (saved[0] == 0).all()
    assert (read_label(root / "masks" / "clear_mask.png", ids) == label).all()
    with pytest.raises(ConfigError, match="no value for weed"):
        LabelFolder(root, guess, "guesser", {0: PlantClass.SOIL, 1: PlantClass.CROP})


def test_what_is_ignored_is_never_stored_as_the_value_of_a_class(root: Path) -> None:
    ids: dict[int, int] = {0: PlantClass.SOIL, 128: PlantClass.WEED, 255: PlantClass.CROP}
    with pytest.raises(ConfigError, match="no value for ignore"):
        LabelFolder(root, guess, "guesser", ids)
    ids[7] = 255
    label = np.frombuffer(drawn(), np.uint8).reshape(HEIGHT, WIDTH)
    LabelFolder(root, guess, "guesser", ids).save(CLEAR, label, is_done=True)
    assert (np.asarray(Image.open(root / "masks" / "clear.png"))[:5, :5] == 7).all()
    assert (read_label(root / "masks" / "clear.png", ids) == label).all()


def test_a_mask_that_another_person_finished_meanwhile_is_shown_and_one_moved_away_is_not(
    root: Path,
) -> None:
    mine, theirs = open_folder(root), open_folder(root)
    label = np.frombuffer(drawn(), np.uint8).reshape(HEIGHT, WIDTH)
    theirs.save(DIM, label, is_done=True)
    assert {one.name: one.state for one in mine.list_pictures()}["dim"] == "done"
    found = mine.read_classes(DIM)
    assert (found.state, found.class_id.tobytes()) == ("done", drawn())
    (root / "masks" / "dim.png").unlink()
    assert theirs.read_classes(DIM).state == "new"


def test_a_picture_whose_name_is_no_text_is_left_out_and_the_page_shows_the_others(
    root: Path,
) -> None:
    try:
        shutil.copy(root / "images" / "dim.png", root / "images" / os.fsdecode(b"R\xfcbe.png"))
    except OSError:
        pytest.skip("a file system whose names are text")
    labels = open_folder(root)
    assert [one.file for one in labels.left_out] == ["images/R\\udcfcbe.png"]
    with serve_labels(labels, 0) as url:
        assert set(Client(url).states()) == set(NAMES)


def test_a_frame_that_the_robot_kept_counts_as_labelled_once_a_person_says_so(root: Path) -> None:
    for name in ("masks", "notes"):
        (root / name).mkdir()
    (root / "masks" / "dim.png").write_bytes((root / "images" / "dim.png").read_bytes())
    Image.fromarray(guess(np.zeros((HEIGHT, WIDTH, 3), np.uint8)).class_id).save(
        root / "masks" / "dim.png"
    )
    (root / "notes" / "dim.json").write_text('{"is_mask_from_network": true, "t_s": 3.5}')
    labels = open_folder(root)
    states = {one.name: one.state for one in labels.list_pictures()}
    assert states["dim"] == "new"
    labels.save(DIM, labels.read_classes(DIM).class_id, is_done=True)
    states = {one.name: one.state for one in labels.list_pictures()}
    assert states["dim"] == "done"
    note = json.loads((root / "notes" / "dim.json").read_text())
    assert note == {"is_mask_from_network": False, "t_s": 3.5}


def test_the_plants_of_the_network_cross_the_line_as_numbers(client: Client) -> None:
    status, headers, body = client.ask("GET", f"/api/v1/pictures/{DIM}/plants")
    assert (status, headers["x-width"], headers["x-height"]) == (200, str(WIDTH), str(HEIGHT))
    plants = np.frombuffer(body, "<u2").reshape(HEIGHT, WIDTH)
    assert (plants[20:50, 15:45] == 1).all() and plants.sum() == 900


def test_superpixels_keep_to_the_outlines_of_leaves() -> None:
    rng = np.random.default_rng(0)
    down, right = np.mgrid[0:150, 0:200]
    is_leaf = (down - 70) ** 2 + (right - 90) ** 2 < 45**2
    image = np.where(is_leaf[..., None], (60, 150, 50), (130, 100, 80))
    noisy = (image + rng.normal(0, 12, image.shape)).clip(0, 255).astype(np.uint8)
    pieces = find_superpixels(noisy)
    assert pieces.shape == is_leaf.shape
    count = int(pieces.max()) + 1
    inside = np.bincount(pieces[is_leaf], minlength=count)
    total = np.bincount(pieces.ravel(), minlength=count)
    # Achievable segmentation accuracy: every piece gets the class that most of it has.
    right_px = np.maximum(inside, total - inside).sum()
    assert right_px / is_leaf.size > 0.995
    assert np.count_nonzero(total) > 100


def test_an_end_while_superpixels_are_computed_is_no_error(
    root: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    labels, begun, ended = open_folder(root), threading.Event(), threading.Event()

    def compute_for_long(number: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint16]]:
        begun.set()
        ended.wait()
        return find_superpixels(labels.read_picture(number))

    monkeypatch.setattr(labels, "find_superpixels", compute_for_long)
    answers: list[Answer] = []
    try:
        with serve_labels(labels, 0) as url:
            path = f"/api/v1/pictures/{CLEAR}/superpixels"
            asking = threading.Thread(target=lambda: answers.append(Client(url).ask("GET", path)))
            asking.start()
            assert begun.wait(PATIENCE_S)
        asking.join(PATIENCE_S)
    finally:
        ended.set()
    assert answers[0][0] == 503 and b"has ended" in answers[0][2]
    assert capfd.readouterr().err == ""


def test_a_folder_without_images_is_refused_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="make one and put the photographs there"):
        open_folder(tmp_path)
