"""Small pictures of weeds, cut from the frames in which they stood nearest to the middle.

They are kept by their place in the map, not by the map's numbers: a weed that is merged with
another, or confirmed later, finds its picture where it stands. A thread of its own cuts and
encodes; the control loop only leaves its newest scenes here.
"""

from __future__ import annotations

import io
import math
import threading
from collections import OrderedDict, deque
from collections.abc import Iterator

import msgspec
import numpy as np
from PIL import Image

from agribot.autonomy.perceive.ground import ground_to_pixels
from agribot.core.lens import distort
from agribot.core.messages import ByteArray, FloatArray, GroundPlant, PlantClass, Scene, TickRecord
from agribot.core.robot import RobotSpec
from agribot.ui.robot_side.recent_frames import RecentFrames, SeenFrame

KEPT = 2000
MAX_BYTES = 10_000
QUALITIES = (80, 60, 40, 20)
SHOWN_PX = 128  # side of a larger cut
CUT_PX = (64, 224)
CUT_RATIO = 3.0  # side of a cut over the plant's diameter
WAITING = 4  # scenes; older ones are left out when the thread has no time
GAIN_RATIO = 0.75  # distance from the middle, over that of the last picture, for a new one
MIDDLE_PX = 20.0  # near enough


class PlantPicture(msgspec.Struct, frozen=True, kw_only=True):
    x_map_m: float
    y_map_m: float
    t_s: float
    off_middle_px: float
    jpeg: bytes


class PlantPictures:
    """A tap; `near` may be asked in any thread. The newest `kept` pictures stay in memory."""

    def __init__(
        self, robot: RobotSpec, frames: RecentFrames, reach_m: float, kept: int = KEPT
    ) -> None:
        """Weeds nearer to each other than `reach_m` may share a picture."""
        self._robot, self._frames = robot, frames
        self._reach_m, self._kept = reach_m, kept
        self._pictures: OrderedDict[int, PlantPicture] = OrderedDict()
        self._cells: dict[tuple[int, int], set[int]] = {}
        self._number = 0
        self._lock = threading.Lock()
        self._scenes: deque[Scene] = deque(maxlen=WAITING)
        self._wake = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="ui-plants", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._ended = True
        self._wake.set()

    def __call__(self, record: TickRecord) -> None:
        if record.scenes:
            self._scenes.extend(record.scenes)
            self._wake.set()

    def near(self, x_map_m: float, y_map_m: float) -> PlantPicture | None:
        """Find the picture of what stands nearest to a place, within `reach_m`."""
        with self._lock:
            number = self._nearest(x_map_m, y_map_m)
            return None if number is None else self._pictures[number]

    def see(self, scene: Scene, shot: SeenFrame) -> None:
        """Cut the weeds of a scene that stand better in its frame than in any before."""
        camera, pose = self._robot.camera, shot.estimate
        weeds = [plant for plant in scene.plants if plant.plant == PlantClass.WEED]
        if camera is None or not pose.ok or not weeds:
            return
        centres_px, sizes_px = self._in_frame(weeds)
        middle_px = np.array([camera.width_px - 1, camera.height_px - 1]) / 2.0
        cos_yaw, sin_yaw = math.cos(pose.yaw_map_rad), math.sin(pose.yaw_map_rad)
        for plant, centre_px, size_px in zip(weeds, centres_px, sizes_px, strict=True):
            off_px = float(np.linalg.norm(centre_px - middle_px))
            x_m = pose.x_map_m + cos_yaw * plant.x_body_m - sin_yaw * plant.y_body_m
            y_m = pose.y_map_m + sin_yaw * plant.x_body_m + cos_yaw * plant.y_body_m
            with self._lock:
                before = self._nearest(x_m, y_m)
                best = math.inf if before is None else self._pictures[before].off_middle_px
            if not max(off_px, MIDDLE_PX) < GAIN_RATIO * best:
                continue
            leaves_px = _leaves(shot, centre_px, float(size_px))
            jpeg = _encode(_cut(shot.frame.image_rgb, leaves_px, float(size_px)))
            picture = PlantPicture(
                x_map_m=x_m, y_map_m=y_m, t_s=scene.t_s, off_middle_px=off_px, jpeg=jpeg
            )
            with self._lock:
                self._keep(picture, before)

    def _run(self) -> None:
        while True:
            self._wake.wait()
            self._wake.clear()
            while self._scenes and not self._ended:
                scene = self._scenes.popleft()
                shot = self._frames.of(scene.frame_index)
                if shot is not None:
                    self.see(scene, shot)
            if self._ended:
                return

    def _in_frame(self, plants: list[GroundPlant]) -> tuple[FloatArray, FloatArray]:
        """Pixels (N, 2) and diameters in pixels (N,) of plants, the lens included."""
        camera, mount = self._robot.camera, self._robot.body_from_camera()
        assert camera is not None
        feet_m = np.array([(plant.x_body_m, plant.y_body_m) for plant in plants])
        radii_m = np.sqrt([plant.area_m2 / math.pi for plant in plants])
        sides_m = feet_m + np.column_stack([np.zeros(len(plants)), radii_m])
        k_px = camera.matrix()
        seen = [ground_to_pixels(points, k_px, mount) for points in (feet_m, sides_m)]
        sizes_px: FloatArray = 2.0 * np.linalg.norm(seen[1] - seen[0], axis=1)
        ideal = (seen[0] - k_px[:2, 2]) / camera.focal_px
        centres_px: FloatArray = distort(ideal, camera.distortion) * camera.focal_px
        return centres_px + k_px[:2, 2], sizes_px

    def _nearest(self, x_m: float, y_m: float) -> int | None:
        gaps = [
            (math.hypot(self._pictures[n].x_map_m - x_m, self._pictures[n].y_map_m - y_m), n)
            for n in self._around(x_m, y_m)
        ]
        gap_m, number = min(gaps, default=(math.inf, 0))
        return number if gap_m <= self._reach_m else None

    def _around(self, x_m: float, y_m: float) -> Iterator[int]:
        column, row = self._cell(x_m, y_m)
        for i in (column - 1, column, column + 1):
            for j in (row - 1, row, row + 1):
                yield from self._cells.get((i, j), ())

    def _keep(self, picture: PlantPicture, instead: int | None) -> None:
        if instead is not None:
            self._drop(instead)
        while len(self._pictures) >= self._kept:
            self._drop(next(iter(self._pictures)))
        self._number += 1
        self._pictures[self._number] = picture
        cell = self._cell(picture.x_map_m, picture.y_map_m)
        self._cells.setdefault(cell, set()).add(self._number)

    def _drop(self, number: int) -> None:
        picture = self._pictures.pop(number)
        cell = self._cell(picture.x_map_m, picture.y_map_m)
        self._cells[cell].discard(number)
        if not self._cells[cell]:
            del self._cells[cell]

    def _cell(self, x_m: float, y_m: float) -> tuple[int, int]:
        return math.floor(x_m / self._reach_m), math.floor(y_m / self._reach_m)


def _leaves(shot: SeenFrame, foot_px: FloatArray, size_px: float) -> FloatArray:
    """Find the middle of the pixels called weed about a plant's foot."""
    rows, columns = np.nonzero(shot.class_id == PlantClass.WEED)
    scale = np.divide(shot.frame.image_rgb.shape[:2], shot.class_id.shape)[::-1]
    weed_px = (np.column_stack([columns, rows]) + 0.5) * scale - 0.5
    weed_px = weed_px[np.linalg.norm(weed_px - foot_px, axis=1) <= size_px]
    centre: FloatArray = weed_px.mean(axis=0) if len(weed_px) else foot_px
    return centre


def _cut(image_rgb: ByteArray, centre_px: FloatArray, size_px: float) -> ByteArray:
    """Cut a square about a pixel, moved into the image where it would stand out."""
    height, width = image_rgb.shape[:2]
    least, most = CUT_PX
    side = min(max(round(CUT_RATIO * size_px), least), most, height, width)
    left, top = (
        int(np.clip(round(float(centre)) - side // 2, 0, length - side))
        for centre, length in zip(centre_px, (width, height), strict=True)
    )
    return image_rgb[top : top + side, left : left + side]


def _encode(pixels: ByteArray) -> bytes:
    image = Image.fromarray(np.ascontiguousarray(pixels))
    image.thumbnail((SHOWN_PX, SHOWN_PX))
    for quality in QUALITIES:
        buffer = io.BytesIO()
        image.save(buffer, format="JPEG", quality=quality)
        if buffer.tell() <= MAX_BYTES:
            break
    return buffer.getvalue()
