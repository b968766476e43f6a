"""`rambler listen`: output once a second, end and exit code."""

import json
from types import SimpleNamespace

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import listen as command
from firmware_py.cli.bench_session import BenchDevice


@pytest.fixture
def listen(monkeypatch, capsys):
    """Return a function that listens to two fake devices for some polls; the result is code, output and calls."""

    def run(*words, polls=20, counts=(1, 1), interrupted=False):
        calls = []
        devices = [
            BenchDevice(role, "nmea", "/dev/x", sample_count=count)
            for role, count in zip(("compass", "rudder"), counts, strict=True)
        ]

        def poll(seconds):
            calls.append(seconds)
            for _ in range(polls):
                yield ()
            if interrupted:
                raise KeyboardInterrupt

        session = SimpleNamespace(devices=devices, listen=poll, close=lambda: calls.append("close"))
        monkeypatch.setattr(command, "load", lambda path: path)
        monkeypatch.setattr(command, "BenchSession", lambda _vehicle: session)
        code = main(["listen", "boat.toml", *words])
        return code, capsys.readouterr().out, calls

    return run


def test_devices_are_printed_once_a_second(listen):
    for polls, times in ((9, 0), (10, 1), (29, 2)):
        code, output, calls = listen("--json", polls=polls)
        rows = [json.loads(line)["device"] for line in output.splitlines()]
        assert (code, rows, calls) == (0, ["compass", "rudder"] * times, [None, "close"])
    lines = listen(polls=20)[1].split("\n")
    assert [line.split()[:1] for line in lines] == [["compass"], ["rudder"], [], ["compass"], ["rudder"], [], []]


def test_a_silent_device_is_a_finding_also_after_an_interrupt(listen):
    assert listen(counts=(1, 0), interrupted=True)[0] == 1
    assert listen(counts=(2, 1), interrupted=True)[::2] == (0, [None, "close"])


@pytest.mark.parametrize(("seconds", "code"), [("0", 2), ("-1", 2), ("nan", 2), ("1e7", 2), ("0.5", 0), ("9.9e6", 0)])
def test_duration_is_positive_and_at_most_months(listen, seconds, code):
    assert listen("--seconds", seconds)[0] == code
    assert listen("--seconds", "2")[2][0] == 2.0
