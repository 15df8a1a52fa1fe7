"""Pictures of a log through the network and the rows: what its camera saw, and where."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agribot.app.localization.bag_messages import read_stamp_s
from agribot.app.localization.localize import LocalizedTick
from agribot.app.localization.log_files import list_bags
from agribot.autonomy.perceive.picture_rows import find_rows, measure_contrast
from agribot.autonomy.perceive.pictures import see_picture
from agribot.autonomy.perceive.plant_cover import excess_green, measure_cover
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.autonomy.perceive.unfit import find_unfit
from agribot.core.errors import BridgeError, RecordingError
from agribot.core.fact_text import render
from agribot.core.messages import ByteArray, CameraFrame, FloatArray, PlantClass
from agribot.core.pose import Pose2
from agribot.record.bag.opening import open_bag
from agribot.record.bag.source import BagTopic
from agribot.record.localization.camera import CameraStudy, ViewedPicture, tint_plants
from agribot.record.picture_files import reduce_width
from agribot.ros.messages.sensor_readers import make_image_readers

MOST_PICTURES = 30  # looked at, evenly over the log; one takes about 1.3 CPU-s
LEAST_PICTURES = 4  # least pictures with plants in which rows of one camera are found
LEAST_PLANTS_RATIO = 0.002  # share of plants in a picture below which no row is sought
WIDTH_PX = 640  # width of a picture in the search; a larger one is reduced
# Probability above which a row line counts as the right one.
LEAST_SURE = 0.5
ANY = "auto"  # names the topic with the most pictures


class LoggedPicture(NamedTuple):
    stamp_s: float
    image_rgb: ByteArray


class PicturePoses:
    """A tap of the filter that keeps the pose at the time of each picture."""

    def __init__(self, times_s: Sequence[float]) -> None:
        self._waiting = sorted(set(times_s), reverse=True)
        self.poses: dict[float, Pose2] = {}

    def __call__(self, tick: LocalizedTick) -> None:
        while self._waiting and self._waiting[-1] <= tick.batch.t_s:
            t_s, estimate = self._waiting.pop(), tick.estimate
            if estimate is not None:
                place = estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad
                self.poses[t_s] = Pose2(*place)


def find_camera(paths: Sequence[Path], topic: str) -> tuple[Path, BagTopic]:
    """Find the topic of pictures in the bags of a log; ANY is the one with the most pictures.

    Raises: RecordingError: no bag has it, or it holds no pictures.
    """
    kinds = make_image_readers(None)
    found: list[tuple[Path, BagTopic]] = []
    for path in list_bags(paths):
        with open_bag(path) as bag:
            found += [(path, each) for each in bag.topics if each.ros_type in kinds and each.count]
    named = [each for each in found if topic in (ANY, each[1].name)]
    if named:
        return max(named, key=lambda each: each[1].count)
    others = ", ".join(sorted({each.name for _, each in found}))
    raise RecordingError(
        f"--camera {topic}: the log has no pictures there; "
        + (f"name one of {others}" if others else "leave out --camera, it has no pictures at all")
    )


def study_pictures(
    camera: tuple[Path, BagTopic],
    network: Segmenter,
    start_stamp_s: float,
    on_progress: Callable[[int], None] = lambda done: None,
    *,
    uses_log_times: bool = False,
) -> CameraStudy:
    """Look at pictures of a topic, evenly over the log; their poses are not known yet.

    Raises: RecordingError: none can be read.
    """
    path, topic = camera
    seen: list[ViewedPicture] = []
    contrasts: list[FloatArray] = []
    refused: list[str] = []
    for picture in _read(path, topic, refused, uses_log_times=uses_log_times):
        one, contrast = _look(picture, network, start_stamp_s)
        seen.append(one)
        contrasts.append(contrast)
        on_progress(len(seen))
    if not seen:
        why = f": {refused[0]}" if refused else ""
        raise RecordingError(
            f"{topic.name}: not one of {topic.count} pictures can be read{why}; choose another "
            "topic"
        )
    _add_rows(seen, contrasts)
    return CameraStudy(
        topic=topic.name, kind=topic.ros_type, messages=topic.count, refused=tuple(refused),
        network=network.path.stem, pictures=tuple(seen),
    )  # fmt: skip


def _read(
    path: Path, topic: BagTopic, refused: list[str], *, uses_log_times: bool
) -> Iterator[LoggedPicture]:
    """Read at most MOST_PICTURES of the topic, evenly."""
    step = max(1.0, topic.count / MOST_PICTURES)
    wanted = {int(k * step) for k in range(MOST_PICTURES)}
    read = make_image_readers(None)[topic.ros_type]
    with open_bag(path) as bag:
        for number, message in enumerate(bag.messages(frozenset({topic.name}))):
            if number not in wanted:
                continue
            try:
                value = bag.value(message)
                logged_s = message.log_ns * 1e-9
                stamp_s = logged_s if uses_log_times else read_stamp_s(value) or logged_s
                frame = read(value, stamp_s)
            except (BridgeError, RecordingError) as error:
                refused.append(str(error))
                continue
            if isinstance(frame, CameraFrame):
                yield LoggedPicture(stamp_s, reduce_width(frame.image_rgb, WIDTH_PX))


def _look(
    picture: LoggedPicture, network: Segmenter, start_stamp_s: float
) -> tuple[ViewedPicture, FloatArray]:
    """Count the classes of a picture, and measure its contrast for rows."""
    image_rgb = picture.image_rgb
    classes, class_map, _ = see_picture(network, image_rgb)
    one = ViewedPicture(
        t_s=picture.stamp_s - start_stamp_s,
        crop_ratio=float(np.mean(classes.class_id == PlantClass.CROP)),
        weed_ratio=float(np.mean(classes.class_id == PlantClass.WEED)),
        doubt=class_map.doubt,
        unfit=render(find_unfit(image_rgb, class_map)),
        shown=tint_plants(image_rgb, classes.class_id),
    )
    cover = measure_cover(excess_green(image_rgb), classes.class_id, classes.confidence)
    return one, measure_contrast(cover)


def _add_rows(seen: list[ViewedPicture], contrasts: Sequence[FloatArray]) -> None:
    """Find the rows of all pictures together, where enough of them show plants."""
    green = [
        k for k, one in enumerate(seen) if one.crop_ratio + one.weed_ratio >= LEAST_PLANTS_RATIO
    ]
    if len(green) < LEAST_PICTURES:
        return
    rows, _ = find_rows([contrasts[k] for k in green], np.random.default_rng(0))
    for k, found in zip(green, rows, strict=True):
        if found.sure >= LEAST_SURE:
            seen[k] = seen[k].with_rows(found)
