"""The path of a robot as its frames tell it, for recordings without fixes and odometry."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from agribot.core.geo import rotation_from_quaternion
from agribot.core.messages import FloatArray
from agribot.record.bag.source import Bag

TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
# Frames that move with the robot, the most usual first; else the one that moves furthest.
BASE_FRAMES = ("base_footprint", "base_link", "dummy_link", "base", "footprint")
MOVED_M = 0.05  # less is the jitter of a robot that stands
SHORTEST = 1e-3  # a quaternion shorter than this tells no direction
MAX_DEPTH = 32  # of the tree of frames

Edge = tuple[str, str]  # parent and child


class FramesPath(NamedTuple):
    """`points` are (N, 3): seconds since the start, x and y of `frame` in `fixed`."""

    frame: str
    fixed: str
    points: FloatArray


def read_frames_path(bag: Bag) -> FramesPath | None:
    """Where the robot's base went in the outermost frame; None if no frame moves."""
    names = frozenset(t.name for t in bag.topics if t.ros_type in TF_TYPES and bag.knows(t))
    if not names or bag.times_ns is None:
        return None
    edges: list[tuple[float, Edge, FloatArray]] = []
    for message in bag.messages(names):
        t_s = (message.log_ns - bag.times_ns[0]) * 1e-9
        edges += [
            (t_s, (_frame(stamped.header.frame_id), _frame(stamped.child_frame_id)), pose)
            for stamped in bag.value(message).transforms
            if (pose := _matrix(stamped.transform)) is not None
        ]
    parents = {child: parent for _, (parent, child), _ in edges}
    moving = _moved_m(edges)
    candidates = [name for name in BASE_FRAMES if _moves(name, parents, moving)]
    frame = next(iter(candidates), max(moving, key=lambda child: moving[child], default=""))
    if not frame or not _moves(frame, parents, moving):
        return None
    chain = _chain(frame, parents)
    points = _followed(edges, chain)
    return FramesPath(frame, parents[chain[-1]], points) if len(points) > 1 else None


def _followed(edges: list[tuple[float, Edge, FloatArray]], chain: list[str]) -> FloatArray:
    """Place of the first link of the chain in the parent of its last, whenever one changes."""
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


def _chain(frame: str, parents: dict[str, str]) -> list[str]:
    """From a frame outwards: every frame that has a parent."""
    chain: list[str] = []
    while frame in parents and frame not in chain and len(chain) < MAX_DEPTH:
        chain.append(frame)
        frame = parents[frame]
    return chain


def _moves(frame: str, parents: dict[str, str], moving: dict[str, float]) -> bool:
    return any(link in moving for link in _chain(frame, parents))


def _moved_m(edges: list[tuple[float, Edge, FloatArray]]) -> dict[str, float]:
    """How far each frame gets from where it first was in its parent, if it does."""
    first: dict[str, FloatArray] = {}
    furthest_m: dict[str, float] = {}
    for _, (_, child), pose in edges:
        away_m = float(np.linalg.norm(pose[:3, 3] - first.setdefault(child, pose)[:3, 3]))
        furthest_m[child] = max(furthest_m.get(child, 0.0), away_m)
    return {child: away_m for child, away_m in furthest_m.items() if away_m > MOVED_M}


def _frame(name: str) -> str:
    return name.strip("/")


def _matrix(told: Any) -> FloatArray | None:
    at, turn = told.translation, told.rotation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    norm = float(np.linalg.norm(quaternion))
    if not np.isfinite([at.x, at.y, at.z, norm]).all() or norm < SHORTEST:
        return None
    x, y, z, w = (quaternion / norm).tolist()
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_quaternion(w, x, y, z)
    matrix[:3, 3] = at.x, at.y, at.z
    return matrix
