"""The path of a robot from its tf frames, for recordings without fixes and odometry."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from agribot.core.geo import rotation_from_quaternion
from agribot.core.messages import FloatArray
from agribot.record.bag.source import Bag

TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
# Frames that move with the robot, the most usual first; else the one that moves furthest.
BASE_FRAMES = ("base_footprint", "base_link", "dummy_link", "base", "footprint")
MOVED_M = 0.05  # least motion; less is the jitter of a robot that stands
SHORTEST = 1e-3  # a quaternion shorter than this has no direction
MAX_DEPTH = 32  # depth of the tree of frames

Edge = tuple[str, str]  # parent and child


class FramesPath(NamedTuple):
    """`points` are (N, 3): seconds since the start, x and y of `frame` in `fixed`."""

    frame: str
    fixed: str
    points: FloatArray


def read_frames_path(bag: Bag) -> FramesPath | None:
    """Read the way of the robot's base in the outermost frame; None if no frame moves."""
    names = frozenset(t.name for t in bag.topics if t.ros_type in TF_TYPES and bag.knows(t))
    if not names or bag.times_ns is None:
        return None
    edges: list[tuple[float, Edge, FloatArray]] = []
    for message, value in bag.values(names):
        t_s = (message.log_ns - bag.times_ns[0]) * 1e-9
        edges += [
            (t_s, (_clean_name(stamped.header.frame_id), _clean_name(stamped.child_frame_id)), pose)
            for stamped in value.transforms
            if (pose := _make_matrix(stamped.transform)) is not None
        ]
    parents = {child: parent for _, (parent, child), _ in edges}
    moving = _measure_moves_m(edges)
    candidates = [name for name in BASE_FRAMES if _is_moving(name, parents, moving)]
    frame = next(iter(candidates), max(moving, key=lambda child: moving[child], default=""))
    if not frame or not _is_moving(frame, parents, moving):
        return None
    chain = _find_chain(frame, parents)
    points = _follow_chain(edges, chain)
    return FramesPath(frame, parents[chain[-1]], points) if len(points) > 1 else None


def _follow_chain(edges: list[tuple[float, Edge, FloatArray]], chain: list[str]) -> FloatArray:
    """Compute seconds and place of the chain's first link in its outermost frame, (N, 3)."""
    latest: dict[str, FloatArray] = {}
    rows = []
    for t_s, (_, child), pose in edges:
        if child not in chain:
            continue
        latest[child] = pose
        if len(latest) == len(chain):
            fixed_from_frame = np.eye(4)
            for link in chain:
                fixed_from_frame = latest[link] @ fixed_from_frame
            rows.append((t_s, fixed_from_frame[0, 3], fixed_from_frame[1, 3]))
    return np.array(rows, dtype=float).reshape(-1, 3)


def _find_chain(frame: str, parents: dict[str, str]) -> list[str]:
    """List the frames from one outwards that have a parent."""
    chain: list[str] = []
    while frame in parents and frame not in chain and len(chain) < MAX_DEPTH:
        chain.append(frame)
        frame = parents[frame]
    return chain


def _is_moving(frame: str, parents: dict[str, str], moving: dict[str, float]) -> bool:
    return any(link in moving for link in _find_chain(frame, parents))


def _measure_moves_m(edges: list[tuple[float, Edge, FloatArray]]) -> dict[str, float]:
    """Measure how far each frame gets from its first place in its parent, if it moves."""
    first: dict[str, FloatArray] = {}
    furthest_m: dict[str, float] = {}
    for _, (_, child), pose in edges:
        away_m = float(np.linalg.norm(pose[:3, 3] - first.setdefault(child, pose)[:3, 3]))
        furthest_m[child] = max(furthest_m.get(child, 0.0), away_m)
    return {child: away_m for child, away_m in furthest_m.items() if away_m > MOVED_M}


def _clean_name(name: str) -> str:
    return name.strip("/")


def _make_matrix(transform: Any) -> FloatArray | None:
    at, turn = transform.translation, transform.rotation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    norm = float(np.linalg.norm(quaternion))
    if not np.isfinite([at.x, at.y, at.z, norm]).all() or norm < SHORTEST:
        return None
    x, y, z, w = (quaternion / norm).tolist()
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_quaternion(w, x, y, z)
    matrix[:3, 3] = at.x, at.y, at.z
    return matrix


def read_static_frames(bag: Bag) -> dict[str, tuple[str, FloatArray]]:
    """Read the fixed frames of /tf_static: child -> parent and `parent_from_child` (4, 4)."""
    names = frozenset(
        topic.name
        for topic in bag.topics
        if topic.ros_type in TF_TYPES and "static" in topic.name and bag.knows(topic)
    )
    frames: dict[str, tuple[str, FloatArray]] = {}
    for message in bag.messages(names) if names else ():
        for stamped in bag.value(message).transforms:
            pose = _make_matrix(stamped.transform)
            if pose is not None:
                parent = _clean_name(stamped.header.frame_id)
                frames[_clean_name(stamped.child_frame_id)] = parent, pose
    return frames
