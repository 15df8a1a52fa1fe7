from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from agribot.autonomy.perceive.segmenter import Segmenter, model_path
from agribot.core.errors import PerceptionError
from agribot.lab.train.doubt_limit import MARGIN, find_most_doubt


def doubting(*doubts: float | None) -> Any:
    answers = iter(doubts)
    return SimpleNamespace(segment=lambda image_rgb: SimpleNamespace(doubt=next(answers)))


def find(*doubts: float | None) -> float | None:
    pictures = [np.zeros((2, 2, 3), np.uint8)] * len(doubts)
    return find_most_doubt(doubting(*doubts), pictures)


def test_the_limit_lies_above_the_doubt_of_pictures_that_a_network_knows() -> None:
    assert find(*[0.3] * 99, 0.9) == pytest.approx(0.3 + MARGIN)
    assert find(0.95, 0.95, None) == 1.0


def test_a_network_that_doubts_nothing_has_no_limit() -> None:
    assert find(None, None) is None
    assert find() is None


def test_a_network_reads_its_limit_from_the_card_beside_it(tmp_path: Path) -> None:
    picture = np.zeros((48, 64, 3), np.uint8)
    assert Segmenter("agribot-plants").segment(picture).most_doubt == 0.665
    copy = tmp_path / "alone.onnx"
    copy.write_bytes(model_path("agribot-sim").read_bytes())
    assert Segmenter(copy).segment(picture).most_doubt is None
    copy.with_suffix(".json").write_text('{"most_doubt": "much"}')
    with pytest.raises(PerceptionError, match=r"alone\.json: is no card of a network"):
        Segmenter(copy)
