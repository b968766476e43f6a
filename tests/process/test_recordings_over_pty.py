"""Recordings sent through a serial port give exactly the headings and positions of the expected JSON."""

import json
import math
import os
import tty

import pytest

from firmware_py.common.records import DeviceState, NorthReference
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
from firmware_py.sensors.nmea_position import NmeaPosition, NmeaPositionOptions
from firmware_py.system.serial_port import SerialPort
from support.paths import DATA

RECORDINGS = sorted(path.name for path in (DATA / "nmea").glob("*.*")) or ["tests/data/nmea is not here"]
PIECE_BYTES = 997  # a prime number, so that the pieces end anywhere in a sentence
MAX_READS = 100_000


@pytest.fixture
def pty():
    """The device end of a pseudo-terminal, and the path of the port."""
    device, port = os.openpty()
    tty.setraw(port)
    yield device, os.ttyname(port)
    os.close(device)
    os.close(port)


@pytest.fixture
def recording():
    """Return a function that reads a recording and its expected values, or skips the test."""

    def read(name):
        if not DATA.is_dir():
            pytest.skip("the recordings of tests/data are not here")
        expected = json.loads((DATA / "nmea" / "expected" / f"{name}.json").read_text())
        return (DATA / "nmea" / name).read_bytes(), expected["values"]

    return read


class CountingLine:
    """A serial port that counts the bytes read, so that the test need not sleep."""

    def __init__(self, path):
        self._line = SerialPort(path, 115200)
        self._line.open()
        self.count = 0

    def __getattr__(self, name):
        return getattr(self._line, name)

    def read(self):
        data = self._line.read()
        self.count += len(data)
        return data


@pytest.fixture
def play(pty):
    """Return a function that sends bytes to a driver; it returns the driver, the samples and the time."""
    device, path = pty
    lines = []

    def run(data, make):
        line = CountingLine(path)
        lines.append(line)
        driver = make(line)
        samples, now_s = [], 0.0
        for start in range(0, len(data), PIECE_BYTES):
            piece = data[start : start + PIECE_BYTES]
            os.write(device, piece)
            now_s += 0.1
            expected_count = start + len(piece)
            for _ in range(MAX_READS):
                driver.receive(now_s)
                samples += driver.poll()
                if line.count == expected_count:
                    break
            assert line.count == expected_count
        return driver, samples, now_s

    yield run
    for line in lines:
        line.close()


def expected_headings(rows):
    """Return degrees and reference of each heading, without VHW, which repeats the heading for a speed log."""
    headings = []
    for _, sentence, _, *values in rows:
        if sentence.endswith("VHW") or not values:
            continue
        true_deg, magnetic_deg = values[0].get("heading_true_deg"), values[0].get("heading_mag_deg")
        if true_deg is not None:
            headings.append((true_deg, NorthReference.TRUE))
        elif magnetic_deg is not None:
            headings.append((magnetic_deg, NorthReference.MAGNETIC))
    return headings


@pytest.mark.parametrize("name", RECORDINGS)
def test_compass_gives_exactly_the_headings_of_a_recording(play, recording, name):
    data, rows = recording(name)
    compass, samples, now_s = play(data, lambda line: NmeaCompass(line, NmeaCompassOptions()))
    expected = expected_headings(rows)
    assert [sample.reference for sample in samples] == [reference for _, reference in expected]
    headings_deg = [math.degrees(sample.heading_rad) for sample in samples]
    assert headings_deg == pytest.approx([heading_deg % 360.0 for heading_deg, _ in expected], abs=1e-6)
    variations = [row[3]["variation_deg"] for row in rows if len(row) > 3 and row[3].get("variation_deg") is not None]
    variations_deg = [math.degrees(sample.variation_rad) for sample in samples if sample.variation_rad is not None]
    assert variations_deg == pytest.approx(variations)
    health = compass.health(now_s)
    assert health.accepted == len(expected)
    assert health.rejected == sum(row[2] == 0 for row in rows)
    assert health.state is (DeviceState.RUNNING if expected else DeviceState.STARTING)


@pytest.mark.parametrize("name", [name for name in RECORDINGS if name.startswith("pynmeagps")] or RECORDINGS)
def test_valid_heading_after_garbage_is_read(play, recording, name):
    data, _ = recording(name)
    _, samples, _ = play(data + b"$HEHDT,341.8,T*21\r\n", lambda line: NmeaCompass(line, NmeaCompassOptions()))
    assert math.degrees(samples[-1].heading_rad) == pytest.approx(341.8)


@pytest.mark.parametrize("name", RECORDINGS)
def test_position_driver_gives_only_positions_of_a_recording(play, recording, name):
    data, rows = recording(name)
    _, samples, _ = play(data, lambda line: NmeaPosition(line, NmeaPositionOptions()))
    allowed = {
        (round(values["lat"], 6), round(values["lon"], 6))
        for _, _, checksum, values in (row for row in rows if len(row) > 3)
        if values.get("lat") is not None
    }
    positions = {
        (round(math.degrees(sample.latitude_rad), 6), round(math.degrees(sample.longitude_rad), 6))
        for sample in samples
        if sample.latitude_rad is not None
    }
    assert positions <= allowed
    epochs = max([sum(row[1].endswith(kind) for row in rows) for kind in ("RMC", "GGA", "GNS", "GLL")])
    if epochs > 10:
        assert len(samples) >= epochs - 2
