from __future__ import annotations

import io
import math
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from PIL import Image
from rosbags.highlevel import AnyReader

from agribot.core import topics
from agribot.core.config import RunConfig, load
from agribot.core.errors import EndOfRecording, RecordingError
from agribot.core.messages import MappedPlant, RobotCommand, TickRecord
from agribot.core.robot import Joint, Link
from agribot.record.mcap_file import McapFile
from agribot.record.recorder import RunRecorder
from agribot.record.replay import (
    ReplayPlatform,
    read_config,
    read_ticks,
    read_truth,
    read_urdf,
    read_weed_map,
    recorded_scenes,
)
from agribot.record.ticks import strip_pixels
from agribot.ros.messages.transforms import make_static_transforms
from tests.record import record_samples as samples

CONFIG = load("farm", ["seed=7", "record.image_rate_hz=2.0"])
GOALS = ((1.0, 2.0), (1.0, 12.0))


def _weeds() -> tuple[MappedPlant, ...]:
    return (samples.plant(1), samples.plant(2, treated_s=4.0))


def _record(path: Path, records: list[TickRecord], close: bool = True) -> RunRecorder:
    recorder = RunRecorder(
        path, CONFIG, samples.robot(), samples.URDF, samples.plan(), GOALS, _weeds
    )
    for record in records:
        recorder(record)
        recorder.truth(record.batch.t_s, (1.0, 2.0, math.pi / 2), (0.4, 0.0))
    if close:
        recorder.close()
    return recorder


@pytest.fixture(scope="module")
def records() -> list[TickRecord]:
    return samples.ticks(150, seed=3, with_camera=True)


# Not in these recordings: scans, raw images, a bag player's clock, what a simulated world alone
# records, and what operators draw on a page.
LIVE_ONLY = (
    topics.CLOCK, topics.IMAGE_RAW, topics.IMU_BIAS, topics.SCAN,
    topics.GOAL_POSE, topics.CLICKED_POINT, topics.DRAWN_POLYGON, topics.DRAWN_ROUTE,
)  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, records: list[TickRecord]) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    _record(path, records)
    return path


def _decoded(path: Path, topic: str) -> list[Any]:
    """By the MCAP project's own reader."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [found.decoded_message for found in reader.iter_decoded_messages(topics=[topic])]


def test_an_independent_reader_decodes_every_ros_topic(run: Path) -> None:
    with run.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        ros_topics = [t.name for t in topics.TOPICS if t.ros_type]
        seen = Counter(found.channel.topic for found in reader.iter_decoded_messages(ros_topics))
    assert set(seen) == {t.name for t in topics.TOPICS if t.ros_type and t not in LIVE_ONLY}
    assert seen[topics.IMU.name] == 600
    assert seen[topics.JOINT_STATES.name] == seen[topics.ODOMETRY.name] == 150
    assert seen[topics.FIX.name] == 30
    assert seen[topics.PATH.name] == seen[topics.ROBOT_DESCRIPTION.name] == 1


def test_rosbags_finds_the_types_and_the_latched_topics(run: Path) -> None:
    with AnyReader([run]) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        for topic in topics.TOPICS:
            if topic.ros_type and topic not in LIVE_ONLY:
                assert types[topic.name] == topic.ros_type
        static = next(c for c in reader.connections if c.topic == topics.TF_STATIC.name)
        offered: Any = static.ext
        assert offered.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"
        fixes = [c for c in reader.connections if c.topic == topics.FIX.name]
        _, _, raw = next(iter(reader.messages(connections=fixes)))
        fix: Any = reader.deserialize(raw, topics.FIX.ros_type)
        assert fix.latitude == pytest.approx(21.161289, abs=1e-5)
        assert fix.header.frame_id == "gps_link"


def test_message_times_are_simulated_times(run: Path, records: list[TickRecord]) -> None:
    with run.open("rb") as file:
        times = [
            (message.log_time, message.publish_time)
            for _, _, message in make_reader(file).iter_messages(topics=[topics.IMU.name])
        ]
    assert times[0] == (20_000_000, 5_000_000)
    assert times[-1][0] == round(records[-1].batch.t_s * 1e9)


def test_transform_chain_ends_at_the_estimated_pose(run: Path, records: list[TickRecord]) -> None:
    chains = [m.transforms for m in _decoded(run, topics.TF.name) if len(m.transforms) == 2]
    assert len(chains) == len(records)
    for (odom, body), record in zip(chains[::20], records[::20], strict=True):
        assert (odom.header.frame_id, odom.child_frame_id) == ("map", "odom")
        assert (body.header.frame_id, body.child_frame_id) == ("odom", "base_footprint")
        yaw = 2.0 * math.atan2(odom.transform.rotation.z, odom.transform.rotation.w)
        dx, dy = body.transform.translation.x, body.transform.translation.y
        x_m = odom.transform.translation.x + math.cos(yaw) * dx - math.sin(yaw) * dy
        y_m = odom.transform.translation.y + math.sin(yaw) * dx + math.cos(yaw) * dy
        assert x_m == pytest.approx(record.estimate.x_map_m, abs=1e-9)
        assert y_m == pytest.approx(record.estimate.y_map_m, abs=1e-9)


def test_odom_frame_never_jumps_though_the_estimate_does(run: Path) -> None:
    chains = [m.transforms for m in _decoded(run, topics.TF.name) if len(m.transforms) == 2]
    odom = np.array([(b.transform.translation.x, b.transform.translation.y) for _, b in chains])
    steps_m = np.hypot(*np.diff(odom, axis=0).T)
    # The made-up encoders scatter by a centiradian, a millimetre at the rim.
    assert steps_m == pytest.approx(samples.SPEED_MPS * 0.02, abs=0.002)


def test_every_frame_has_exactly_one_parent(run: Path) -> None:
    parents: dict[str, set[str]] = {}
    for name in (topics.TF.name, topics.TF_STATIC.name):
        for message in _decoded(run, name):
            for found in message.transforms:
                parents.setdefault(found.child_frame_id, set()).add(found.header.frame_id)
    assert all(len(names) == 1 for names in parents.values())
    assert {"imu_link", "gps_link", "camera_optical_frame", "left_wheel_F"} <= set(parents)
    frame = "camera_optical_frame"
    while frame != "map":
        (frame,) = parents[frame]


def test_a_description_with_its_own_optical_frame_is_not_given_a_second_one() -> None:
    plain = samples.robot()
    joint = Joint(
        name="optical_joint", kind="fixed", parent="camera_link", child="camera_optical_frame"
    )
    robot = msgspec.structs.replace(
        plain,
        links=(*plain.links, Link(name="camera_optical_frame")),
        joints=(*plain.joints, joint),
    )
    children = [t.child_frame_id for t in make_static_transforms(robot).transforms]
    assert len(children) == len(set(children))


def test_images_come_at_their_own_rate_and_the_overlay_marks_the_weed(run: Path) -> None:
    images = _decoded(run, topics.IMAGE.name)
    assert len(images) == pytest.approx(3.0 * 2.0, abs=1)
    plain = np.asarray(Image.open(io.BytesIO(bytes(images[0].data))))
    assert plain.shape == (48, 64, 3)
    assert np.abs(plain[2, 2].astype(int) - (110, 85, 60)).max() < 12
    overlays = _decoded(run, topics.OVERLAY.name)
    assert len(overlays) >= len(images) - 1
    marked = np.asarray(Image.open(io.BytesIO(bytes(overlays[0].data)))).astype(int)
    redness = marked[..., 0] - marked[..., 1]
    assert redness.max() > 90 > (plain[..., 0].astype(int) - plain[..., 1]).max()


def test_values_of_the_original_are_recorded_under_their_successors(run: Path) -> None:
    for message in _decoded(run, topics.HEADING_FILTERED.name):  # the samples drive North
        assert abs(math.remainder(message.data, 360.0)) < 4.0
    raw = [m.data for m in _decoded(run, topics.HEADING_RAW.name)]
    assert raw == pytest.approx([math.degrees(math.atan2(1e-6, 3.8e-5))] * len(raw))
    distances = [m.data for m in _decoded(run, topics.DISTANCE.name)]
    assert distances[0] == pytest.approx(0.0, abs=0.1)  # it starts at the first waypoint
    assert distances == pytest.approx([0.4 * 0.02 * (5 * i) for i in range(30)], abs=0.08)


def test_recorded_ticks_are_the_ticks(run: Path, records: list[TickRecord]) -> None:
    again = [samples.without_frames(record) for record in read_ticks(run)]
    assert again == [samples.without_frames(strip_pixels(record)) for record in records]
    assert list(recorded_scenes(run)) == [record.scenes for record in records]


def test_settings_robot_weed_map_and_truth_are_inside(run: Path, records: list[TickRecord]) -> None:
    assert read_config(run) == CONFIG
    assert read_urdf(run) == samples.URDF
    assert read_weed_map(run) == _weeds()
    truth = read_truth(run)
    assert truth.shape == (len(records), 4)
    assert truth[-1] == pytest.approx([records[-1].batch.t_s, 1.0, 2.0, math.pi / 2])


def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.mcap", "b.mcap"):
        _record(tmp_path / name, samples.ticks(60, seed=5, with_camera=True))
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_a_killed_run_loses_at_most_its_last_second(tmp_path: Path) -> None:
    records = samples.ticks(275, seed=1)
    path = tmp_path / "run.mcap"
    recorder = _record(path, records, close=False)
    kept = list(read_ticks(path))  # what is on disk while the process still holds the file
    assert kept == records[: len(kept)]
    assert records[-1].batch.t_s - kept[-1].batch.t_s <= 1.0
    assert read_config(path) == CONFIG
    recorder.close()


def test_any_cut_leaves_a_readable_beginning(run: Path, tmp_path: Path) -> None:
    whole = run.read_bytes()
    complete = [samples.without_frames(record) for record in read_ticks(run)]
    counts = []
    for share in (0.02, 0.3, 0.5, 0.77, 0.9, 0.999):
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(whole[: int(len(whole) * share)])
        kept = [samples.without_frames(record) for record in read_ticks(cut)]
        assert kept == complete[: len(kept)]
        counts.append(len(kept))
    assert counts == sorted(counts)
    assert counts[-1] == len(complete)


def test_a_tail_of_zeros_is_ignored(run: Path, tmp_path: Path) -> None:
    whole = run.read_bytes()
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole[: len(whole) // 2] + bytes(len(whole) // 2))
    kept = list(read_ticks(torn))
    assert 0 < len(kept) < 150


def test_replay_gives_the_batches_and_then_says_that_it_is_over(
    run: Path, records: list[TickRecord]
) -> None:
    platform = ReplayPlatform(run)
    for record in records:
        batch = platform.read()
        assert batch.t_s == record.batch.t_s
        assert batch.imu == record.batch.imu
        assert platform.recorded_scenes() == record.scenes
        platform.write(RobotCommand(t_s=batch.t_s))
    assert len(platform.commands) == len(records)
    with pytest.raises(EndOfRecording, match=r"run\.mcap"):
        platform.read()
    platform.close()
    platform.close()


def test_a_folder_that_cannot_be_written_is_refused_with_its_name(tmp_path: Path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("not a folder")
    with pytest.raises(RecordingError, match=r"file.*writable.*--out"):
        RunRecorder(blocker / "run.mcap", RunConfig(), samples.robot(), samples.URDF)


def test_a_full_disk_is_reported_as_such() -> None:
    recorder = None
    with pytest.raises(RecordingError, match="No space left"):
        recorder = RunRecorder(Path("/dev/full"), CONFIG, samples.robot(), samples.URDF)
    assert recorder is None


def test_whatever_is_written_first_to_a_full_disk_is_refused_in_words() -> None:
    file = McapFile(Path("/dev/full"))
    with pytest.raises(RecordingError, match="No space left"):
        for _ in range(10_000):  # the disk answers a little later
            file.describe("agribot", {"seed": "1" * 1_000})


def test_a_missing_or_foreign_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="check the path"):
        list(read_ticks(tmp_path / "none.mcap"))
    (tmp_path / "notes.txt").write_text("hello, this is no recording")
    with pytest.raises(RecordingError, match="not an MCAP recording"):
        list(read_ticks(tmp_path / "notes.txt"))


def test_a_robot_without_camera_records_no_images(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorder = RunRecorder(path, CONFIG, samples.robot(with_camera=False), samples.URDF)
    for record in samples.ticks(5):
        recorder(record)
    recorder.close()
    recorder.close()
    assert _decoded(path, topics.IMAGE.name) == []
    assert len(_decoded(path, topics.CMD_VEL.name)) == 5
