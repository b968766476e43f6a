"""Console: order of lines, texts printed early, a blocked and a non-blocking output."""

import fcntl
import os
import select

import pytest

from firmware_py.system import console
from firmware_py.system.console import Console

PIPE_BYTES = 4096


@pytest.fixture
def output(monkeypatch):
    """Return the reading end of a small pipe that is the standard error of the console."""
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
    monkeypatch.setattr(console, "STANDARD_ERROR", writer)
    os.set_blocking(reader, False)
    yield reader
    os.close(reader)
    os.close(writer)


def read(descriptor, count):
    data = b""
    while len(data) < count:
        assert select.select([descriptor], [], [], 10.0)[0]
        data += os.read(descriptor, count - len(data))
    return data


def test_lines_are_written_in_order_and_before_the_end(output):
    lines = Console()
    lines.line("one")
    lines.line("two \udcff")
    lines.close()
    assert os.read(output, 100) == b"one\ntwo \\udcff\n"


def test_lines_are_written_to_standard_error(capfd):
    lines = Console()
    lines.line("text")
    lines.close()
    assert tuple(capfd.readouterr()) == ("", "text\n")


def test_event_that_was_printed_early_is_not_printed_again(output):
    lines = Console()
    lines.print_early("Mode HOLD")
    lines.event("0.1 s", "Mode HOLD")
    lines.event("9.0 s", "Mode HOLD")
    lines.close()
    assert os.read(output, 100) == b"Mode HOLD\n9.0 s Mode HOLD\n"


def test_lines_beyond_200_are_lost_and_counted_while_the_output_is_blocked(output):
    lines = Console()
    first = "x" * (PIPE_BYTES + 100)
    lines.line(first)
    while len(select.select([output], [], [])[0]) == 0 or pending(output) < PIPE_BYTES:
        os.sched_yield()
    for number in range(307):
        lines.line(f"{number:03d}")
    expected = f"{first}\n(107 lines lost: output was blocked)\n" + "".join(f"{number:03d}\n" for number in range(200))
    assert read(output, len(expected)).decode() == expected
    lines.line("end")
    lines.close()
    assert os.read(output, 100) == b"end\n"  # the loss is reported once


def pending(descriptor):
    count = bytearray(4)
    fcntl.ioctl(descriptor, 0x541B, count)  # FIONREAD
    return int.from_bytes(count, "little")


def test_output_that_another_program_has_set_to_non_blocking_gets_all_bytes_without_busy_waiting(output, monkeypatch):
    os.set_blocking(console.STANDARD_ERROR, False)
    write, calls = os.write, []
    monkeypatch.setattr(os, "write", lambda *values: calls.append(values) or write(*values))
    lines = Console()
    text = "y" * (3 * PIPE_BYTES)
    lines.line(text)
    while pending(output) < PIPE_BYTES:
        os.sched_yield()
    for _ in range(1000):
        os.sched_yield()
    assert read(output, len(text) + 1).decode() == f"{text}\n"
    lines.close()
    assert len(calls) < 100
