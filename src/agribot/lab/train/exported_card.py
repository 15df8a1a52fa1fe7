"""The card of a file that `agribot export` made of another one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray
from agribot.lab.train.card import (
    ModelCard,
    describe_speed_conditions,
    hash_file,
    measure_cpu_ms_per_frame,
)
from agribot.lab.train.doubt_limit import find_most_doubt


def write_card(
    source: Path, target: Path, precision: str, pictures: Sequence[ByteArray] = ()
) -> None:
    """Write the card of `source` beside `target`, with what is different of that file.

    `pictures` that the network knows limit its doubt anew. Scores are those of the source, which
    the card says. A source without a card has none to give.

    Raises: ConfigError: the card of the source cannot be read.
    """
    path = source.with_suffix(".json")
    if not path.is_file():
        return
    try:
        card = msgspec.json.decode(path.read_bytes(), type=ModelCard)
    except (OSError, msgspec.DecodeError) as error:
        raise ConfigError(f"{path}: is no card of a network ({error}); move it away") from error
    network = Segmenter(target)
    height_px, width_px = network.map_shape
    most_doubt = find_most_doubt(network, pictures) or card.most_doubt
    msgspec.structs.replace(
        card,
        exported_from=card.exported_from or card.sha256,
        precision=precision,
        input_height_px=height_px,
        input_width_px=width_px,
        file_bytes=target.stat().st_size,
        sha256=hash_file(target),
        cpu_ms_per_frame=round(measure_cpu_ms_per_frame(network), 1),
        cpu_ms_conditions=describe_speed_conditions(threads=1),
        most_doubt=most_doubt,
    ).write(target)
