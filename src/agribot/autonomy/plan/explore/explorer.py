"""Find the rows of an unmapped field, and lead the robot over each of them once.

It drives straight ahead until the camera shows a row. From the row's end it goes astride the row
and follows what the camera sees of it; from its side it first drives beside it to its end. While
it drives a row it looks for others beside it (`row_order.py`); the field is done when no row is
left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from agribot.autonomy.plan.explore.beside import Beside
from agribot.autonomy.plan.explore.crop_view import CropView, see_crop
from agribot.autonomy.plan.explore.first_row import FirstRow
from agribot.autonomy.plan.explore.found_row import FoundRow
from agribot.autonomy.plan.explore.lay import back_out, chain, join, lay_on, take_pose_at
from agribot.autonomy.plan.explore.row_order import RowOrder, Side
from agribot.autonomy.plan.ways.approach import plan_approach
from agribot.autonomy.plan.ways.curves import Segment, advance, sample
from agribot.core.config import MissionConfig
from agribot.core.facts import NoRowInView, RowOutOfView
from agribot.core.geo import wrap_rad
from agribot.core.messages import MapPoint, Path, Row, RowLine, Scene
from agribot.core.pose import Pose2
from agribot.core.robot import RobotSpec
from agribot.core.row_shape import chord_yaw_rad, reverse_row

SEARCH_M = 8.0
# Length of bare ground that ends a row; a shorter stretch is a gap.
END_GAP_M = 1.3
# Distance after which the path is laid anew by what the camera shows.
RELAY_M = 0.2
# Seen more aslant or farther aside than this, a row is not the one that the robot follows.
ASLANT_RAD, ASIDE_M = 0.4, 0.45
# A row is entered from before its end, or from its side if it is seen more aslant than this.
FACING_RAD, BEFORE_M = math.radians(50.0), 0.4
# Beside a row the robot drives this far from it, and as far as it can turn into it from its way.
BESIDE_M, TURN_M = 0.85, 0.6
# Before the end of the first row it backs out by BACK_M, to have room for the turn into it.
STOP_M, BACK_M = 0.15, 1.8
UNKNOWN_M = 4.0  # largest extension of a row past its last seen plant
SIDES: tuple[Side, Side] = (1, -1)

Phase = Literal["search", "beside", "row", "done"]


class Explorer:
    """Call `see` with every picture, `lead` with every tick of the drive along its path."""

    def __init__(self, mission: MissionConfig, robot: RobotSpec) -> None:
        self._mission, self._robot = mission, robot
        self.phase: Phase = "search"
        self._order = RowOrder()
        self.rows: tuple[Row, ...] = ()
        self._first, self._beside = FirstRow(), Beside()
        self._target: FoundRow | None = None
        self._towards = 1.0  # along the target's frame, or against it
        self._aside_m = 0.0  # offset of the path, to the left of the row as it is driven
        self._bare_m = -math.inf  # seen beyond the last crop of the target
        self._is_on_line = False
        self._laid_m = -math.inf
        self._has_news = False

    def begin(self, start: Pose2) -> Path:
        """Look for a row straight ahead."""
        return sample(start, [Segment(SEARCH_M, 0.0)])

    @property
    def found(self) -> list[FoundRow]:
        """Rows from the rightmost to the leftmost, those not driven yet among them."""
        return self._order.rows

    @property
    def unfinished(self) -> NoRowInView | RowOutOfView | None:
        """The missing part at the end of the way; None where the field is done."""
        if self.phase == "done":
            return None
        if self._target is None:
            return NoRowInView(SEARCH_M)
        return RowOutOfView(self._target.index + 1)

    def see(self, scene: Scene, pose: Pose2, pos_std_m: float) -> None:
        """Take in a picture that was taken at a pose, which is known to 1 sigma."""
        if scene.crop_cover is None:
            return
        view = see_crop(scene.crop_cover, pose)
        if self.phase == "search":
            self._first.look(view.crop_map_m)
            self._first.look_along(scene.row_line, pose)
            self._has_news = True
        elif self._target is not None and self.phase != "done":
            self._look_at(self._target, scene, view, pose, pos_std_m)

    def draw(self) -> list[tuple[list[MapPoint], float]]:
        """Draw the rows that were driven: the line of each, and its place's 1 sigma across."""
        return [(row.draw(), row.std_m) for row in self.found if row.is_driven]

    def _look_at(
        self, row: FoundRow, scene: Scene, view: CropView, pose: Pose2, pos_std_m: float
    ) -> None:
        along_m, _ = row.frame.locate(*pose.xy_m)
        line = row.line_at(along_m, self._towards)
        _, left_m = line.locate(*pose.xy_m)
        turned_rad = wrap_rad(pose.yaw_rad - line.yaw_rad)
        if abs(turned_rad) > ASLANT_RAD or abs(left_m - self._aside_m) > ASIDE_M:
            return
        row.pos_std_m, self._is_on_line, self._has_news = pos_std_m, True, True
        is_astride = self.phase == "row"
        sight = self._read_line(row, scene.row_line, pose) if is_astride else None
        row.add_crop(view, sight, is_astride=is_astride)
        self._bare_m = row.measure_bare_m(view.seen_map_m, self._towards, sight)
        if sight is not None:
            at_m, _ = row.frame.locate(*sight.xy_m)
            # Beside the line of this very picture, so that no drift of the pose is in it.
            self._beside.look(sight, at_m, *view)

    def _read_line(self, row: FoundRow, sight: RowLine | None, pose: Pose2) -> Pose2 | None:
        """Take in a picture's line of the row, and place it in the map; None where it has none."""
        if sight is None or sight.offset_m is None:
            return None
        along_m, _ = row.frame.locate(*pose.xy_m)
        _, left_m = row.line_at(along_m, self._towards).locate(*pose.xy_m)
        return row.add_line(sight, pose) if abs(sight.offset_m - left_m) <= ASIDE_M else None

    def lead(self, path: Path, s_m: float) -> Path | None:
        """Give the path on from `s_m`, where something new was seen; None to keep it.

        Raises: MissionError: no way leads to the row.
        """
        if not self._has_news:
            return None
        self._has_news = False
        if self.phase == "search":
            return self._approach_first(path, s_m)
        row = self._target
        if row is None or not self._is_on_line:
            return None
        if self._bare_m >= END_GAP_M:
            return self._leave(row, path, s_m)
        if s_m - self._laid_m < RELAY_M:
            return None
        self._laid_m = s_m
        self._list_rows()
        return self._follow(row, path, s_m, row.index if self.phase == "row" else -1)

    def _follow(self, row: FoundRow, path: Path, s_m: float, number: int) -> Path:
        """Lay the path on the row, or beside it, to the end of what was seen of it and out."""
        here = take_pose_at(path, s_m)
        along_m, _ = row.frame.locate(*here.xy_m)
        line = row.line_at(along_m, self._towards)
        line = Pose2(*line.transform(0.0, self._aside_m), line.yaw_rad)
        left_m = self._measure_left_m(row, along_m) + self._mission.headland_m
        return lay_on(path, s_m, line, max(left_m, RELAY_M), number)

    def _measure_left_m(self, row: FoundRow, along_m: float) -> float:
        """Measure what is left of a row as it is driven; negative behind its end."""
        return row.last_m - along_m if self._towards > 0.0 else along_m - row.first_m

    def _approach_first(self, path: Path, s_m: float) -> Path | None:
        frame = self._first.find()
        if frame is None:
            return None
        here, row = take_pose_at(path, s_m), FoundRow(0, frame)
        places = self._first.places
        for _ in range(2):
            row.add_crop(CropView(places, places), is_astride=False)
        self._order.begin(row)
        self._target = row
        ahead_rad = wrap_rad(here.yaw_rad - frame.yaw_rad)
        self._towards = 1.0 if abs(ahead_rad) <= math.pi / 2.0 else -1.0
        along_m, _ = frame.locate(*here.xy_m)
        before_m = self._measure_left_m(row, along_m) - row.length_m
        aslant_rad = min(abs(ahead_rad), math.pi - abs(ahead_rad))
        if aslant_rad <= FACING_RAD and before_m >= BEFORE_M:
            out = back_out(here, STOP_M, BACK_M)
            way = self._enter(advance(here, -BACK_M), [row], ends=(self._towards,))
            return join(path, s_m, chain(out, way))
        return join(path, s_m, self._go_beside(here, row))

    def _go_beside(self, here: Pose2, row: FoundRow) -> Path:
        """Plan to a way beside the row, on the robot's side of it, one way or the other."""
        along_m, left_m = row.frame.locate(*here.xy_m)
        aside_m = math.copysign(max(BESIDE_M, abs(left_m) - TURN_M), left_m)
        yaw_rad = row.frame.yaw_rad
        entries = [
            Pose2(
                *row.frame.transform(along_m + sign * 1.2, aside_m),
                yaw_rad if sign > 0.0 else yaw_rad + math.pi,
            )
            for sign in (1.0, -1.0)
        ]
        ahead, back = row.last_m + UNKNOWN_M, row.first_m - UNKNOWN_M
        whole = Row(
            index=row.index,
            start_map_m=row.frame.transform(back, 0.0), end_map_m=row.frame.transform(ahead, 0.0),
        )  # fmt: skip
        chosen, way = plan_approach(here, entries, [whole], self._robot, self._mission)
        self._towards = (1.0, -1.0)[chosen]
        self.phase, self._aside_m = "beside", aside_m * self._towards
        self._is_on_line = False
        along_row = Segment(self._mission.headland_m, 0.0)
        return sample(here, (*way, along_row))

    def _leave(self, row: FoundRow, path: Path, s_m: float) -> Path:
        """Drive out of a row, or past its end beside it, and into the next one."""
        here = take_pose_at(path, s_m)
        along_m, _ = row.frame.locate(*here.xy_m)
        left_m = self._measure_left_m(row, along_m)
        number = row.index if self.phase == "row" and left_m > 0.0 else -1
        if self.phase == "row":
            row.finish()
            if row.is_real:
                self._order.add_beside(row, {side: self._beside.find(side) for side in SIDES})
        out = self._follow(row, path, s_m, number)
        out.row[out.s_m > s_m + left_m] = -1
        exit_s_m = float(out.s_m[-1])
        self._laid_m = exit_s_m
        if not row.is_real and row.is_driven:
            self._order.remove(row)
            out.row[out.row == row.index] = -1
        open_rows = [each for each in self.found if not each.is_driven]
        if not open_rows:
            self.phase, self._target = "done", None
            self._order.settle()
        self._list_rows()
        if self.phase == "done":
            return out
        ends = (1.0, -1.0) if self.phase == "row" else (-self._towards,)
        return join(out, exit_s_m, self._enter(take_pose_at(out, exit_s_m), open_rows, ends))

    def _enter(self, here: Pose2, open_rows: Sequence[FoundRow], ends: Sequence[float]) -> Path:
        """Plan into the row that is reached first, from one of its ends."""
        ways = [(row, towards) for row in open_rows for towards in ends]
        lines = [self._read(row, towards) for row, towards in ways]
        entries = [
            advance(Pose2(*line.start_map_m, chord_yaw_rad(line)), -self._mission.headland_m)
            for line in lines
        ]
        crop = [row.as_row() for row in self.found]
        chosen, way = plan_approach(here, entries, crop, self._robot, self._mission)
        self._target, self._towards = ways[chosen]
        self.phase, self._aside_m = "row", 0.0
        self._beside, self._is_on_line, self._bare_m = Beside(), False, -math.inf
        self._list_rows()
        into = (
            Segment(self._mission.headland_m, 0.0),
            Segment(math.dist(lines[chosen].start_map_m, lines[chosen].end_map_m), 0.0,
                    self._target.index),
            Segment(self._mission.headland_m, 0.0),
        )  # fmt: skip
        return sample(here, (*way, *into))

    def _read(self, row: FoundRow, towards: float) -> Row:
        return row.as_row() if towards > 0.0 else reverse_row(row.as_row())

    def _list_rows(self) -> None:
        self.rows = tuple(each.as_row() for each in self.found if each.has_crop)
