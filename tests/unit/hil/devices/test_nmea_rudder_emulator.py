"""Emulated rudder angle sensor."""

import math

import numpy as np
import pytest

from hil.devices.nmea_rudder import NmeaRudderEmulator


@pytest.fixture
def make():
    return lambda **options: NmeaRudderEmulator(lambda: math.radians(-12.3), np.random.default_rng(1), **options)


def test_sentences_at_the_rate(make, run):
    outputs = run(make(noise_deg=0.0), 1.0)
    assert [data for _, data in outputs] == [b"$IIRSA,-12.3,A,,*32\r\n"] * len(outputs)
    assert len(outputs) == 10
    assert outputs[0][0] == pytest.approx(21 * 10 / 4800)


def test_reading_has_offset_and_scale(make, run):
    ((_, data), *_) = run(make(noise_deg=0.0, offset_deg=5.0, scale=-0.5), 0.1)
    assert data.startswith(b"$IIRSA,29.6,A,,*")


def test_noise_and_status(make, run):
    sensor = make(noise_deg=0.5)
    readings = [float(data[7:].split(b",")[0]) for _, data in run(sensor, 100.0)]
    assert np.std(readings) == pytest.approx(0.5, rel=0.1)
    sensor.is_valid = False
    assert b"$IIRSA,,V,,*" in run(sensor, 101.0)[-1][1]


@pytest.mark.parametrize("options", [{"rate_hz": 0.0}, {"rate_hz": math.nan}, {"scale": 0.0}])
def test_invalid_options_are_refused(make, options):
    with pytest.raises(ValueError, match="out of range"):
        make(**options)
