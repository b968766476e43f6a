"""Common part of the drivers: samples between two polls."""

import pytest

from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
from firmware_py.sensors.nmea_depth import NmeaDepth, NmeaDepthOptions
from firmware_py.sensors.nmea_rudder import NmeaRudder, NmeaRudderOptions
from firmware_py.sensors.nmea_wind import NmeaWind, NmeaWindOptions


@pytest.mark.parametrize(
    ("driver", "options", "sentence"),
    [
        (NmeaCompass, NmeaCompassOptions(), "HEHDT,1,T"),
        (NmeaDepth, NmeaDepthOptions(), "SDDPT,8.0,0.5"),
        (NmeaRudder, NmeaRudderOptions(), "IIRSA,1.0,A"),
        (NmeaWind, NmeaWindOptions(), "WIMWV,10.0,R,5.0,M,A"),
    ],
)
def test_at_most_512_samples_wait_for_a_poll(line, nmea, driver, options, sentence):
    device = driver(line, options)
    for second in range(20):
        line.inbox += nmea(sentence) * 30
        device.receive(float(second))
    assert device.fileno() == line.fileno()
    assert (len(device.poll()), len(device.poll())) == (512, 0)
