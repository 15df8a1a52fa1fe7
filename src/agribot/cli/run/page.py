"""The operator's page beside a run: its options, its pace, and staying after the mission."""

from __future__ import annotations

import argparse
import math
import sys
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.cli.ranges import port
from agribot.cli.run.bridging import read_domain, read_master, read_router
from agribot.cli.stopping import stop_on_signal
from agribot.core.errors import PlatformError
from agribot.ui.about import RosPlaces
from agribot.ui.address import SELF_SIGNED, Address
from agribot.ui.panels import shared
from agribot.ui.robot_side.token_file import read_or_make_tokens

if TYPE_CHECKING:
    from agribot.app.run import Run
    from agribot.ui.robot_side.operator_page import OperatorPage
    from agribot.ui.robot_side.server_process import ServerProcess

LOOK_S = 0.2
MOST_BEHIND_S = 1.0
IDLE_PACE = 1.0  # a robot that waits for an operator runs in real time


def add_page_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a command that can show the page."""
    group = parser.add_argument_group("operator's page")
    group.add_argument(
        "--ui", action=argparse.BooleanOptionalAction, default=False, help="serve the page"
    )
    add_address_arguments(group)
    group.add_argument(
        "--stay", action="store_true", help="keep robot and page after the mission, until Ctrl-C"
    )


def add_address_arguments(group: argparse._ActionsContainer) -> None:
    group.add_argument(
        "--port", type=port, metavar="P", help="of the page (default: the first free one from 8080)"
    )
    group.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="H",
        help="address to serve at; 0.0.0.0 lets tablets in, with a token (default: this machine)",
    )
    group.add_argument(
        "--allow-host",
        action="append",
        default=[],
        metavar="NAME",
        help="a further name by which browsers call this machine",
    )
    group.add_argument(
        "--tls-cert",
        default="",
        metavar="FILE",
        help=f"encrypt everything, with this certificate; {SELF_SIGNED}",
    )
    group.add_argument("--tls-key", default="", metavar="FILE", help="the certificate's key")
    group.add_argument(
        "--token-file",
        default="",
        metavar="FILE",
        help="keep the tokens over restarts, in this file; a missing file is made",
    )
    group.add_argument("--open", action="store_true", help="open the page in a browser")


def has_page(options: argparse.Namespace) -> bool:
    return bool(options.ui) and not options.headless


def is_kept_open(options: argparse.Namespace) -> bool:
    """Return whether a person at a terminal goes on looking; a script goes on."""
    return bool(options.stay) or sys.stderr.isatty()


@contextmanager
def open_page(options: argparse.Namespace, session: Run) -> Iterator[OperatorPage]:
    """Open the page of a session and print its address.

    Raises: ConfigError: the page's packages are missing, or its address cannot be used.
    """
    from agribot.ui.robot_side.operator_page import OperatorPage

    _add_noise_panel(session)
    with OperatorPage(session, choose_address(options), shared, find_ros_places(options)) as page:
        announce(page.url, page.address.viewer_url(page.server.port), options)
        yield page


def find_ros_places(options: argparse.Namespace) -> RosPlaces:
    """Find where the page looks for topics of ROS.

    Raises: ConfigError: an option or a variable of the environment is out of range.
    """
    return RosPlaces(
        master=read_master(options),
        router=read_router(options),
        domain=read_domain(options),
        layers_from=tuple(
            name for name in ("ros1", "ros2", "dds") if getattr(options, name, False)
        ),
    )


def _add_noise_panel(session: Run) -> None:
    """Let the errors of simulated sensors be changed on the page."""
    from agribot.app.simulated_run import SimulatedRun
    from agribot.sim.sensors.tuning import check_tuning
    from agribot.ui.noise_panel import add_noise_panel

    if isinstance(session, SimulatedRun):
        add_noise_panel(shared, check_tuning, session.simulator.tune)


def choose_address(options: argparse.Namespace) -> Address:
    """Read the address of the page from the options.

    Raises: ConfigError: the file of the tokens cannot be used.
    """
    address = Address(
        host=options.host,
        port=options.port,
        allowed_hosts=tuple(options.allow_host),
        tls_cert=options.tls_cert,
        tls_key=options.tls_key,
    )
    if not options.token_file:
        return address
    tokens = read_or_make_tokens(Path(options.token_file))
    return msgspec.structs.replace(
        address,
        operator_token=tokens.operator,
        viewer_token=tokens.viewer,
        session_key=tokens.sessions,
    )


def announce(url: str, viewer_url: str, options: argparse.Namespace) -> None:
    sys.stderr.write(f"page: {url}\n")
    if viewer_url:
        sys.stderr.write(f"page for looking on only: {viewer_url}\n")
        if sys.stderr.isatty():
            import segno

            segno.make(url, error="l").terminal(out=sys.stderr, compact=True)
    sys.stderr.flush()
    if options.open:
        webbrowser.open(url)


def serve_page(server: ServerProcess, what: str, options: argparse.Namespace) -> int:
    """Serve a page beside which no robot runs, until somebody interrupts."""
    with stop_on_signal() as stop:  # before anybody reads that Ctrl-C ends it
        server.start()
        try:
            server.listen(lambda _data: None, lambda: None, LOOK_S)
            announce(server.url, server.address.viewer_url(server.port), options)
            sys.stderr.write(f"{what}: Ctrl-C ends\n")
            while not stop:
                if server.has_ended.is_set():
                    raise PlatformError("the page's server could not be started; see above")
                time.sleep(LOOK_S)
        finally:
            server.close()
    return 0


def keep_ready(
    session: Run, page: OperatorPage, stop: list[int], *, keeps_up: bool = False
) -> None:
    """Keep the robot ready, and its page in use, until somebody interrupts."""
    sys.stderr.write(f"the robot stays ready: {page.url} (Ctrl-C ends)\n")
    sys.stderr.flush()
    pacer = Pacer(IDLE_PACE, page, keeps_up=keeps_up)
    for record in session.idle():
        if stop:
            session.come_to_rest()  # before the page is closed, which takes its time
            return
        pacer.wait(record.batch.t_s)


class Pacer:
    """A brake that holds a simulation to `pace` simulated seconds per second.

    While somebody drives by hand it is never faster than the clock. What was lost while the
    process stood still is not made up for in a rush, unless `keeps_up`: sensors from elsewhere
    have gone on meanwhile.
    """

    def __init__(
        self, pace: float, page: OperatorPage | None = None, *, keeps_up: bool = False
    ) -> None:
        self._wanted, self._page = pace, page
        self._most_behind_s = math.inf if keeps_up else MOST_BEHIND_S
        self._pace = math.inf
        self._from_s = self._from_wall_s = 0.0

    def wait(self, t_s: float) -> None:
        now_s = time.monotonic()
        limit = self._page.pace_limit if self._page else math.inf
        pace = min(self._wanted, limit)
        behind_s = now_s - self._from_wall_s - (t_s - self._from_s) / pace
        if pace != self._pace or behind_s > self._most_behind_s:
            self._pace, self._from_s, self._from_wall_s = pace, t_s, now_s
        elif behind_s < 0.0:
            time.sleep(-behind_s)
