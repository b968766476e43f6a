"""What `rambler view` prints, reads and serves."""

import io
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import view as command
from firmware_py.common.plan import Plan, PlanItem, PlanKind, to_text
from firmware_py.plans.items import Command
from firmware_py.system.state_directory import PLAN_FILES
from firmware_py.system.status_file import Freshness, StatusReading
from firmware_py.system.store import Store
from firmware_py.view.guard import Guard
from firmware_py.view.server import Hub, ViewServer


@pytest.mark.parametrize(
    ("host", "token", "url"),
    [
        ("127.0.0.1", "", "http://127.0.0.1:8080/"),
        ("::1", "", "http://[::1]:8080/"),
        ("0.0.0.0", "secret", "http://0.0.0.0:8080/?token=..."),
    ],
)
def test_url_has_brackets_around_an_address_of_ipv6_and_no_token(host, token, url):
    server = SimpleNamespace(server_address=(host, 8080), guard=SimpleNamespace(token=token))
    assert command._format_url(server) == url


class FakeSignals:
    """Signals that stop the program after some polls."""

    polls = 2

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        pass

    @property
    def is_stopping(self):
        self.polls -= 1
        assert self.polls > -9, "it does not stop"
        return self.polls < 0


@pytest.fixture
def view(monkeypatch, capsys):
    """Return a function that runs the command until its signal; the result is code, output, error and calls."""

    def run(*words, parent_runs=True):
        calls = []
        monkeypatch.setattr(command, "Signals", FakeSignals)
        monkeypatch.setattr(command.realtime, "end_with_parent", lambda pid: calls.append(pid) or parent_runs)
        monkeypatch.setattr(command, "time", SimpleNamespace(sleep=calls.append))
        monkeypatch.setattr(command.os, "nice", lambda niceness: calls.append(f"nice {niceness}"))
        monkeypatch.setattr(command, "_read_harness", lambda _feed, _ended: None)
        code = main(["view", *words])
        return code, *capsys.readouterr(), calls

    return run


def test_page_is_served_until_a_signal(view):
    code, output, error, calls = view("--listen", "127.0.0.1:0")
    assert (code, error) == (0, "")
    assert output.startswith("page: http://127.0.0.1:")
    assert calls == ["nice 15", 0.5, 0.5, 0.5]  # two polls and the time for the last update
    assert view("--listen", "127.0.0.1:0", "--with-parent", "7")[3] == [7, "nice 15", 0.1, 0.1, 0.5]
    assert view("--with-parent", "7", parent_runs=False) == (0, "", "", [7])
    assert view("--listen", "0.0.0.0:0")[:2] == (2, "")


def test_port_in_use_is_an_error_except_for_the_harness(view):
    server = ViewServer(("127.0.0.1", 0), Guard("", is_loopback=True), Hub(bytes))
    listen = f"127.0.0.1:{server.server_address[1]}"
    code, _, error, _ = view("--listen", listen)
    assert (code, "Address already in use" in error) == (2, True)
    code, output, _, _ = view("--listen", listen, "--with-parent", "7")
    assert (code, listen in output) == (0, False)
    assert int(output.rpartition(":")[2].rstrip("/\n")) >= 1024
    server.server_close()


@pytest.mark.parametrize("listen", ["127.0.0.1:0", "0.0.0.0:0"])
def test_other_computers_use_the_name_of_this_one(listen, tmp_path, monkeypatch):
    (tmp_path / "token").touch(mode=0o600)
    (tmp_path / "token").write_text("0123456789abcdef")
    monkeypatch.setattr(command.socket, "gethostname", lambda: "Boat")
    server = command._open_server(listen, tmp_path / "token", Hub(bytes), any_port=False)
    server.server_close()
    is_loopback = listen.startswith("127")
    names = set() if is_loopback else {"boat", "boat.local"}
    assert server.guard == Guard("0123456789abcdef", is_loopback, frozenset(names))


def test_lines_of_the_harness_are_read_until_the_pipe_closes(monkeypatch):
    lines, ended = [], command.threading.Event()
    data = b"first\n" + b"x" * 20_000 + b"\nlast"
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(data)))
    command._read_harness(SimpleNamespace(add_line=lines.append), ended)
    assert (b"".join(lines), max(map(len, lines)), ended.is_set()) == (data, 16_384, True)


RUNNING = StatusReading(Freshness.RUNNING, {"state_directory": "boat"}, 1.0)
STALE = StatusReading(Freshness.STALE, {"state_directory": "old"}, 99.0)


@pytest.mark.parametrize(
    ("statuses", "directory", "reason"),
    [
        ([RUNNING, STALE], Path("boat"), ""),
        ([RUNNING, RUNNING], None, "several autopilots run here; choose one with --state"),
        ([STALE], None, "no autopilot runs here"),
    ],
)
def test_the_only_autopilot_that_runs_is_shown(monkeypatch, statuses, directory, reason):
    monkeypatch.setattr(command, "find_all_statuses", lambda _machine_s: dict(enumerate(statuses)))
    monkeypatch.setattr(command, "find_status", lambda state, _machine_s: state)
    assert command._find_directory(None) == directory
    assert command._find_status(None).reason == reason
    assert command._find_directory(Path("x")) == command._find_status(Path("x")) == Path("x")


def test_readable_plans_of_the_state_directory_are_shown(tmp_path):
    store = Store(tmp_path)
    store.save(
        PLAN_FILES[PlanKind.MISSION], to_text(Plan.of(PlanKind.MISSION, [PlanItem(Command.WAYPOINT, x=10**7)])).encode()
    )
    store.save(PLAN_FILES[PlanKind.FENCE], b"damaged")
    store.close()
    assert command._read_plans(tmp_path) == {"mission": [[Command.WAYPOINT, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]]}
    assert command._read_plans(None) == {}
