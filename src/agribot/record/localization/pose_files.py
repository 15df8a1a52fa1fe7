"""Poses as files, written while the filter runs: poses.csv, poses.tum, poses.gpx, estimate.mcap."""

from __future__ import annotations

import contextlib
import csv
import math
from pathlib import Path
from types import TracebackType
from typing import TextIO

import msgspec

from agribot.core import topics
from agribot.core.errors import explain_os_error
from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import Estimate, SensorBatch
from agribot.core.robot import RobotSpec
from agribot.record.bag.track import GeoTrack, TrackPoint, encode_track
from agribot.record.mcap_file import McapFile
from agribot.record.report import write_file
from agribot.ros.messages import cdr, rosmsg
from agribot.ros.messages.transforms import BodyTransforms, make_static_transforms

# Least time between written poses, s.
PERIOD_S = 0.05
GPX_PERIOD_S = 1.0
COLUMNS = (
    "stamp_s", "t_s", "x_map_m", "y_map_m", "yaw_map_rad", "lat_deg", "lon_deg", "xx_m2", "xy_m2",
    "yy_m2", "pos_std_m", "yaw_std_rad", "v_mps", "yaw_rate_radps", "ok",
)  # fmt: skip


class PoseFiles:
    """Writes `poses.csv`, `poses.tum` and, where wanted, `poses.gpx` into a folder.

    The stamps are those of the log. TUM is what evo reads: stamp, place and quaternion.
    """

    def __init__(self, folder: Path, datum: Datum, start_stamp_s: float, *, has_gpx: bool) -> None:
        """Begin the files. Raises: RecordingError: they cannot be written."""
        self._folder, self._frame, self._start_s = folder, MapFrame(datum), start_stamp_s
        self._files = contextlib.ExitStack()
        self._csv, self._tum = self._open("poses.csv"), self._open("poses.tum")
        self._table = csv.writer(self._csv, lineterminator="\n")
        self._table.writerow(COLUMNS)
        self._gpx: list[TrackPoint] | None = [] if has_gpx else None
        self._last_s = -math.inf

    def __enter__(self) -> PoseFiles:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._files.close()

    def add(self, estimate: Estimate) -> None:
        """Add a pose, unless the last one is only just past."""
        if estimate.t_s - self._last_s < PERIOD_S - 1e-9:
            return
        self._last_s = estimate.t_s
        stamp_s = self._start_s + estimate.t_s
        e, half_rad = estimate, estimate.yaw_map_rad / 2.0
        lat_deg, lon_deg, alt_m = self._frame.geodetic_from_map(e.x_map_m, e.y_map_m)
        xx, xy, _, _, yy, *_ = e.pose_cov
        self._table.writerow(
            (f"{stamp_s:.6f}", f"{e.t_s:.3f}", f"{e.x_map_m:.4f}", f"{e.y_map_m:.4f}",
             f"{e.yaw_map_rad:.5f}", f"{lat_deg:.9f}", f"{lon_deg:.9f}", f"{xx:.6g}", f"{xy:.6g}",
             f"{yy:.6g}", f"{e.pos_std_m:.4f}", f"{e.yaw_std_rad:.5f}", f"{e.v_mps:.4f}",
             f"{e.yaw_rate_radps:.5f}", int(e.ok))
        )  # fmt: skip
        self._tum.write(
            f"{stamp_s:.6f} {e.x_map_m:.4f} {e.y_map_m:.4f} 0 0 0 {math.sin(half_rad):.7f} "
            f"{math.cos(half_rad):.7f}\n"
        )
        if self._gpx is not None and (
            not self._gpx or stamp_s - self._gpx[-1].t_s >= GPX_PERIOD_S - 1e-6
        ):
            self._gpx.append(
                TrackPoint(
                    t_s=stamp_s, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=alt_m, std_m=e.pos_std_m
                )
            )

    def write_gpx(self, name: str) -> None:
        """Write what was collected for poses.gpx."""
        if self._gpx is not None:
            track = GeoTrack(topic="estimate", points=tuple(self._gpx), without_fix=0)
            write_file(self._folder / "poses.gpx", encode_track(track, ".gpx", name))

    def _open(self, name: str) -> TextIO:
        path = self._folder / name
        with explain_os_error(f"cannot write {path}", "choose another --out"):
            path.parent.mkdir(parents=True, exist_ok=True)
            return self._files.enter_context(path.open("w", encoding="utf-8", newline=""))


class EstimateMcap:
    """Writes fixes, estimate and frames to `estimate.mcap`, for Foxglove, RViz and Rerun."""

    def __init__(self, path: Path, robot: RobotSpec, start_stamp_s: float) -> None:
        """Begin the file. Raises: RecordingError: it cannot be written."""
        self._file = McapFile(path)
        self._robot, self._start_s = robot, start_stamp_s
        self._odometry, self._frames = cdr.OdometryCdr(), BodyTransforms()
        self._imu = cdr.ImuCdr(robot.imu.link)
        self._has_begun = False

    def add(self, batch: SensorBatch, estimate: Estimate | None) -> None:
        now_ns = rosmsg.to_nanoseconds(self._start_s + batch.t_s)
        if not self._has_begun:
            self._has_begun = True
            frames = make_static_transforms(self._robot)
            self._file.write(topics.TF_STATIC, now_ns, rosmsg.to_cdr(frames), now_ns)
        for sample in batch.imu:
            t_ns = rosmsg.to_nanoseconds(self._start_s + sample.t_s)
            self._file.write(topics.IMU, now_ns, self._imu(t_ns, sample), t_ns)
        for fix in batch.gnss:
            stamped = msgspec.structs.replace(fix, t_s=self._start_s + fix.t_s)
            data = rosmsg.to_cdr(rosmsg.make_fix(stamped, self._robot.gnss.link))
            self._file.write(topics.FIX, now_ns, data, rosmsg.to_nanoseconds(stamped.t_s))
        if estimate is not None:
            data = self._odometry(now_ns, estimate)
            self._file.write(topics.ODOMETRY, now_ns, data, now_ns)
            self._file.write(topics.TF, now_ns, self._frames(now_ns, estimate), now_ns)

    def close(self) -> None:
        self._file.close()
