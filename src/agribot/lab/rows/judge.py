"""The judgement of a network on photographs with labelled crop rows, picture by picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from agribot.autonomy.perceive.pictures import PictureClasses
from agribot.core.messages import ByteArray
from agribot.lab.rows.labelled import Regions, RowPhoto, find_regions
from agribot.lab.rows.lines import (
    FoundLine,
    LineFinder,
    LineScores,
    PhotoCamera,
    PhotoCameras,
    PictureLine,
    trace_lines,
)
from agribot.lab.rows.scores import NameScores, share


class JudgedPicture(NamedTuple):
    """A photograph, what its lines and the network say of it, and how well they agree."""

    name: str
    condition: str
    picture: RowPhoto
    regions: Regions
    class_id: ByteArray
    scores: NameScores
    labelled: Sequence[PictureLine]
    camera: PhotoCamera | None
    line: FoundLine | None


class PictureJudge:
    """Judges pictures of known cameras, one by one."""

    def __init__(self, cameras: PhotoCameras) -> None:
        self._cameras, self._finder = cameras, LineFinder()

    def judge(
        self, name: str, condition: str, picture: RowPhoto, classes: PictureClasses
    ) -> JudgedPicture:
        """Judge the classes (SIDE_PX, SIDE_PX) of a picture; without a camera no line is sought.

        Plants are named by the line that is found as well, not by the labelled ones.
        """
        regions, scores = find_regions(picture), NameScores()
        labelled = trace_lines(picture.lines)
        camera = self._cameras.find(labelled)
        line = None
        if camera is not None:
            line, classes = self._finder.find(classes, camera, picture.image_rgb)
        scores.add(regions, classes.class_id)
        return JudgedPicture(
            name, condition, picture, regions, classes.class_id, scores, labelled, camera, line
        )


class RowJudge:
    """Figures of all pictures together: `add` each, then `summarise`."""

    def __init__(self) -> None:
        self.pictures = 0
        self.names = NameScores()
        self.lines = LineScores()

    def add(self, judged: JudgedPicture) -> None:
        self.pictures += 1
        self.names.merge(judged.scores)
        if judged.camera:
            self.lines.add(judged.labelled, judged.camera, judged.line)

    def summarise(self) -> dict[str, Any]:
        """Return the figures of `agribot eval --data rows --json`; None where there is nothing."""
        return {
            "pictures": self.pictures,
            "on_rows": share(self.names.on_rows),
            "between_rows": share(self.names.between_rows),
            "balanced": self.names.balanced,
            "line": self.lines.summarise(),
        }


def summarise_picture(judged: JudgedPicture) -> dict[str, Any]:
    """Return the figures of one picture; its line is null where none was found."""
    one = RowJudge()
    one.add(judged)
    return {"picture": judged.name, "condition": judged.condition, **one.summarise()}


def format_summary(summary: dict[str, Any], names: NameScores) -> str:
    """Write the figures as a table for a person."""
    lines = [
        f"{'':14}{'crop':>8}{'weed':>8}{'soil':>8}{'pixels':>12}",
        _format_shares("on rows", summary["on_rows"], int(names.on_rows.sum())),
        _format_shares("between rows", summary["between_rows"], int(names.between_rows.sum())),
        f"balanced {format_value(summary['balanced'], '.3f')} over {summary['pictures']} pictures "
        "(0.5: every plant is called crop)",
        describe_line(summary["line"]),
    ]
    return "\n".join(lines)


def describe_line(line: dict[str, float | None]) -> str:
    """Write how often and how well the row line is found."""
    return (
        f"row line found in {format_value(line['found'], '.1%')} of the pictures; angle off by "
        f"{format_value(line['angle_deg_median'], '.1f')} deg in the median, "
        f"{format_value(line['angle_deg_p95'], '.1f')} at 95 %; beside the row by "
        f"{format_value(line['offset_ratio_median'], '.3f')} of the row spacing"
        + _describe_sigma(line)
    )


def _describe_sigma(line: dict[str, float | None]) -> str:
    """Write how honest lines are; nothing where figures are older than the question."""
    angle, offset = line.get("angle_within_2_sigma"), line.get("offset_within_2_sigma")
    if angle is None or offset is None:
        return ""
    return f"; within 2 sigma: {angle:.0%} of the angles, {offset:.0%} of the places"


def _format_shares(name: str, shares: dict[str, float | None], pixels: int) -> str:
    cells = "".join(f"{format_value(value, '.3f'):>8}" for value in shares.values())
    return f"{name:14}{cells}{pixels:>12,}"


def format_value(value: float | None, form: str) -> str:
    """Format a figure, a dash where nothing was measured."""
    return "-" if value is None else format(value, form)
