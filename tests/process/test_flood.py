"""Floods against the real process, on every class of link: the loop does not feel them."""

import json
import os
import pty
import socket
import subprocess
import sys
import time
import tty
from contextlib import ExitStack

import pytest
from pymavlink.dialects.v20 import common as mavlink

from hil.bench.machine import cpu_of, memory_of
from hil.bench.sea import Sea
from hil.bench.tick import logged
from support import bare_sleep
from support.bare_sleep import spread
from support.paths import ROOT
from support.program import unused_ports

FLOOD = ROOT / "tests" / "clients" / "flood.py"
SINK = FLOOD.with_name("sink.py")
SECONDS = float(os.environ.get("FLOOD_S", "60"))
SETTLE_S = 3.0
MOST_GROWTH_MIB = 4.0
MOST_RATIO = 2.0
# A busy machine makes single ticks late by about this, quiet or not; a ratio of less than that says nothing.
RESOLUTION_S = 500e-6
PARAMETER = b"RUD_LIMIT_DEG"
# Of all floods together: each kind has come round once in a turn, and the turns go round so that quiet, flooded and
# bare have the same weather.
TURN_S = 12.0
TURNS = max(1, round(1.6 * SECONDS / TURN_S))
REST_S = 1.0
LOOK_S = 0.5
TOGETHER_HZ = 50
MOST_BUSY = 0.9


class Line:
    """One end of a link to the boat: asks for a parameter and waits for the answer."""

    def __init__(self, read, write):
        self._read, self._write = read, write
        self._mav = mavlink.MAVLink(None, srcSystem=251, srcComponent=190)
        self._mav.robust_parsing = True

    def greet(self):
        self._write(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(self._mav))

    def keep_up(self):
        """Read the input and send a heartbeat: a peer that is silent or does not read loses its link."""
        while self._read():
            pass
        self.greet()

    def seconds_until_answered(self, patience_s):
        """Ask again and again, as ground stations do, until a PARAM_VALUE comes; None in vain."""
        start_s = time.monotonic()
        while time.monotonic() - start_s < patience_s:
            self._write(mavlink.MAVLink_param_request_read_message(1, 1, PARAMETER, -1).pack(self._mav))
            again_s = time.monotonic() + 0.25
            while time.monotonic() < again_s:
                for message in self._mav.parse_buffer(self._read()) or []:
                    if message.get_type() == "PARAM_VALUE" and message.param_id == PARAMETER.decode():
                        return time.monotonic() - start_s
        return None


def waiting(read):
    """A read that waits a moment for the first bytes."""

    def reader():
        try:
            return read()
        except (BlockingIOError, TimeoutError, ConnectionRefusedError):
            time.sleep(0.001)
            return b""

    return reader


class Udp:
    def __init__(self):
        self.port = unused_ports(["udpin"])[0]
        self.url, self.words, self.inherited = f"udpin:127.0.0.1:{self.port}", ["udp", str(self.port)], ()

    def line(self, closing):
        end = closing.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        end.connect(("127.0.0.1", self.port))
        end.setblocking(False)
        return Line(waiting(lambda: end.recv(65536)), end.send)


class Tcp:
    def __init__(self):
        self.port = unused_ports(["tcpin"])[0]
        self.url, self.words, self.inherited = f"tcpin:127.0.0.1:{self.port}", ["tcp", str(self.port)], ()

    def line(self, closing):
        end = closing.enter_context(socket.create_connection(("127.0.0.1", self.port)))
        end.setblocking(False)
        return Line(waiting(lambda: end.recv(65536)), end.send)


class Serial:
    """Flooded and asked over the same line."""

    def __init__(self):
        self.near, self.far = pty.openpty()
        tty.setraw(self.near)
        tty.setraw(self.far)
        os.set_blocking(self.near, False)
        self.url = f"serial:{os.ttyname(self.far)}:921600"
        self.words, self.inherited = ["pty", str(self.near)], (self.near,)

    def line(self, closing):
        closing.callback(os.close, self.far)
        closing.callback(os.close, self.near)
        return Line(waiting(lambda: os.read(self.near, 65536)), self.write)

    def write(self, data):
        try:
            os.write(self.near, data)
        except BlockingIOError:
            pass  # what the flood has left is still to be read; asked again


@pytest.mark.proof
@pytest.mark.timeout(400)
@pytest.mark.parametrize("rate_hz", [10, 50])
@pytest.mark.parametrize("make", [Udp, Tcp, Serial])
def test_a_flood_does_not_delay_the_loop(make, rate_hz, tmp_path, figures):
    link = make()
    with ExitStack() as closing, Sea(tmp_path / "sea", rate_hz, links=(link.url,)) as sea:
        line = link.line(closing)
        sea.listen(SETTLE_S)
        line.greet()
        assert line.seconds_until_answered(5.0) is not None
        sea.listen(SETTLE_S)
        pid = sea.autopilot()
        # Half of the quiet time before and half behind the flood: the machine has its weather, too.
        before_s = boat_time(sea)
        sea.listen(SECONDS / 2)
        before_mib = memory_of(pid).now_mib
        words = [sys.executable, str(FLOOD), *link.words, str(SECONDS)]
        flood = closing.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE, pass_fds=link.inherited))
        flood_from_s = boat_time(sea)
        early_mib = None
        while flood.poll() is None:
            sea.listen(1.0)
            line.greet()  # a ground station goes on with its heartbeats
            if early_mib is None and boat_time(sea) - flood_from_s > SECONDS / 4:
                early_mib = memory_of(pid).now_mib  # every kind of flood has been seen once
        answered_s = line.seconds_until_answered(5.0)
        flood_to_s, after_mib = boat_time(sea), memory_of(pid).now_mib
        sea.listen(SECONDS / 2 + 1.0)
        after_s = boat_time(sea)
        assert sea.autopilot() == pid
        taken = json.loads(flood.stdout.read())
    assert "Traceback" not in (tmp_path / "sea" / "firmware.log").read_text()
    ticks = [inputs.tick for inputs in logged(tmp_path / "sea")]
    flooded = spread([tick.late_s for tick in ticks if flood_from_s <= tick.t_s <= flood_to_s])
    quiet = spread(
        [tick.late_s for tick in ticks if before_s <= tick.t_s < flood_from_s or flood_to_s + 1.0 < tick.t_s <= after_s]
    )
    bare = as_busy_and_bare(rate_hz)
    print(
        f"\n{make.__name__} at {rate_hz} Hz: {taken / SECONDS / 1e6:.1f} MB/s taken; lateness p99.9 quiet "
        f"{quiet.p999 * 1e6:.0f} us, flooded {flooded.p999 * 1e6:.0f} us, bare {bare.p999 * 1e6:.0f} us; "
        f"memory {before_mib:.1f}, {early_mib:.1f}, {after_mib:.1f} MiB; answered after {answered_s} s"
    )
    for name, found in (("quiet", quiet), ("flooded", flooded), ("bare", bare)):
        figures.keep(f"flood_{make.__name__.lower()}_{rate_hz}_hz_{name}", found.p999 * 1e3, "ms")
    assert answered_s is not None
    assert answered_s < 1.0
    assert after_mib - before_mib < MOST_GROWTH_MIB
    assert flooded.count > 0.99 * rate_hz * (flood_to_s - flood_from_s) - 1
    assert flooded.p999 < MOST_RATIO * max(quiet.p999, bare.p999, RESOLUTION_S)


@pytest.mark.proof
@pytest.mark.timeout(600)
def test_floods_of_every_link_and_of_the_disk_do_not_delay_the_loop(tmp_path, figures):
    links, sinks = [Udp(), Tcp(), Serial()], [Udp(), Tcp(), Serial()]
    windows = {"quiet": [], "flooded": []}
    bare_s, taken, busy = [], [], None
    urls = tuple(link.url for link in links)
    with ExitStack() as closing, Sea(tmp_path / "sea", TOGETHER_HZ, links=urls) as sea:
        lines = [link.line(closing) for link in links]
        swallower = sink_of(closing, sinks)
        sea.listen(SETTLE_S)
        for line in lines:
            line.greet()
            assert line.seconds_until_answered(5.0) is not None
        pid = sea.autopilot()
        ahead_s = boat_time(sea) - time.monotonic()  # neither clock ever jumps
        for _ in range(TURNS):
            listened(sea, lines, REST_S)
            windows["quiet"].append(window(ahead_s, listened, sea, lines, TURN_S))
            used_s, start_s = cpu_of(pid), time.monotonic()
            windows["flooded"].append(window(ahead_s, poured, sea, lines, links, tmp_path, taken))
            busy = busy or min(MOST_BUSY, (cpu_of(pid) - used_s) / (time.monotonic() - start_s))
            words = bare_sleep.command(TOGETHER_HZ, int(TURN_S * TOGETHER_HZ), busy)
            with subprocess.Popen(words, stdout=subprocess.PIPE) as bare:
                poured(sea, lines, sinks, tmp_path, [])
                bare_s += json.loads(bare.communicate()[0])
        answered_s = [line.seconds_until_answered(5.0) for line in lines]
        assert sea.autopilot() == pid
        assert swallower.poll() is None
    assert "Traceback" not in (tmp_path / "sea" / "firmware.log").read_text()
    ticks = [inputs.tick for inputs in logged(tmp_path / "sea")]
    found = {
        name: spread([tick.late_s for tick in ticks for first_s, last_s in spans if first_s <= tick.t_s <= last_s])
        for name, spans in windows.items()
    }
    found["bare"] = spread(bare_s)
    rates = [sum(taken[kind::4]) / (TURNS * TURN_S * 1e6) for kind in range(4)]
    print("\nMB/s taken by udp, tcp, serial and disk: " + ", ".join(f"{rate:.1f}" for rate in rates))
    print(f"bare is busy for {busy:.2f} of its period; late by, us:")
    for name, each in found.items():
        print(f"  {name}: p50 {each.p50 * 1e6:.0f}, p99 {each.p99 * 1e6:.0f}, p99.9 {each.p999 * 1e6:.0f}, "
              f"at most {each.max * 1e6:.0f}; {each.count} ticks")  # fmt: skip
        figures.keep(f"flood_together_{name}", each.p999 * 1e3, "ms")
    assert all(one is not None and one < 1.0 for one in answered_s), answered_s
    assert (
        found["flooded"].count
        > 0.99 * TOGETHER_HZ * sum(last_s - first_s for first_s, last_s in windows["flooded"]) - 1
    )
    assert found["flooded"].p999 <= MOST_RATIO * max(found["quiet"].p999, found["bare"].p999, RESOLUTION_S)


def window(ahead_s, act, *arguments):
    """Act, and return from when to when that was: the last TURN_S of it, by the boat's clock."""
    act(*arguments)
    end_s = time.monotonic() + ahead_s
    return end_s - TURN_S, end_s


def listened(sea, lines, seconds):
    """Let the stations at the lines listen and tell of themselves, as ground stations do."""
    for _ in range(round(seconds / LOOK_S)):
        sea.listen(LOOK_S)
        for line in lines:
            line.keep_up()


def sink_of(closing, links):
    """A process that reads all that is poured into links of unread_socket's."""
    udp, tcp, serial = links
    words = [sys.executable, str(SINK), str(udp.port), str(tcp.port), str(serial.far)]
    sink = closing.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE, pass_fds=(serial.far,)))
    closing.callback(sink.kill)
    closing.callback(os.close, serial.far)
    closing.callback(os.close, serial.near)
    assert sink.stdout.readline() == b"ready\n"
    return sink


def poured(sea, lines, links, directory, taken):
    """Flood links and the disk for a turn; `taken` gets how many bytes each of them took."""
    ways = [*(link.words for link in links), ["disk", str(directory)]]
    handed = tuple(number for link in links for number in link.inherited)
    floods = [
        subprocess.Popen([sys.executable, str(FLOOD), *way, str(TURN_S)], stdout=subprocess.PIPE, pass_fds=handed)
        for way in ways
    ]
    try:
        while all(flood.poll() is None for flood in floods):
            listened(sea, lines, LOOK_S)
        taken += [json.loads(flood.communicate()[0]) for flood in floods]
    finally:
        for flood in floods:
            flood.kill()
            flood.wait()
            flood.stdout.close()


def as_busy_and_bare(rate_hz):
    """Lateness of a process that computes for half of each period, while a flood goes to an unread socket.

    A shared machine takes its processor from those who use it, for milliseconds: that is no doing of the autopilot's.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unread_socket:
        unread_socket.bind(("127.0.0.1", 0))
        words = [sys.executable, str(FLOOD), "udp", str(unread_socket.getsockname()[1]), str(SECONDS)]
        with subprocess.Popen(words, stdout=subprocess.DEVNULL):
            words = bare_sleep.command(rate_hz, round(SECONDS * rate_hz), 0.5)
            done = subprocess.run(words, capture_output=True, check=True, timeout=SECONDS + 30.0)
            return spread(json.loads(done.stdout))


def boat_time(sea):
    """The autopilot's clock, by its telemetry."""
    found = []

    def matches(message):
        if message.get_type() == "SYSTEM_TIME":
            found.append(message.time_boot_ms / 1e3)
        return bool(found)

    assert sea.station.receive(10.0, matches) is not None
    return found[-1]
