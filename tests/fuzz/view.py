"""External input of the live page: requests of browsers, lines of a harness, status files."""

import contextlib
import ipaddress
import json
import tempfile
from pathlib import Path
from unittest.mock import patch

from firmware_py.cli import status as command
from firmware_py.install import update
from firmware_py.install.bundle import UpdateError
from firmware_py.system.status_file import Freshness, StatusReading, file_name, find_status
from firmware_py.view.feed import Feed
from firmware_py.view.guard import COOKIE, Guard
from firmware_py.view.history import History
from fuzz.target import Target, check_line

TOKEN = "0123456789abcdef"
LOOPBACK_GUARD, TOKEN_GUARD = Guard("", is_loopback=True), Guard(TOKEN, is_loopback=False)
NOW_S = 1000.0
STATUSES = {200, 303, 403, 405, 414, 421}


def is_loopback(host):
    """Return whether a host, with or without port, is this computer; independent of the guard."""
    name = host.rsplit(":", 1)[0] if host.rsplit(":", 1)[-1].isdigit() else host
    if name.strip("[]").lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(name.strip("[]")).is_loopback
    except ValueError:
        return False


def judge_request(data):
    """Judge a request; the lines are method with target, and headers."""
    method, _, rest = data.decode("latin-1").partition(" ")
    target, *lines = rest.split("\n")
    headers = {text_line.partition(":")[0].strip(): text_line.partition(":")[2].strip() for text_line in lines}
    for guard in (LOOPBACK_GUARD, TOKEN_GUARD):
        verdict = guard.check(method, target, headers)
        assert verdict.status in STATUSES
        if verdict.status in (200, 303):
            assert method in ("GET", "HEAD")
            assert headers.get("Origin", f"http://{headers['Host']}") == f"http://{headers['Host']}"
        if verdict.status == 200:
            assert is_loopback(headers["Host"]) if guard is LOOPBACK_GUARD else TOKEN in headers["Cookie"]
        assert (verdict.status == 303) == verdict.sets_cookie


def add_line(data):
    """Feed lines of a harness; readers receive valid JSON for any line."""
    history = History()
    feed = Feed(history, lambda: StatusReading(Freshness.ABSENT), dict)
    for text_line in data.split(b"\n"):
        feed.add_line(text_line)
    message = feed.poll()
    json.loads(history.all_data())
    assert message is None or json.loads(message)["marks"] == []


def poll_status(data):
    """Poll a status with any content, since other users may write one."""
    try:
        content = json.loads(data)
        content |= {"written_machine_s": float(content.get("written_machine_s", 0.0)), "pid": 1, "state_directory": ""}
    except (ValueError, TypeError, AttributeError, RecursionError, OverflowError):
        return  # rejected by system.status_file
    history = History()
    feed = Feed(history, lambda: StatusReading(Freshness.RUNNING, content, 0.1), dict)
    message = feed.poll()
    json.loads(history.all_data(), parse_constant=reject_constant)
    json.loads(message, parse_constant=reject_constant)


def status_file(data):
    """Read a status file like all its readers: `rambler status`, its JSON output, the page and an update."""
    with tempfile.TemporaryDirectory() as name:
        state = Path(name) / "state"
        state.mkdir()
        (Path(name) / file_name(state)).write_bytes(data)
        status_found = find_status(state, NOW_S, (Path(name),))
        assert status_found.content or status_found.reason
        check_line(status_found.reason or "none")
        message = command._complete_status(status_found, state)
        json.dumps(message, allow_nan=False)
        with contextlib.suppress(KeyError, TypeError, ValueError, AttributeError, OverflowError):  # as the command does
            for text_line in command._status_lines(message):
                assert text_line.isprintable()
        with contextlib.suppress(UpdateError), patch.object(update, "find_status", lambda *_: status_found):
            update._check_unarmed(state, update.Permissions(armed=False, older=False))
        history = History()
        new = Feed(history, lambda: status_found, dict).poll()
        json.loads(history.all_data(), parse_constant=reject_constant)
        json.loads(new, parse_constant=reject_constant)


def reject_constant(constant):
    """Raise for NaN and infinities, which are not valid JSON."""
    raise AssertionError(constant)


TARGETS = {
    "view_request": Target(
        judge_request,
        words=(
            b"GET /", b"HEAD /events", b"?token=", TOKEN.encode(), b"\nHost: localhost:8046", b"\nHost: 127.0.0.1",
            b"\nHost: [::1]:1", b"\nOrigin: http://", b"\nSec-Fetch-Site: cross-site", b"\nSec-Fetch-Mode: navigate",
            f"\nCookie: {COOKIE}={TOKEN}".encode(),
        ),
    ),
    "view_line": Target(
        add_line, words=(b'{"time_s": 1.0, "true_heading_deg": 3}', b'"title": ', b"NaN", b"1e999", b"\n")
    ),
    "status_file": Target(
        status_file,
        words=(
            b'{"written_machine_s":1000,"pid":1,"state_directory":"/x",', b'"mode":"HOLD"', b'"armed":true', b"1e400",
            b"NaN", b"[" * 20,
            b'"faults":[{"severity":"ERROR","fault":"X","since_s":1,"text":"x"}]', b'"devices":[]', b'"links":[]',
            b'"uptime_s":1', b'"utc_s":2e9', b'"\\u001b"', b"1" + b"0" * 400, b'"traffic":{"nearest":[{}]}', b"null",
        ),
    ),
    "view_status": Target(
        poll_status,
        words=(
            b'"uptime_s":1', b'"utc_s":2e9', b'"events":[{"t_s":1,"severity":4,"text":"x"}]', b'"faults":[]',
            b'"home":{', b'"position":{"lat_deg":36,"lon_deg":121}', b"Infinity", b"1e999",
        ),
    ),
}  # fmt: skip
