"""Sensors that contradict each other or themselves: named, and left to a person where need be."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from agribot.autonomy.estimate.filter.ekf import X, Y
from agribot.autonomy.estimate.filter.lateness import Lateness, LeapWatch
from agribot.autonomy.estimate.filter.odometry import Odometry
from agribot.autonomy.estimate.filter.row_model import RECOVERY_OFFSET_M, RECOVERY_YAW_RAD
from agribot.autonomy.estimate.sensors.gnss import SUSPICIOUS_REJECTIONS, Gnss
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.autonomy.estimate.witnesses.crop_watch import CropWatch
from agribot.autonomy.estimate.witnesses.fitness_watch import FitnessWatch
from agribot.autonomy.estimate.witnesses.fix_watch import MAX_JUMP_M
from agribot.autonomy.estimate.witnesses.mirror_watch import MirrorWatch
from agribot.autonomy.estimate.witnesses.picture_flow import PictureFlow
from agribot.autonomy.estimate.witnesses.picture_watch import PictureWatch
from agribot.autonomy.estimate.witnesses.scene_watch import SceneWatch
from agribot.autonomy.estimate.witnesses.witness import FedWatch, Finding, Witness
from agribot.core.facts import CameraAndGnssDisagree, Fact, FixesRejected
from agribot.core.messages import GnssQuality, Scene, SensorBatch
from agribot.core.plugins import WITNESSES, bind_all, find_used

# Least time for which a person needs to read a question and to look.
READ_S = 3.0


def load_witnesses(plugins: Mapping[str, Any]) -> dict[str, Callable[[PoseFilter], Witness]]:
    """Take the witnesses of installed packages, with their settings.

    Args:
        plugins: `RunConfig.plugins`, which names the installed ones that are used.

    Raises: ConfigError: a package cannot be imported, or its settings do not fit.
    """
    return bind_all(find_used(WITNESSES, plugins), plugins)


class Doubts:
    """`contradiction` halts a mission until a person decides, `find` only says what is wrong.

    `others` are the witnesses of installed packages; all stand in one table.
    """

    def __init__(
        self, pose: PoseFilter, gnss: Gnss, odometry: Odometry, others: Sequence[Witness] = ()
    ) -> None:
        self._pose, self._gnss, self._agreement = pose, gnss, pose.agreement
        self._odometry, self._others = odometry, others
        self._asked: Fact | None = None  # a question of an installed witness to a person
        self._identity, self._lines = pose.identity, pose.lines
        self._pictures, self._flow, self._camera = PictureWatch(), PictureFlow(), SceneWatch()
        self._mirror, self._fitness = MirrorWatch(), FitnessWatch()
        self.crop = CropWatch()
        self.leaps, self._imu_lateness = LeapWatch(), Lateness()
        self._moving_t_s = -math.inf
        # Since when the present contradiction stands, and the time of the last batch.
        self._since_s = self._now_s = math.inf
        self._witnesses = self._list_witnesses()

    def _list_witnesses(self) -> tuple[Witness, ...]:
        """List what is asked of each sensor; of two that find something the first counts."""
        gnss, agreement, turns = self._gnss, self._agreement, self._pose.turns
        antenna = gnss.velocity.antenna
        return (
            FedWatch("gnss", "contradicted", lambda t_s: self._find_moved_fixes(), gnss.forget),
            FedWatch("gnss", "frozen", lambda t_s: gnss.repeats.fault),
            FedWatch("camera", "silent", self._camera.silence),
            FedWatch("camera", "frozen", lambda t_s: self._pictures.fault),
            FedWatch("camera", "contradicted", lambda t_s: self._flow.fault),
            FedWatch("camera", "contradicted", lambda t_s: self._mirror.fault),
            FedWatch("camera", "contradicted", lambda t_s: self._lines.fault, self._lines.forget),
            FedWatch("camera", "contradicted", lambda t_s: self._pose.line_noise.fault),
            FedWatch("camera", "late", lambda t_s: self._camera.lateness),
            FedWatch("camera", "contradicted", lambda t_s: self.of_plants),
            FedWatch("camera", "contradicted", lambda t_s: agreement.fault, agreement.forget),
            FedWatch("gnss", "contradicted", lambda t_s: agreement.fault),
            FedWatch("gnss", "contradicted", lambda t_s: self._count_rejected()),
            FedWatch("gnss", "contradicted", lambda t_s: antenna.find(is_left_open=False)),
            FedWatch("wheels", "contradicted", gnss.velocity.spin_fault),
            FedWatch("gnss", "contradicted", lambda t_s: gnss.position_noise.fault),
            FedWatch("gnss", "contradicted", lambda t_s: gnss.velocity.noise.fault),
            FedWatch("gyro", "contradicted", turns.gyro_fault),
            FedWatch("gyro", "late", self._imu_lateness.fault),
            FedWatch("compass", "contradicted", turns.compass_fault),
            FedWatch("clock", "contradicted", self.leaps.fault),
            *self._others,
        )

    def update(self, batch: SensorBatch) -> None:
        """Let the witnesses hear a batch, and drop doubts that were not reported for long."""
        self._agreement.expire(batch.t_s)
        self._imu_lateness.add(batch.t_s, self._odometry.imu_t_s)
        for witness in self._others:  # the filter feeds all else
            witness.update(batch)
        found = (each for witness in self._others for each in witness.findings(batch.t_s))
        self._asked = next((each.fact for each in found if each.must_ask), None)
        self._now_s = batch.t_s
        self._since_s = min(self._since_s, batch.t_s) if self.contradiction else math.inf

    def move(self, t_s: float) -> None:
        """Note that the robot moves."""
        self._moving_t_s = t_s

    def is_refused(self, scene: Scene, now_s: float) -> bool:
        """Whether the scene is of an old picture again, or of one turned over, or unfit."""
        self._camera.hear(scene, now_s)
        self._fitness.hear(scene)
        then = self._pose.history.at(scene.t_s)
        if self._pictures.is_stale(scene, then):
            self._pose.rejected["picture not new"] += 1
            return True
        if scene.unfit:
            self._pose.rejected["picture unfit"] += 1
            return True
        was_turned_over = self._is_turned_over
        self._flow.add(scene, then)
        self._mirror.add(scene, then)
        if self._is_turned_over:
            is_reversed = self._flow.is_reversed
            self._pose.rejected["picture upside down" if is_reversed else "picture mirrored"] += 1
            if not was_turned_over:
                self._pose.doubt_rows(RECOVERY_OFFSET_M, RECOVERY_YAW_RAD)
        return self._is_turned_over

    @property
    def _is_turned_over(self) -> bool:
        return self._flow.is_reversed or self._mirror.is_mirrored

    def is_held(self, t_s: float) -> bool:
        """Whether the camera holds the robot on its row."""
        return self._agreement.is_held(t_s)

    @property
    def of_plants(self) -> Fact | None:
        """Why no tool may work by what the camera calls weed and crop; None where it may."""
        return self._fitness.fault or self.crop.fault

    @property
    def contradiction(self) -> Fact | None:
        """Two sensors that cannot both be right, a row that may be another, or nothing."""
        agreement, jump = self._agreement, self._gnss.jump
        if (moved := self._lines.fault) is not None:
            return moved
        if agreement.must_halt:
            return CameraAndGnssDisagree(agreement.doubted_m, is_left_open=True)
        if 0.0 < jump.off_m <= MAX_JUMP_M and self._is_seen:
            return CameraAndGnssDisagree(jump.off_m, is_left_open=True)
        fixes = jump.fault or self._gnss.drift.fault
        own = fixes or self._carried or self._aside or self._identity.doubt
        return own or self._asked

    @property
    def _carried(self) -> Fact | None:
        is_judged = self._pose.first_heading.check.is_under_way
        return self._gnss.velocity.carry.find(is_heading_sure=not is_judged)

    @property
    def _aside(self) -> Fact | None:
        """Why fixes that claim centimetres put the robot beside its rows; None where they do not.

        A receiver without corrections is off by more, whatever its antenna is.
        """
        is_fixed = self._gnss.quality is GnssQuality.RTK_FIXED
        return self._gnss.velocity.antenna.find(is_left_open=True) if is_fixed else None

    def find(self, t_s: float) -> Iterator[Finding]:
        """Find what is wrong with the sensors, although there is a pose without them."""
        for witness in self._witnesses:
            yield from witness.findings(t_s)

    def _find_moved_fixes(self) -> Fact | None:
        """Find fixes that jumped or crept, by what is asked of a person where something is."""
        gnss = self._gnss
        is_moved = gnss.jump.off_m or gnss.drift.is_drifting
        return self.contradiction if is_moved else gnss.drift.suspicion or gnss.drift.slow.fault

    def _count_rejected(self) -> Fact | None:
        count = self._gnss.rejected_in_a_row
        if count < SUSPICIOUS_REJECTIONS:
            return None
        can_be_robot = not self._gnss.is_disowned or self._carried is not None
        return FixesRejected(count, self._pose.config.recover_after, can_be_robot)

    def decide(self) -> bool:
        """Go on as a person decided on the spot; False: nothing was in doubt.

        A robot on a row that the camera saw goes on along it, and what GNSS says otherwise counts
        as an error of the receiver; anywhere else the fixes count. A request that comes within
        READ_S of the question is ignored, as it cannot be an answer.
        """
        if self.contradiction is None:
            is_doubted = self._gnss.drift.slow.doubt is not None
            self._gnss.drift.slow.restart()
            return is_doubted
        if not self._now_s - self._since_s >= READ_S:
            return False
        self._asked = None
        for witness in self._others:
            witness.forget()
        agreement, gnss, ekf = self._agreement, self._gnss, self._pose.ekf
        is_seen = self._is_seen
        if agreement.must_halt and not gnss.jump.off_m:
            camera_m, fixes_m = agreement.shown_m
            (east, north), apart_m = self._right, fixes_m - camera_m
            gnss.shift((apart_m * east, apart_m * north))
            for state, part in ((X, east), (Y, north)):
                ekf.x[state] += camera_m * part
                ekf.inflate(state, (apart_m * part / 2.0) ** 2)
            gnss.drift.restart()  # it is part of the difference
        gnss.settle(believes_fixes=not is_seen)
        agreement.forget()
        self._lines.forget()
        self._identity.confirm_row()
        return True

    def forget(self) -> None:
        """Drop what was held against each other: a person says where the robot is."""
        for witness in self._witnesses:
            witness.forget()
        self._identity.confirm_row()

    @property
    def _right(self) -> tuple[float, float]:
        """Across the rows where the robot is, unit vector of the map."""
        x = self._pose.ekf.x
        return self._pose.rows.at(x[X], x[Y]).right

    @property
    def _is_seen(self) -> bool:
        """Whether the camera held the robot on its row until it came to rest."""
        return self._agreement.must_halt or self._agreement.is_held(self._moving_t_s)
