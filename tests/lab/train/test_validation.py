"""The curve of a training on pictures set aside, and the step whose weights are kept."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from agribot.autonomy.perceive.stems import CELL_PX, PlantMaps
from agribot.core.messages import FloatArray, PlantClass
from agribot.lab.train.fit import LOG, Trainer, TrainingPlan
from agribot.lab.train.judged_figures import MIOU, STEM_F1
from agribot.lab.train.network import CropWeedNet
from agribot.lab.train.plant_network import PlantNet
from agribot.lab.train.plant_targets import WAY, WAY_UNIT_PX
from agribot.lab.train.plant_truth import DrawnView, PlantTruth
from agribot.lab.train.standing import BestSoFar, Judgement
from agribot.lab.train.validation import HeldOutPictures, count_stems
from tests.lab.train.drawn_images import SHAPE, batch_of_four, drawn_image
from tests.lab.train.whole_pictures import join_target_heat, tell_targets

PLAN = TrainingPlan(
    steps=8, batch_size=4, crop_px=64, bf16=False, checkpoint_every=1, judge_every=2
)
BEST_STEP = 4


def quiet(text: str) -> None:
    pass


class LikesTheSecond:
    """A judge that likes what it sees second best, and remembers it."""

    def __init__(self, seen: int = 0, last: int = 100) -> None:
        self.seen, self._last = seen, last
        self.kept: dict[str, Tensor] = {}

    def __call__(self, network: nn.Module) -> Judgement:
        self.seen += 1
        if self.seen > self._last:
            raise KeyboardInterrupt
        if self.seen == 2:
            self.kept = {name: value.clone() for name, value in network.state_dict().items()}
        return {MIOU: 0.9 if self.seen == 2 else 0.1 * self.seen}


def train(folder: Path, judge: LikesTheSecond) -> dict[str, Tensor]:
    return Trainer(PLAN, batch_of_four, folder, judge=judge).run(quiet).state_dict()


@pytest.fixture(scope="module")
def judged(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, LikesTheSecond, dict[str, Tensor]]:
    torch.set_num_threads(1)
    folder, judge = tmp_path_factory.mktemp("judged"), LikesTheSecond()
    return folder, judge, train(folder, judge)


def is_same(one: dict[str, Tensor], other: dict[str, Tensor]) -> bool:
    return all(torch.equal(one[name], other[name]) for name in other)


def test_the_weights_of_the_step_that_the_judge_liked_best_are_kept(
    judged: tuple[Path, LikesTheSecond, dict[str, Tensor]], tmp_path: Path
) -> None:
    _, judge, weights = judged
    assert judge.seen == PLAN.steps // PLAN.judge_every
    assert is_same(weights, judge.kept)
    unjudged = Trainer(PLAN, batch_of_four, tmp_path).run(quiet).state_dict()
    assert not is_same(unjudged, judge.kept)


def test_they_outlast_a_kill(
    judged: tuple[Path, LikesTheSecond, dict[str, Tensor]], tmp_path: Path
) -> None:
    with pytest.raises(KeyboardInterrupt):
        train(tmp_path, LikesTheSecond(last=2))
    again = train(tmp_path, LikesTheSecond(seen=2))
    assert is_same(again, judged[2])


def test_the_curve_stands_in_the_log(
    judged: tuple[Path, LikesTheSecond, dict[str, Tensor]],
) -> None:
    with (judged[0] / LOG).open(encoding="utf-8") as file:
        curve = {int(row["step"]): row[MIOU] for row in csv.DictReader(file)}
    assert [step for step, value in curve.items() if value] == [2, 4, 6, 8]
    assert float(curve[BEST_STEP]) == 0.9


def test_a_score_that_is_no_number_is_never_the_best() -> None:
    best, network = BestSoFar(), nn.Linear(1, 1)
    best.consider({MIOU: 0.2}, 1, network)
    best.consider({MIOU: math.nan}, 2, network)
    assert best.step == 1


def draw_view(*stems_px: tuple[float, float], kind: PlantClass = PlantClass.CROP) -> DrawnView:
    """Draw plants as discs of 10 px about their stems."""
    rows, columns = np.indices(SHAPE)
    label = np.full(SHAPE, PlantClass.SOIL, dtype=np.uint8)
    number = np.zeros(SHAPE, dtype=np.uint16)
    for index, (u, v) in enumerate(stems_px, 1):
        disc = np.hypot(columns - u, rows - v) <= 10.0
        label[disc], number[disc] = kind, index
    image_rgb = np.repeat(label[..., None], 3, axis=2) * 80
    kinds = np.full(len(stems_px), kind, dtype=np.uint8)
    return DrawnView(image_rgb, label, PlantTruth(number, np.array(stems_px), kinds))


def answer_truly(view: DrawnView, moved_px: tuple[float, float] = (0.0, 0.0)) -> PlantMaps:
    plants = PlantTruth(view.plants.number, view.plants.stem_px + moved_px, view.plants.kind)
    target = tell_targets(view.label, plants)
    return PlantMaps(
        stem_score=(255.0 * join_target_heat(target)).astype(np.uint8),
        way_px=target[WAY] * WAY_UNIT_PX,
    )


@pytest.mark.parametrize(
    ("moved_px", "counts"), [((0.0, 0.0), (2, 2, 2)), ((3.0 * CELL_PX + 1.0, 0.0), (0, 2, 2))]
)
def test_stems_count_where_they_stand(moved_px: tuple[float, float], counts: FloatArray) -> None:
    view = draw_view((30.0, 40.0), (90.0, 50.0))
    np.testing.assert_array_equal(count_stems(answer_truly(view, moved_px), view.plants), counts)


def test_a_stem_of_the_other_class_is_a_miss_and_a_false_find() -> None:
    view, other = draw_view((30.0, 40.0)), draw_view((30.0, 40.0), kind=PlantClass.WEED)
    np.testing.assert_array_equal(count_stems(answer_truly(other), view.plants), (0, 1, 1))


def test_classes_and_stems_are_judged_at_the_size_of_the_network() -> None:
    rng = np.random.default_rng(3)
    classes = HeldOutPictures([drawn_image(rng) for _ in range(2)], (64, 96))(CropWeedNet())
    assert classes.keys() == {MIOU} and 0.0 <= classes[MIOU] <= 1.0
    both = HeldOutPictures([draw_view((30.0, 40.0))], SHAPE)(PlantNet())
    assert both.keys() == {MIOU, STEM_F1}
