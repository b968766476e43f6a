import numpy as np
import pytest
from pynmeagps import NMEAReader

from hil.devices import nmea_depth
from hil.devices.nmea_depth import NmeaDepthEmulator


class Bottom:
    depth_m = 20.0

    def water_depth_m(self):
        return self.depth_m


@pytest.fixture
def make(monkeypatch):
    """Function that makes a sounder without noise at a depth of 20 m."""
    monkeypatch.setattr(nmea_depth, "NOISE_M", 0.0)

    def make_sounder(depth_m=20.0, **options):
        bottom = Bottom()
        bottom.depth_m = depth_m
        return NmeaDepthEmulator(bottom, np.random.default_rng(1), transducer_m=0.5, keel_m=2.0, **options)

    return make_sounder


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({}, b"$SDDPT,19.5,0.5*"),
        ({"sentence": "DBT"}, b"$SDDBT,64.0,f,19.5,M,10.7,F*"),
        ({"sentence": "DBS"}, b"$SDDBS,65.6,f,20.0,M,10.9,F*"),
        ({"sentence": "DBK"}, b"$SDDBK,59.1,f,18.0,M,9.8,F*"),
        ({"depth_m": 200.5}, b"$SDDPT,200.0,0.5*"),
        ({"depth_m": 200.6}, b"$SDDPT,,0.5*"),
        ({"depth_m": 0.5}, b"$SDDPT,,0.5*"),
        ({"depth_m": 300.0, "sentence": "DBT"}, b"$SDDBT,,f,,M,,F*"),
    ],
)
def test_sentence_of_a_depth(make, run, options, sentence):
    assert run(make(**options), 0.9)[0][1].startswith(sentence)


def test_one_valid_sentence_per_second(make, run):
    output = run(make(phase_s=0.2), 10.0)
    assert len(output) == 10
    assert all(NMEAReader.parse(data, validate=1).msgID == "DPT" for _, data in output)


def test_noise_is_five_centimetres(run):
    sounder = NmeaDepthEmulator(Bottom(), np.random.default_rng(1), sentence="DBS")
    depths = [float(data.split(b",")[3]) for _, data in run(sounder, 1000.0)]
    assert np.std(depths) == pytest.approx(0.058, abs=0.01)  # with the resolution of 0.1 m


def test_unknown_sentence_is_refused(make):
    with pytest.raises(ValueError, match="DPX is not supported"):
        make(sentence="DPX")
