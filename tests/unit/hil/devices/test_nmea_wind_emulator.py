import math

import numpy as np
import pytest
from pynmeagps import NMEAReader

from hil.devices.nmea_wind import NmeaWindEmulator


class Weather:
    """Heading east at 1 m/s; wind of 8 m/s from the south."""

    def __init__(self, turbulence=0.0):
        self.turbulence = turbulence
        self.bow, self.velocity, self.air = math.pi / 2, (0.0, 1.0), (8.0, 0.0)
        self.bow_rad, self.velocity_m_s = lambda: self.bow, lambda: self.velocity
        self.air_velocity_m_s = lambda: self.air


def make(weather=None, **options):
    return NmeaWindEmulator(weather or Weather(), np.random.default_rng(1), **options)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        # The apparent wind is 8.06 m/s (15.7 kn) from 7.1 deg ahead of the starboard beam.
        ({}, b"$WIMWV,82.9,R,15.7,N,A*"),
        ({"offset_deg": 10.0}, b"$WIMWV,72.9,R,15.7,N,A*"),
        ({"sentence": "VWR"}, b"$WIVWR,82.9,R,15.7,N,8.1,M,29.0,K*"),
        ({"sentence": "VWT"}, b"$WIVWT,90.0,R,15.6,N,8.0,M,28.8,K*"),
        ({"sentence": "MWD"}, b"$WIMWD,180.0,T,,M,15.6,N,8.0,M*"),
    ],
)
def test_sentence_of_a_steady_wind(run, options, sentence):
    assert run(make(**options), 0.9)[0][1].startswith(sentence)


def test_wind_from_port_is_on_the_left(run):
    weather = Weather()
    weather.bow = -math.pi / 2
    assert b"VWT,90.0,L," in run(make(weather, sentence="VWT"), 0.9)[0][1]


def test_one_valid_sentence_per_second(run):
    output = run(make(phase_s=0.2), 10.0)
    assert len(output) == 10
    assert all(NMEAReader.parse(data, validate=1).msgID == "MWV" for _, data in output)


def test_turbulence_is_a_share_of_the_speed(run):
    output = run(make(Weather(turbulence=0.1), sentence="MWD"), 3000.0)
    speeds = [float(data.split(b",")[7]) for _, data in output]
    assert np.mean(speeds) == pytest.approx(8.0, abs=0.2)
    assert np.std(speeds) == pytest.approx(0.8, rel=0.2)
    assert np.corrcoef(speeds[:-1], speeds[1:])[0, 1] == pytest.approx(math.exp(-1.0 / 8.0), abs=0.05)


def test_unknown_sentence_is_refused():
    with pytest.raises(ValueError, match="MWX is not supported"):
        make(sentence="MWX")
