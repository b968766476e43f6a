"""Floods on every class of link do not delay the control loop of the real process."""

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

from hil.bench.background_run import BackgroundRun
from hil.bench.machine import cpu_of, memory_of
from hil.bench.tick import logged_inputs
from support import bare_sleep
from support.bare_sleep import spread
from support.paths import ROOT
from support.program import unused_ports

FLOOD = ROOT / "tests" / "clients" / "flood.py"
SINK = FLOOD.with_name("sink.py")
FLOOD_TIME_S = float(os.environ.get("FLOOD_S", "60"))
SETTLING_S = 3.0
MAX_GROWTH_MIB = 4.0
MAX_LATENESS_RATIO = 2.0
# On a busy machine single ticks are late by about this in any case; smaller latenesses are not compared.
RESOLUTION_S = 500e-6
PARAMETER = b"RUD_LIMIT_DEG"
# All floods together: each kind occurs once in a turn. Quiet, flooded and bare turns alternate, so that the load of the
# machine is the same for all.
TURN_S = 12.0
TURNS = max(1, round(1.6 * FLOOD_TIME_S / TURN_S))
PAUSE_S = 1.0
LISTEN_INTERVAL_S = 0.5
ALL_LINKS_RATE_HZ = 50
MAX_BUSY_FRACTION = 0.9


class LinkEnd:
    """The end of a link at a ground station: requests a parameter and waits for the reply."""

    def __init__(self, read, write):
        self._read, self._write = read, write
        self._mav = mavlink.MAVLink(None, srcSystem=251, srcComponent=190)
        self._mav.robust_parsing = True

    def send_heartbeat(self):
        self._write(
            mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0, 3).pack(
                self._mav
            )
        )

    def read_and_send_heartbeat(self):
        """Read the input and send a heartbeat, without which the link would be closed."""
        while self._read():
            pass
        self.send_heartbeat()

    def request_parameter_s(self, timeout_s):
        """Repeat a request until a PARAM_VALUE arrives; return the time, None after the timeout."""
        start_s = time.monotonic()
        while time.monotonic() - start_s < timeout_s:
            self._write(mavlink.MAVLink_param_request_read_message(1, 1, PARAMETER, -1).pack(self._mav))
            next_request_s = time.monotonic() + 0.25
            while time.monotonic() < next_request_s:
                for message in self._mav.parse_buffer(self._read()) or []:
                    if message.get_type() == "PARAM_VALUE" and message.param_id == PARAMETER.decode():
                        return time.monotonic() - start_s
        return None


def read_or_wait(read):
    """Return a function that reads, or waits for a millisecond and returns nothing."""

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
        self.url, self.words, self.descriptors_of_link = f"udpin:127.0.0.1:{self.port}", ["udp", str(self.port)], ()

    def line(self, closing):
        end = closing.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        end.connect(("127.0.0.1", self.port))
        end.setblocking(False)
        return LinkEnd(read_or_wait(lambda: end.recv(65536)), end.send)


class Tcp:
    def __init__(self):
        self.port = unused_ports(["tcpin"])[0]
        self.url, self.words, self.descriptors_of_link = f"tcpin:127.0.0.1:{self.port}", ["tcp", str(self.port)], ()

    def line(self, closing):
        end = closing.enter_context(socket.create_connection(("127.0.0.1", self.port)))
        end.setblocking(False)
        return LinkEnd(read_or_wait(lambda: end.recv(65536)), end.send)


class Serial:
    """A serial line: flood and requests use the same line."""

    def __init__(self):
        self.near, self.far = pty.openpty()
        tty.setraw(self.near)
        tty.setraw(self.far)
        os.set_blocking(self.near, False)
        self.url = f"serial:{os.ttyname(self.far)}:921600"
        self.words, self.descriptors_of_link = ["pty", str(self.near)], (self.near,)

    def line(self, closing):
        closing.callback(os.close, self.far)
        closing.callback(os.close, self.near)
        return LinkEnd(read_or_wait(lambda: os.read(self.near, 65536)), self.write)

    def write(self, data):
        try:
            os.write(self.near, data)
        except BlockingIOError:
            pass  # the line is full; the request is repeated


@pytest.mark.proof
@pytest.mark.timeout(400)
@pytest.mark.parametrize("rate_hz", [10, 50])
@pytest.mark.parametrize("make_link", [Udp, Tcp, Serial])
def test_flood_of_one_link_does_not_delay_the_loop(make_link, rate_hz, tmp_path, figures):
    link = make_link()
    with ExitStack() as closing, BackgroundRun(tmp_path / "sea", rate_hz, links=(link.url,)) as sea:
        line = link.line(closing)
        sea.listen(SETTLING_S)
        line.send_heartbeat()
        assert line.request_parameter_s(5.0) is not None
        sea.listen(SETTLING_S)
        pid = sea.autopilot()
        # Half of the quiet time before and half after the flood, since the load of the machine varies.
        quiet_start_s = boat_time_s(sea)
        sea.listen(FLOOD_TIME_S / 2)
        initial_mib = memory_of(pid).now_mib
        words = [sys.executable, str(FLOOD), *link.words, str(FLOOD_TIME_S)]
        flood = closing.enter_context(
            subprocess.Popen(words, stdout=subprocess.PIPE, pass_fds=link.descriptors_of_link)
        )
        flood_from_s = boat_time_s(sea)
        early_mib = None
        while flood.poll() is None:
            sea.listen(1.0)
            line.send_heartbeat()  # as a ground station does
            if early_mib is None and boat_time_s(sea) - flood_from_s > FLOOD_TIME_S / 4:
                early_mib = memory_of(pid).now_mib  # after each kind of flood
        reply_time_s = line.request_parameter_s(5.0)
        flood_to_s, final_mib = boat_time_s(sea), memory_of(pid).now_mib
        sea.listen(FLOOD_TIME_S / 2 + 1.0)
        quiet_end_s = boat_time_s(sea)
        assert sea.autopilot() == pid
        bytes_taken = json.loads(flood.stdout.read())
    assert "Traceback" not in (tmp_path / "sea" / "firmware.log").read_text()
    ticks = [inputs.tick for inputs in logged_inputs(tmp_path / "sea")]
    flooded = spread([tick.late_s for tick in ticks if flood_from_s <= tick.t_s <= flood_to_s])
    quiet = spread(
        [
            tick.late_s
            for tick in ticks
            if quiet_start_s <= tick.t_s < flood_from_s or flood_to_s + 1.0 < tick.t_s <= quiet_end_s
        ]
    )
    bare = measure_bare_lateness(rate_hz)
    print(
        f"\n{make_link.__name__} at {rate_hz} Hz: {bytes_taken / FLOOD_TIME_S / 1e6:.1f} MB/s; lateness p99.9 quiet "
        f"{quiet.p999 * 1e6:.0f} us, flooded {flooded.p999 * 1e6:.0f} us, bare {bare.p999 * 1e6:.0f} us; "
        f"memory {initial_mib:.1f}, {early_mib:.1f}, {final_mib:.1f} MiB; answered after {reply_time_s} s"
    )
    for name, lateness in (("quiet", quiet), ("flooded", flooded), ("bare", bare)):
        figures.keep(f"flood_{make_link.__name__.lower()}_{rate_hz}_hz_{name}", lateness.p999 * 1e3, "ms")
    assert reply_time_s is not None
    assert reply_time_s < 1.0
    assert final_mib - initial_mib < MAX_GROWTH_MIB
    assert flooded.count > 0.99 * rate_hz * (flood_to_s - flood_from_s) - 1
    assert flooded.p999 < MAX_LATENESS_RATIO * max(quiet.p999, bare.p999, RESOLUTION_S)


@pytest.mark.proof
@pytest.mark.timeout(600)
def test_floods_of_all_links_and_the_disk_together_do_not_delay_the_loop(tmp_path, figures):
    links, sinks = [Udp(), Tcp(), Serial()], [Udp(), Tcp(), Serial()]
    windows = {"quiet": [], "flooded": []}
    bare_lateness_s, bytes_taken, busy_fraction = [], [], None
    urls = tuple(link.url for link in links)
    with ExitStack() as closing, BackgroundRun(tmp_path / "sea", ALL_LINKS_RATE_HZ, links=urls) as sea:
        lines = [link.line(closing) for link in links]
        sink = start_sink(closing, sinks)
        sea.listen(SETTLING_S)
        for line in lines:
            line.send_heartbeat()
            assert line.request_parameter_s(5.0) is not None
        pid = sea.autopilot()
        clock_offset_s = boat_time_s(sea) - time.monotonic()  # constant: both clocks are monotonic
        for _ in range(TURNS):
            listen(sea, lines, PAUSE_S)
            windows["quiet"].append(run_window(clock_offset_s, listen, sea, lines, TURN_S))
            used_s, start_s = cpu_of(pid), time.monotonic()
            windows["flooded"].append(run_window(clock_offset_s, flood, sea, lines, links, tmp_path, bytes_taken))
            busy_fraction = busy_fraction or min(
                MAX_BUSY_FRACTION, (cpu_of(pid) - used_s) / (time.monotonic() - start_s)
            )
            words = bare_sleep.command(ALL_LINKS_RATE_HZ, int(TURN_S * ALL_LINKS_RATE_HZ), busy_fraction)
            with subprocess.Popen(words, stdout=subprocess.PIPE) as bare:
                flood(sea, lines, sinks, tmp_path, [])
                bare_lateness_s += json.loads(bare.communicate()[0])
        reply_time_s = [line.request_parameter_s(5.0) for line in lines]
        assert sea.autopilot() == pid
        assert sink.poll() is None
    assert "Traceback" not in (tmp_path / "sea" / "firmware.log").read_text()
    ticks = [inputs.tick for inputs in logged_inputs(tmp_path / "sea")]
    spreads = {
        name: spread([tick.late_s for tick in ticks for start_s, end_s in windows_s if start_s <= tick.t_s <= end_s])
        for name, windows_s in windows.items()
    }
    spreads["bare"] = spread(bare_lateness_s)
    rates = [sum(bytes_taken[link_number::4]) / (TURNS * TURN_S * 1e6) for link_number in range(4)]
    print("\nMB/s taken by udp, tcp, serial and disk: " + ", ".join(f"{rate:.1f}" for rate in rates))
    print(f"bare is busy for {busy_fraction:.2f} of its period; late by, us:")
    for name, lateness in spreads.items():
        print(f"  {name}: p50 {lateness.p50 * 1e6:.0f}, p99 {lateness.p99 * 1e6:.0f}, p99.9 {lateness.p999 * 1e6:.0f}, "
              f"at most {lateness.max * 1e6:.0f}; {lateness.count} ticks")  # fmt: skip
        figures.keep(f"flood_together_{name}", lateness.p999 * 1e3, "ms")
    assert all(reply_s is not None and reply_s < 1.0 for reply_s in reply_time_s), reply_time_s
    flooded_s = sum(end_s - start_s for start_s, end_s in windows["flooded"])
    assert spreads["flooded"].count > 0.99 * ALL_LINKS_RATE_HZ * flooded_s - 1
    reference_s = max(spreads["quiet"].p999, spreads["bare"].p999, RESOLUTION_S)
    assert spreads["flooded"].p999 <= MAX_LATENESS_RATIO * reference_s


def run_window(clock_offset_s, action, *arguments):
    """Run an action; return start and end of its last TURN_S by the clock of the boat."""
    action(*arguments)
    end_s = time.monotonic() + clock_offset_s
    return end_s - TURN_S, end_s


def listen(sea, lines, seconds):
    """Let the ground stations read and send heartbeats for some seconds."""
    for _ in range(round(seconds / LISTEN_INTERVAL_S)):
        sea.listen(LISTEN_INTERVAL_S)
        for line in lines:
            line.read_and_send_heartbeat()


def start_sink(closing, links):
    """Start a process that reads the floods of links that lead to no boat."""
    udp, tcp, serial = links
    words = [sys.executable, str(SINK), str(udp.port), str(tcp.port), str(serial.far)]
    sink = closing.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE, pass_fds=(serial.far,)))
    closing.callback(sink.kill)
    closing.callback(os.close, serial.far)
    closing.callback(os.close, serial.near)
    assert sink.stdout.readline() == b"ready\n"
    return sink


def flood(sea, lines, links, directory, bytes_taken):
    """Flood links and the disk for a turn; append the bytes accepted by each to `bytes_taken`."""
    targets = [*(link.words for link in links), ["disk", str(directory)]]
    descriptors = tuple(number for link in links for number in link.descriptors_of_link)
    floods = [
        subprocess.Popen(
            [sys.executable, str(FLOOD), *target, str(TURN_S)], stdout=subprocess.PIPE, pass_fds=descriptors
        )
        for target in targets
    ]
    try:
        while all(flood.poll() is None for flood in floods):
            listen(sea, lines, LISTEN_INTERVAL_S)
        bytes_taken += [json.loads(flood.communicate()[0]) for flood in floods]
    finally:
        for flood in floods:
            flood.kill()
            flood.wait()
            flood.stdout.close()


def measure_bare_lateness(rate_hz):
    """Measure the lateness of a process that computes for half of each period, while a flood goes to an unread socket.

    It is the reference: a shared machine interrupts any busy process for milliseconds.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unread_socket:
        unread_socket.bind(("127.0.0.1", 0))
        words = [sys.executable, str(FLOOD), "udp", str(unread_socket.getsockname()[1]), str(FLOOD_TIME_S)]
        with subprocess.Popen(words, stdout=subprocess.DEVNULL):
            words = bare_sleep.command(rate_hz, round(FLOOD_TIME_S * rate_hz), 0.5)
            process = subprocess.run(words, capture_output=True, check=True, timeout=FLOOD_TIME_S + 30.0)
            return spread(json.loads(process.stdout))


def boat_time_s(sea):
    """Return the time since start-up from the telemetry of the autopilot."""
    times_s = []

    def matches(message):
        if message.get_type() == "SYSTEM_TIME":
            times_s.append(message.time_boot_ms / 1e3)
        return bool(times_s)

    assert sea.station.await_message(10.0, matches) is not None
    return times_s[-1]
