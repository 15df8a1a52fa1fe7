"""A real ROS 1 master with its tools, in a folder of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import xmlrpc.client
from pathlib import Path
from typing import Any

from tests.ros.live import ROOT, free_port
from tests.waiting import wait_for


def ask(uri: str, method: str, *arguments: Any) -> Any:
    with xmlrpc.client.ServerProxy(uri) as proxy:
        return getattr(proxy, method)("/test", *arguments)


class Ros1:
    def __init__(self, folder: Path) -> None:
        port = free_port()
        self.uri = f"http://127.0.0.1:{port}"
        self.folder = folder
        self.environment = {
            "PATH": "/usr/bin:/bin",  # its tools need the system's own python
            "HOME": str(folder),
            "ROS_HOME": str(folder),
            "ROS_MASTER_URI": self.uri,
            "ROS_IP": "127.0.0.1",
            "LC_ALL": "C.UTF-8",
        }
        self.processes: list[subprocess.Popen[str]] = []
        self.core = self.start("roscore", "-p", str(port))
        wait_for(self.answers, "the ROS 1 master")

    def add_package(self) -> None:
        """Let it find the package of `ros1/`, and `agribot` in its PATH."""
        program = self.folder / "agribot"
        source = ROOT / "src"
        program.write_text(
            f'#!/bin/sh\nPYTHONPATH="{source}" exec "{sys.executable}" -m agribot.cli "$@"\n'
        )
        program.chmod(0o755)
        self.environment["PATH"] += f":{self.folder}"
        self.environment["ROS_PACKAGE_PATH"] = f"{ROOT / 'ros1'}:/usr/share"

    def publishers(self) -> dict[str, list[str]]:
        """Topic -> nodes."""
        return dict(ask(self.uri, "getSystemState")[2][0])

    def subscribers(self) -> dict[str, list[str]]:
        return dict(ask(self.uri, "getSystemState")[2][1])

    def answers(self) -> bool:
        try:
            return bool(ask(self.uri, "getPid")[0] == 1)
        except OSError:
            return False

    def start(self, *command: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            command,
            env=self.environment,
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )
        self.processes.append(process)
        return process

    def stop(self, process: subprocess.Popen[str]) -> None:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
        if process.stdout:
            process.stdout.close()
        process.wait()

    def close(self) -> None:
        for process in reversed(self.processes):
            self.stop(process)
