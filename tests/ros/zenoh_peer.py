"""A ROS 2 program as seen from the network, in a process of its own: plain zenoh, no AGRIBOT code.

Reads one JSON command per line, answers each with one JSON line.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from typing import Any

import zenoh
from zenoh import ext


class Peer:
    def __init__(self, locator: str, latched_keys: list[str]) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"peer"')
        config.insert_json5("connect/endpoints", json.dumps([locator]))
        config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("timestamping/enabled", "true")
        self.session = zenoh.open(config)
        self.lock = threading.Lock()
        self.heard: dict[str, list[tuple[str, str]]] = {}
        self.tokens: list[str] = []
        self.kept: list[Any] = [
            self.session.declare_subscriber("0/**", self.hear),
            self.session.liveliness().declare_subscriber("@ros2_lv/0/**", self.see, history=True),
        ]
        self.latched: dict[str, list[str]] = {}
        for key in latched_keys:
            late = ext.declare_advanced_subscriber(
                self.session,
                key,
                self.hear_late,
                history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
                subscriber_detection=True,
            )
            self.kept.append(late)

    def hear(self, sample: zenoh.Sample) -> None:
        mark = sample.attachment.to_bytes().hex() if sample.attachment else ""
        with self.lock:
            heard = self.heard.setdefault(str(sample.key_expr), [])
            heard.append((sample.payload.to_bytes().hex(), mark))

    def hear_late(self, sample: zenoh.Sample) -> None:
        with self.lock:
            heard = self.latched.setdefault(str(sample.key_expr), [])
            heard.append(sample.payload.to_bytes().hex())

    def see(self, sample: zenoh.Sample) -> None:
        with self.lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self.tokens.append(str(sample.key_expr))

    def dump(self) -> dict[str, Any]:
        with self.lock:
            return {"heard": self.heard, "latched": self.latched, "tokens": self.tokens}

    def count(self, key: str) -> int:
        with self.lock:
            return len(self.heard.get(key, []))

    def put(self, key: str, payload: str, mark: str, times: int = 1, rate_hz: float = 0.0) -> int:
        publisher = self.session.declare_publisher(key)
        started_s = time.monotonic()
        for index in range(times):
            publisher.put(bytes.fromhex(payload), attachment=bytes.fromhex(mark))
            if rate_hz:
                time.sleep(max(0.0, started_s + (index + 1) / rate_hz - time.monotonic()))
        return times

    def announce(self, token: str) -> int:
        self.kept.append(self.session.liveliness().declare_token(token))
        return 1

    def call(self, key: str, payload: str, mark: str) -> list[list[str]]:
        replies = self.session.get(
            key, payload=bytes.fromhex(payload), attachment=bytes.fromhex(mark), timeout=60.0
        )
        answered = []
        for reply in replies:
            if reply.ok is not None:
                attached = reply.ok.attachment
                answered.append(
                    [
                        reply.ok.payload.to_bytes().hex(),
                        attached.to_bytes().hex() if attached else "",
                    ]
                )
        return answered


def say(value: object) -> None:
    sys.stdout.write(json.dumps(value) + "\n")
    sys.stdout.flush()


def main() -> None:
    locator, *latched = sys.argv[1:]
    peer = Peer(locator, latched)
    say("ready")
    for line in sys.stdin:
        method, *arguments = json.loads(line)
        if method == "quit":
            break
        say(getattr(peer, method)(*arguments))
    peer.session.close()  # type: ignore[no-untyped-call]


if __name__ == "__main__":
    main()
