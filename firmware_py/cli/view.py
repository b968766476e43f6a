"""`rambler view`: a live page of the boat for a browser; reads the status file and changes nothing."""

from __future__ import annotations

import argparse
import os
import socket
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from firmware_py.cli.errors import print_error
from firmware_py.common.plan import PlanKind
from firmware_py.faults.table import TABLE as FAULTS
from firmware_py.system import realtime
from firmware_py.system.clock import machine_s
from firmware_py.system.signals import Signals
from firmware_py.system.slots import examine
from firmware_py.system.state_directory import PLAN_FILES, parse_stored_plan
from firmware_py.system.status_file import Freshness, StatusReading, find_all_statuses, find_status
from firmware_py.view.feed import MAX_LINE_BYTES, Feed
from firmware_py.view.guard import DEFAULT_LISTEN, Guard, ViewError, parse_listen_address, read_token
from firmware_py.view.history import History
from firmware_py.view.model import plan_rows
from firmware_py.view.server import Hub, ViewServer

POLL_INTERVAL_S, HARNESS_POLL_INTERVAL_S = 0.5, 0.1  # the autopilot writes once a second, the harness may run faster
NICENESS = 15
CLOSE_DELAY_S = 0.5  # for sending the end of the stream to the browsers
_REMEDIES = {fault.name: row.remedy.replace("`", "") for fault, row in FAULTS.items()}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "--state", metavar="DIR", type=Path, help="state directory; not needed if only one autopilot runs"
    )
    parser.add_argument(
        "--listen",
        metavar="HOST:PORT",
        default=DEFAULT_LISTEN,
        help=f"address of the page (default: {DEFAULT_LISTEN}); 0.0.0.0:PORT for other computers, with --token",
    )
    parser.add_argument(
        "--token",
        metavar="FILE",
        type=Path,
        help="file with the access token; required for access from other computers",
    )
    # For the harness: read its lines from standard input; use another port if this one is in use.
    parser.add_argument("--with-parent", metavar="PID", type=int, help=argparse.SUPPRESS)


def run(arguments: argparse.Namespace) -> int:
    """Serve until a signal or the end of the harness; return 2 for an unusable address or token."""
    by_harness = arguments.with_parent is not None
    with Signals() as signals:
        if by_harness and not realtime.end_with_parent(arguments.with_parent):
            return 0
        history = History()
        state = arguments.state
        feed = Feed(history, lambda: _find_status(state), lambda: _read_plans(_find_directory(state)), _REMEDIES)
        hub = Hub(history.all_data)
        try:
            server = _open_server(arguments.listen, arguments.token, hub, any_port=by_harness)
        except ViewError as error:
            return print_error("view", error)
        os.nice(NICENESS)
        print(f"page: {_format_url(server)}", flush=True)
        input_ended = threading.Event()
        if by_harness:
            threading.Thread(target=_read_harness, args=(feed, input_ended), daemon=True).start()
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.5}, daemon=True).start()
        while not signals.is_stopping and not input_ended.is_set():
            hub.publish(lambda: (feed.poll(), history.epoch))
            time.sleep(HARNESS_POLL_INTERVAL_S if by_harness else POLL_INTERVAL_S)
        hub.publish(lambda: (feed.poll(), history.epoch))
        hub.close(is_over=by_harness)  # a service may restart: the voyage is not over
        time.sleep(CLOSE_DELAY_S)
        server.server_close()
    return 0


def _open_server(listen: str, token_file: Path | None, hub: Hub, *, any_port: bool) -> ViewServer:
    try:
        host, port, loopback = parse_listen_address(listen, with_token=token_file is not None)
    except ViewError as error:
        raise ViewError(f"--listen {error}") from None
    token = "" if token_file is None else read_token(token_file)
    name = socket.gethostname().lower()
    guard = Guard(token, loopback, frozenset() if loopback else frozenset((name, f"{name}.local")))
    try:
        return ViewServer((host, port), guard, hub)
    except ViewError:
        if not any_port:
            raise
        return ViewServer((host, 0), guard, hub)


def _format_url(server: ViewServer) -> str:
    host, port = str(server.server_address[0]), server.server_address[1]
    url_host = f"[{host}]" if ":" in host else host
    return f"http://{url_host}:{port}/" + ("?token=..." if server.guard.token else "")


def _read_harness(feed: Feed, input_ended: threading.Event) -> None:
    """Read the lines of the harness until it closes the pipe."""
    while line := sys.stdin.buffer.readline(MAX_LINE_BYTES):
        feed.add_line(line)
    input_ended.set()


def _find_status(state: Path | None) -> StatusReading:
    if state is not None:
        return find_status(state, machine_s())
    running = [status for status in find_all_statuses(machine_s()).values() if status.freshness is Freshness.RUNNING]
    if len(running) == 1:
        return running[0]
    reason = "several autopilots run here; choose one with --state" if running else "no autopilot runs here"
    return StatusReading(Freshness.ABSENT, reason=reason)


def _find_directory(state: Path | None) -> Path | None:
    if state is not None:
        return state
    content = _find_status(None).content
    return Path(content["state_directory"]) if content else None


def _read_plans(directory: Path | None) -> Mapping[str, Any]:
    """Return the readable plans of a state directory."""
    rows_by_kind: dict[str, Any] = {}
    for kind in PlanKind:
        if directory is None:
            break
        try:
            stored = examine(directory, PLAN_FILES[kind])
            if stored.content is not None:
                plan, _ = parse_stored_plan(kind, stored.content.decode("ascii", "replace"))
                rows_by_kind[kind.name.lower()] = plan_rows(plan)
        except (OSError, ValueError):
            continue  # the autopilot reports a damaged plan
    return rows_by_kind
