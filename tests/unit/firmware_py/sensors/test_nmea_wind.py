"""Wind sensor driver: sentences of instruments, preference, invalid winds, health."""

import math

import pytest

from firmware_py.common.records import DeviceRole, DeviceState, WindReference
from firmware_py.sensors.nmea_wind import NmeaWind, NmeaWindOptions

KNOT = 1852.0 / 3600.0


@pytest.fixture
def sensor(line):
    return NmeaWind(line, NmeaWindOptions())


def options(**values):
    return NmeaWindOptions(**values)


@pytest.mark.parametrize(
    ("data", "wind_m_s", "angle_deg", "reference"),
    [
        # Recorded sentences, with their checksums.
        (b"$WIMWV,251.4,R,3.1,N,A*23\r\n", 3.1 * KNOT, 251.4, WindReference.APPARENT),
        (b"$WIMWV,220.0,T,5.0,N,A*20\r\n", 5.0 * KNOT, 220.0, WindReference.BOW),
        (b"$WIMWD,211.2,T,205.4,M,3.9,N,2.0,M*51\r\n", 3.9 * KNOT, 211.2, WindReference.NORTH),
        (b"$IIVWR,148,L,02.4,N,01.2,M,04.4,K*71\r\n", 2.4 * KNOT, 212.0, WindReference.APPARENT),
        (b"$IIVWR,117,L,17.1,N,,,,*7F\r\n", 17.1 * KNOT, 243.0, WindReference.APPARENT),
        # Made from the formats of the manual.
        ("WIMWV,250.5,R,1.8,M,A", 1.8, 250.5, WindReference.APPARENT),
        ("WIVWR,10.0,R,,,5.0,M,,", 5.0, 10.0, WindReference.APPARENT),
        ("WIVWT,130.2,L,22.1,N,11.4,M,40.9,K", 22.1 * KNOT, 229.8, WindReference.BOW_WATER),
        ("WIMWD,,T,240.0,M,10.0,N,5.1,M", 10.0 * KNOT, 240.0, WindReference.MAGNETIC),
        ("WIMWV,360.0,R,36.0,K,A", 10.0, 0.0, WindReference.APPARENT),
        ("WIMWV,0,R,0,N,A", 0.0, 0.0, WindReference.APPARENT),
        ("WIMWV,10.0,R,120.0,M,A", 120.0, 10.0, WindReference.APPARENT),
    ],
)
def test_sample_of_a_sentence(deliver, sensor, data, wind_m_s, angle_deg, reference):
    (sample,) = deliver(sensor, data, now_s=2.5)
    assert sample.t_s == 2.5
    assert sample.wind_m_s == pytest.approx(wind_m_s)
    assert math.degrees(sample.angle_rad) == pytest.approx(angle_deg)
    assert sample.reference is reference


@pytest.mark.parametrize(
    "body",
    [
        "WIMWV,251.4,R,3.1,N,V",
        "WIMWV,251.4,R,3.1,N,",
        "WIMWV,,R,3.1,N,A",
        "WIMWV,251.4,R,,N,A",
        "WIMWV,251.4,X,3.1,N,A",
        "WIMWV,251.4,,3.1,N,A",
        "WIMWD,,T,,M,10.0,N,5.1,M",
        "WIMWD,90.0,T,90.0,M,,N,,M",
        "IIVWR,066,R,,N,,M,,K",
        "WIVWR,,,3.0,N,,M,,K",
    ],
)
def test_sentence_without_a_wind_gives_no_sample_but_is_accepted(deliver, sensor, body):
    assert not deliver(sensor, body)
    health = sensor.health(1.0)
    assert (health.role, health.state) == (DeviceRole.WIND, DeviceState.RUNNING)
    assert (health.accepted, health.rejected) == (1, 0)
    assert health.text == f"{body[:5]}: no wind"


@pytest.mark.parametrize(
    "body",
    [
        "WIMWV,361.0,R,3.1,N,A",
        "WIMWV,10.0,R,120.1,M,A",
        "WIMWV,10.0,R,-1.0,M,A",
        "WIMWV,10.0,R,1e1,M,A",
        "WIMWV,10.0,R,3.1,X,A",
        "WIVWR,181.0,R,3.1,N,,,,",
        "WIVWR,18.0,X,3.1,N,,,,",
        "WIMWV,10.0,R,3.1",
    ],
)
def test_invalid_sentence_is_rejected(deliver, sensor, body):
    assert not deliver(sensor, body)
    health = sensor.health(1.0)
    assert (health.accepted, health.rejected) == (0, 1)


APPARENT, BOW, NORTH, MAGNETIC = (
    "WIMWV,10.0,R,5.0,M,A", "WIMWV,20.0,T,5.0,M,A", "WIMWD,30.0,T,,M,,N,5.0,M", "WIMWD,,T,40.0,M,,N,5.0,M",
)  # fmt: skip


def references(samples):
    return [sample.reference for sample in samples]


def test_apparent_wind_is_preferred_then_that_from_north(deliver, sensor):
    # The first burst is used as a whole, because nothing better has arrived yet.
    assert references(deliver(sensor, MAGNETIC, BOW, NORTH, APPARENT, now_s=1.0)) == [
        WindReference.MAGNETIC,
        WindReference.BOW,
        WindReference.NORTH,
        WindReference.APPARENT,
    ]
    assert references(deliver(sensor, APPARENT, NORTH, BOW, MAGNETIC, now_s=2.0)) == [WindReference.APPARENT]
    assert references(deliver(sensor, NORTH, BOW, MAGNETIC, now_s=7.0)) == []
    assert references(deliver(sensor, NORTH, BOW, MAGNETIC, now_s=7.1)) == [WindReference.NORTH]
    assert references(deliver(sensor, BOW, MAGNETIC, now_s=12.2)) == [WindReference.BOW]
    assert references(deliver(sensor, MAGNETIC, now_s=17.3)) == [WindReference.MAGNETIC]
    over_water = "WIVWT,50.0,R,,,5.0,M,,"
    used = references(deliver(sensor, over_water, MAGNETIC, BOW, now_s=30.0))
    assert used == [WindReference.BOW_WATER, WindReference.BOW]


def test_invalid_apparent_wind_does_not_suppress_a_valid_true_one(deliver, sensor):
    assert not deliver(sensor, "WIMWV,10.0,R,5.0,M,V", now_s=1.0)
    assert references(deliver(sensor, BOW, now_s=1.1)) == [WindReference.BOW]


def test_selected_sentences_are_used_only(deliver, line):
    sensor = NmeaWind(line, options(sentences=("MWD",)))
    assert references(deliver(sensor, APPARENT, NORTH)) == [WindReference.NORTH]


def test_mounting_angle_is_added_to_angles_from_the_bow_only(deliver, line):
    sensor = NmeaWind(line, options(offset_deg=-20.0))
    (apparent,) = deliver(sensor, APPARENT, now_s=1.0)
    assert math.degrees(apparent.angle_rad) == pytest.approx(350.0)
    (north,) = deliver(sensor, NORTH, now_s=6.1)
    assert math.degrees(north.angle_rad) == pytest.approx(30.0)
    (bow,) = deliver(sensor, BOW, now_s=11.2)
    assert math.degrees(bow.angle_rad) == pytest.approx(0.0, abs=1e-9)


def test_options_are_checked():
    assert options(offset_deg=180.0).offset_deg == 180.0
    for values in ({"offset_deg": -180.1}, {"offset_deg": 180.1}, {"sentences": ("MDA",)}):
        with pytest.raises(ValueError, match=next(iter(values))):
            options(**values)


def test_checksum_is_required_by_default(deliver, line, sensor):
    data = b"$WIMWV,251.4,R,3.1,N,A\r\n"
    assert not deliver(sensor, data)
    assert len(deliver(NmeaWind(line, options(require_checksum=False)), data)) == 1


def test_sensor_is_silent_after_five_seconds_and_recovers(deliver, sensor, line):
    for second in range(1, 21):
        deliver(sensor, APPARENT, now_s=float(second))
    assert sensor.health(25.0).state is DeviceState.RUNNING
    assert sensor.health(25.1).state is DeviceState.SILENT
    deliver(sensor, APPARENT, now_s=40.0)
    assert sensor.health(40.0).state is DeviceState.RUNNING
    line.unplug()
    assert sensor.health(41.0).state is DeviceState.ABSENT
    assert sensor.fileno() == -1


def test_incomplete_sentence_before_a_reopening_is_discarded(deliver, sensor, line):
    assert not deliver(sensor, b"$WIMWV,251.4,R,3", now_s=1.0)
    line.plug()
    assert not deliver(sensor, b".1,N,A*23\r\n", now_s=2.0)


def test_remark_ends_with_a_wind(deliver, sensor):
    deliver(sensor, "WIMWV,251.4,R,3.1,N,V")
    assert sensor.health(1.0).text == "WIMWV: no wind"
    deliver(sensor, APPARENT)
    assert sensor.health(1.0).text == ""


def test_preference_is_reset_when_the_port_is_reopened(deliver, sensor, line):
    assert references(deliver(sensor, APPARENT, now_s=1.0)) == [WindReference.APPARENT]
    line.plug()
    assert references(deliver(sensor, MAGNETIC, now_s=2.0)) == [WindReference.MAGNETIC]
