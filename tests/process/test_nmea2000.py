"""An NMEA 2000 bus behind an Actisense gateway, with the real program: cable, power, baud rate, two heading sources."""

import itertools
import math
import os
import re
import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from firmware_py.__main__ import main
from firmware_py.log.reader import read_log
from hil.devices import nmea2000_frames as n2k
from hil.devices.nmea2000 import COMPASS, SECOND_COMPASS
from hil.devices.sensor_errors import AttitudeWithError
from support.paths import DATA

VESSEL_HEADING = 127250  # PGN
SETTINGS = {"BOOT_ARM": 1, "BOOT_MODE": 15, "CTL_HOLD_S": 1, "EST_MODE": 0, "CTL_MODE": 0}


def add_section(boat, section, **keys):
    """Add a section with the port of the compass to the vehicle file, or keys to a section that it has."""
    text = boat._vehicle.read_text()
    values = "".join(f"{key} = {value!r}\n" for key, value in keys.items())
    if f"[{section}]" in text:
        text = text.replace(f"[{section}]\n", f"[{section}]\n{values}")
    else:
        port = f'driver = "nmea2000"\nport = "{boat.board.paths()["compass"]}"\nbaud = 38400\n'
        text = text.replace("[parameters]", f"[{section}]\n{port}{values}[parameters]")
    boat._vehicle.write_text(text.replace("'", '"'))


def inputs_of(boat):
    return [tick.inputs for path in boat.finish() for tick in read_log(path)]


@pytest.fixture
def moored_boat(make_boat):
    """A boat in real time without a ground station; its goal is its heading."""
    boat = make_boat(scenario="calm", compass="nmea2000", speed=None, settings=SETTINGS, without=("position", "link"))
    yield boat
    assert boat.compass_device.bus_commands == 0
    logs = boat.logs()
    assert logs
    assert all(main(["replay", str(log)]) == 0 for log in logs)


def responds_to_heading(boat):
    """Return whether the rudder moves after a turn of the boat."""
    boat.world._hull._plant.heading_rad += math.radians(30.0)
    initial_rad = boat.world.shaft.angle_rad()
    boat.run(1.5)
    return abs(boat.world.shaft.angle_rad() - initial_rad) > math.radians(5.0)


def test_heading_recovers_after_faults_of_cable_power_and_baud_rate(moored_boat):
    boat = moored_boat.start()
    boat.run_until_written("Mode GUIDED")
    boat.run(1.5)
    boat.lines["compass"].unplug()
    boat.run_until_written("No valid heading: rudder held, then centred")
    boat.lines["compass"].plug()
    boat.run_until_written("Heading recovered")
    boat.compass_device.power_cycle(boat.now_s, off_s=3.0)  # it must be started again
    boat.run_until_written("No valid heading: rudder held, then centred")
    boat.run_until_written("Heading recovered")
    boat.compass.flip = 0.5  # as with a wrong baud rate
    boat.run_until_written("No valid heading: rudder held, then centred")
    boat.compass.flip = 0.0
    boat.run_until_written("Heading recovered")
    assert responds_to_heading(boat)
    boat.finish()


def test_noisy_line_loses_samples_only(moored_boat):
    boat = moored_boat.start()
    boat.run_until_written("Mode GUIDED")
    boat.compass.flip, boat.compass.garbage, boat.compass.drop, boat.compass.duplicate = 0.002, 0.2, 0.001, 0.001
    boat.run(6.0)
    headings_deg = [math.degrees(sample.heading_rad) for inputs in inputs_of(boat) for sample in inputs.headings]
    assert len(headings_deg) > 30
    assert all(heading_deg < 40.0 or heading_deg > 350.0 for heading_deg in headings_deg)


@pytest.mark.parametrize("source", [None, SECOND_COMPASS])
def test_two_heading_sources_are_not_mixed(make_boat, source):
    """The second one is wrong by 60 degrees; it comes later and is used only if it is named."""
    boat = make_boat(scenario="tank", compass="nmea2000", without=("position",))
    other = AttitudeWithError(boat.world)
    other.error_rad = math.radians(60.0)
    boat.compass_device.add_second_compass(other)
    if source is not None:
        add_section(boat, "compass", source=source)
    boat.start()
    boat.run(10.0)
    headings = [sample for inputs in inputs_of(boat) for sample in inputs.headings]
    expected_deg = 0.0 if source is None else 60.0
    assert len(headings) > 80
    for sample in headings:
        assert abs(math.degrees(math.remainder(sample.heading_rad, math.tau)) - expected_deg) < 25.0
    assert {sample.source for sample in headings} == {0}


def test_two_compasses_position_and_ais_share_the_bus(make_boat):
    boat = make_boat(scenario="tank", compass="nmea2000", without=("position",))
    boat.compass_device.add_second_compass(AttitudeWithError(boat.world))
    boat.compass_device.add_receiver(boat.whereabouts)
    add_section(boat, "compass", source=COMPASS)
    add_section(boat, "compass_b", source=SECOND_COMPASS)
    add_section(boat, "position")
    boat.start()
    boat.run(12.0)
    inputs = inputs_of(boat)
    counts = [sum(sample.source == source for row in inputs for sample in row.headings) for source in (0, 1)]
    assert min(counts) > 90
    fixes = [fix for row in inputs for fix in row.positions]
    assert len(fixes) > 8
    assert all(fix.utc_s is not None and fix.speed_over_ground_m_s is not None for fix in fixes[2:])
    latitude_deg = math.degrees(fixes[-1].latitude_rad)
    assert latitude_deg == pytest.approx(boat.whereabouts.latitude_deg(), abs=1e-3)
    assert boat.compass_device.bus_commands == 0


class Bus:
    """A gateway that sends lines of Yacht Devices RAW by UDP: headings of the boat, and recorded traffic."""

    def __init__(self, boat, frames_per_datagram):
        self._boat, self._count = boat, frames_per_datagram
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.address = probe.getsockname()
        recording = DATA / "nmea2000" / "canboat_merrimac-ydwg-2020_excerpt.raw"
        self._traffic = itertools.cycle(recording.read_bytes().splitlines(keepends=True))
        self.frames_hz, self.sent = 0.0, 0
        self._is_running = True
        self._thread = threading.Thread(target=self._send)
        self._thread.start()

    def _send(self):
        start_s = last_s = time.monotonic()
        due, headings = 0.0, 0
        while self._is_running:
            now_s = time.monotonic()
            if now_s - start_s >= 0.1 * headings:
                headings += 1
                heading = n2k.heading(self._boat.world.heading_rad() % math.tau, n2k.TRUE)
                self._socket.sendto(n2k.raw_line(VESSEL_HEADING, COMPASS, heading), self.address)
            due += self.frames_hz * (now_s - last_s)
            last_s = now_s
            while due >= self._count:
                self._socket.sendto(b"".join(itertools.islice(self._traffic, self._count)), self.address)
                due -= self._count
                self.sent += self._count
            time.sleep(max(0.0, 0.005 - (time.monotonic() - now_s)))

    def close(self):
        self._is_running = False
        self._thread.join()
        self._socket.close()


def read_from_network(boat, bus):
    """Let compass, position and AIS of the vehicle file read the bus."""
    port = f'driver = "nmea2000"\nport = "udp:{bus.address[1]}"\n'
    text = boat._vehicle.read_text().replace("[rudder]", f"[position]\n{port}[ais]\n{port}[rudder]")
    old_section = r'\[compass\]\ndriver = "nmea2000"\nport = "[^"]*"\nbaud = 38400\n'
    boat._vehicle.write_text(re.sub(old_section, f"[compass]\n{port}source = {COMPASS}\n", text))


def test_heading_and_position_are_read_from_a_network_gateway(make_boat):
    boat = make_boat(scenario="calm", compass="nmea2000", speed=None, without=("position", "link"))
    bus = Bus(boat, 5)
    bus.frames_hz = 200.0
    read_from_network(boat, bus)
    try:
        boat.start()
        boat.run_until_written("Heading source: compass A")
        boat.run(5.0)
    finally:
        bus.close()
    inputs = inputs_of(boat)
    headings_deg = [math.degrees(sample.heading_rad) for row in inputs for sample in row.headings]
    assert len(headings_deg) > 20
    assert all(min(angle_deg, 360.0 - angle_deg) < 10.0 for angle_deg in headings_deg)  # the recorded ones are at 85
    assert any(fix.latitude_rad is not None for row in inputs for fix in row.positions)


@pytest.mark.proof
@pytest.mark.timeout(600)
@pytest.mark.parametrize("frames_per_datagram", [1, 10])
def test_full_bus_delays_no_tick(make_boat, frames_per_datagram):
    """Phases of 10 s without and with 1900 frames a second: `pytest -m proof tests/process/test_nmea2000.py -s`.

    Compass, position and AIS share the port.
    """
    boat = make_boat(scenario="tank", compass="nmea2000", speed=None, without=("position",))
    bus = Bus(boat, frames_per_datagram)
    read_from_network(boat, bus)
    phases = {0.0: [], 1900.0: []}
    try:
        boat.start()
        boat.run(5.0)
        for bus.frames_hz in (0.0, 1900.0) * 3:
            boat.run(1.0)
            begin = time.monotonic(), processor_s(boat), boat.now_s, bus.sent
            boat.run(10.0)
            elapsed_s = time.monotonic() - begin[0]
            share = (processor_s(boat) - begin[1]) / elapsed_s
            assert (bus.sent - begin[3]) / elapsed_s == pytest.approx(bus.frames_hz, rel=0.02, abs=1.0)
            phases[bus.frames_hz].append((begin[2], boat.now_s, share))
    finally:
        bus.close()
    inputs = inputs_of(boat)
    begin_s = boat.now_s - inputs[-1].tick.t_s  # about: both clocks run in real time
    shares, lateness_ms = {}, {}
    for frames_hz, spans in phases.items():
        shares[frames_hz] = sum(share for *_, share in spans) / len(spans)
        late_s = [row.tick.late_s for row in inputs for low, high, _ in spans if low < row.tick.t_s + begin_s < high]
        lateness_ms[frames_hz] = [round(1e3 * float(np.quantile(late_s, part)), 2) for part in (0.5, 0.9, 0.99)]
        print(f"{frames_hz:.0f} frames/s: processor {shares[frames_hz]:.3f}, late {lateness_ms[frames_hz]} ms")
    assert sum(len(row.headings) for row in inputs) > 600
    assert shares[1900.0] - shares[0.0] < 0.15
    assert lateness_ms[1900.0][1] < 2.0 * lateness_ms[0.0][1] + 2.0


def processor_s(boat):
    """Return the processor time of the autopilot."""
    fields = Path(f"/proc/{boat.process._process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
