"""One sample for each epoch, whatever order a receiver speaks in."""

import datetime as dt
import itertools
import math

import pytest

from firmware_py.common.records import DeviceRole, DeviceState, FixType
from firmware_py.sensors.nmea_position import EPOCH_TIMEOUT_S, NmeaPosition, NmeaPositionOptions

NORTH_SEA = "5327.03942,N,00214.42462,W"


def rmc(time="103607.00", status="A", where=NORTH_SEA, date="060321", mode="A", speed="2.0", course="90.0"):
    return f"GNRMC,{time},{status},{where},{speed},{course},{date},,,{mode}"


def gga(time="103607.00", quality="1", where=NORTH_SEA):
    return f"GNGGA,{time},{where},{quality},06,5.88,56.0,M,48.5,M,,"


def gll(time="103607.00", status="A", where=NORTH_SEA):
    return f"GNGLL,{where},{time},{status},A"


VTG = "GNVTG,90.0,T,,M,2.0,N,3.7,K,A"
NOTHING = ",,,"


@pytest.fixture
def receiver(line):
    return NmeaPosition(line, NmeaPositionOptions())


@pytest.fixture
def hear(line, nmea):
    def give(receiver, *bodies, now_s=1.0):
        for body in bodies:
            line.inbox += nmea(body)
        receiver.receive(now_s)
        return receiver.poll()

    return give


@pytest.fixture
def one_epoch(line, hear):
    """The single sample of one burst of sentences."""

    def give(*bodies):
        receiver = NmeaPosition(line, NmeaPositionOptions())
        assert hear(receiver, *bodies) == ()
        (sample,) = hear(receiver, now_s=1.1 + EPOCH_TIMEOUT_S)
        return sample

    return give


def utc(*when):
    return dt.datetime(*when, tzinfo=dt.UTC).timestamp()


def test_an_epoch_is_merged(one_epoch, near):
    sample = one_epoch(rmc(speed="", course=""), VTG, gga(), gll())
    assert near(sample.latitude_rad, 53 + 27.03942 / 60)
    assert near(sample.longitude_rad, -(2 + 14.42462 / 60))
    assert near(sample.course_over_ground_rad, 90.0)
    assert sample.speed_over_ground_m_s == pytest.approx(2 * 1852 / 3600)
    assert (sample.t_s, sample.fix, sample.satellites, sample.hdop, sample.altitude_m) == (1.0, 3, 6, 5.88, 56.0)
    assert sample.utc_s == utc(2021, 3, 6, 10, 36, 7)


@pytest.mark.parametrize(
    "burst",
    [lambda t: (rmc(t), VTG, gga(t), gll(t)), lambda t: (gga(t), gll(t), rmc(t), VTG), lambda t: (VTG, gga(t), rmc(t)),
     lambda t: (gga(t),), lambda t: (gll(t),), lambda t: (rmc(t),)],
)  # fmt: skip
def test_each_epoch_is_given_once_and_at_its_last_sentence(hear, burst, receiver):
    hear(receiver, *burst("103600.00"), now_s=0.0)
    for second in range(1, 9):
        samples = hear(receiver, *burst(f"10360{second}.00"), now_s=float(second))
        expected = [0.0, 1.0] if second == 1 else [float(second)]  # the first is known to be whole when the next begins
        assert [sample.t_s for sample in samples] == expected
    assert hear(receiver, now_s=99.0) == ()


def test_a_lost_sentence_holds_an_epoch_back_for_half_a_second_only(hear, receiver):
    for second in range(2):
        hear(receiver, rmc(f"10360{second}.00"), gga(f"10360{second}.00"), now_s=float(second))
    assert hear(receiver, rmc("103602.00"), now_s=2.0) == ()
    assert hear(receiver, now_s=2.4) == ()
    assert [sample.t_s for sample in hear(receiver, now_s=2.6)] == [2.0]
    assert [sample.t_s for sample in hear(receiver, rmc("103603.00"), gga("103603.00"), now_s=3.0)] == [3.0]


def test_ten_fixes_a_second_with_one_rmc_among_them(hear, receiver):
    count = 0
    for tenth in range(100):
        time = f"1036{tenth // 10:02d}.{tenth % 10}0"
        count += len(hear(receiver, *([rmc(time)] if tenth % 10 == 0 else []), gga(time), now_s=tenth / 10))
    assert count in {99, 100}


@pytest.mark.parametrize(
    ("sentences", "fix"),
    [
        ((rmc(),), FixType.FIX_2D),  # no altitude, no third dimension
        ((gga(),), FixType.FIX_3D),
        ((gga(quality="2"), rmc()), FixType.DGPS),
        ((gga(quality="4"),), FixType.RTK_FIXED),
        ((gga(quality="5"),), FixType.RTK_FLOAT),
        ((rmc(mode="D"),), FixType.DGPS),
        ((rmc(mode=""),), FixType.FIX_2D),
        ((f"GNGNS,103607.00,{NORTH_SEA},AANN,06,5.88,56.0,48.5,,,V",), FixType.FIX_3D),
        ((f"GNGNS,103607.00,{NORTH_SEA},RANN,06,5.88,56.0,48.5,,,V",), FixType.RTK_FIXED),
        ((f"GNGNS,103607.00,{NORTH_SEA},NNNN,06,5.88,56.0,48.5,,,V",), FixType.NONE),
        ((gga(quality="0"),), FixType.NONE),
        ((gga(quality=""),), FixType.NONE),
        ((gga(quality="6"),), FixType.NONE),  # dead reckoning
        ((gga(quality="7"),), FixType.NONE),  # typed in
        ((gga(quality="8"),), FixType.NONE),  # a simulator
        ((rmc(mode="E"),), FixType.NONE),
        ((rmc(status="V"),), FixType.NONE),
        ((rmc(status=""),), FixType.NONE),
        ((gll(status="V"),), FixType.NONE),
        ((gga(), rmc(status="V")), FixType.NONE),  # one denial is enough
        ((rmc(where=NOTHING),), FixType.NONE),
        ((rmc(where="5327.03942,N,,"),), FixType.NONE),
    ],
)
def test_the_fix(one_epoch, sentences, fix):
    sample = one_epoch(*sentences)
    assert sample.fix is fix
    assert (sample.latitude_rad is None) == (sample.utc_s is None and fix is FixType.NONE) == (fix is FixType.NONE)


def test_a_receiver_without_fix_is_running_and_says_so(hear, receiver):
    silent = ("GNRMC,,V,,,,,,,,,,N,V", "GNVTG,,,,,,,,,N", "GNGGA,,,,,,0,00,99.99,,,,,,", "GNGLL,,,,,,V,N")
    samples = [sample for second in range(3) for sample in hear(receiver, *silent, now_s=float(second))]
    assert [sample.fix for sample in samples] == [FixType.NONE] * 3
    health = receiver.health(2.0)
    assert (health.role, health.state, health.text) == (DeviceRole.POSITION, DeviceState.RUNNING, "no fix")
    assert receiver.health(5.0).state is DeviceState.SILENT


def test_a_receiver_that_says_one_time_again_and_again_has_no_fix(hear, receiver):
    """A hanging receiver, or a router that repeats its last sentences: the boat would pass every waypoint."""
    fixes = [sample.fix for second in range(60) for sample in hear(receiver, rmc(), gga(), now_s=float(second))]
    assert fixes[:3] == [FixType.FIX_3D] * 3
    assert set(fixes[4:]) == {FixType.NONE}
    assert receiver.health(60.0).text == "time not advancing: no fix"
    later = [rmc(time=f"10370{second}.00") for second in range(3)]
    again = [sample.fix for second, body in enumerate(later) for sample in hear(receiver, body, now_s=60.0 + second)]
    assert again[-1] is FixType.FIX_2D
    assert receiver.health(63.0).text == ""


def test_whole_seconds_of_a_quick_receiver_are_no_time_that_stands_still(hear, receiver):
    sentences = [(tenths / 10, rmc(time=f"1036{tenths // 10:02d}")) for tenths in range(300)]
    fixes = [sample.fix for now_s, body in sentences for sample in hear(receiver, body, now_s=now_s)]
    assert len(fixes) > 290
    assert FixType.NONE not in fixes


def test_utc_is_carried_on_from_the_last_date(hear, receiver):
    found = list(hear(receiver, "GPZDA,235959.00,31,12,2024,00,00", gga("235959.50"), now_s=0.5))
    found += hear(receiver, gga("000000.00"), now_s=1.0)
    found += hear(receiver, gga("000000.50"), now_s=1.5)
    assert [sample.utc_s for sample in found] == [
        utc(2024, 12, 31, 23, 59, 59) + 0.5, utc(2025, 1, 1), utc(2025, 1, 1) + 0.5
    ]  # fmt: skip


def test_without_any_date_there_is_no_utc_and_a_bad_date_is_refused(hear, receiver):
    hear(receiver, gga(), rmc(date="310221"), "GPZDA,103607.00,31,02,2021,00,00")
    (sample,) = hear(receiver, now_s=9.0)
    assert (sample.fix, sample.utc_s) == (FixType.FIX_3D, None)
    assert receiver.health(1.0).rejected == 1  # ZDA, which has nothing but the date


def test_a_missing_checksum_is_refused_unless_the_file_says_otherwise(line, hear):
    lenient = NmeaPosition(line, NmeaPositionOptions(require_checksum=False))
    line.inbox += f"${gga()}\r\n".encode()
    lenient.receive(1.0)
    assert lenient.health(1.0).accepted == 1
    strict = NmeaPosition(line, NmeaPositionOptions())
    line.inbox += f"${gga()}\r\n".encode()
    strict.receive(1.0)
    assert (strict.health(1.0).accepted, strict.health(1.0).rejected) == (0, 1)


def test_a_reopened_port_begins_again(line, hear, receiver):
    hear(receiver, rmc())
    line.unplug()
    assert receiver.health(1.0).state is DeviceState.ABSENT
    line.plug()
    assert hear(receiver, gga("103608.00"), now_s=2.0) == ()
    (sample,) = hear(receiver, now_s=3.0)
    assert (sample.utc_s, sample.t_s) == (None, 2.0)


def test_a_recorded_voyage(line, recordings, receiver):
    data = (recordings / "nmea" / "avnav_20160815_excerpt.nmea").read_bytes()
    samples = []
    for step, start in enumerate(range(0, len(data), 1000)):
        line.inbox += data[start : start + 1000]
        receiver.receive(step * 0.8)
        samples += receiver.poll()
    receiver.receive(1e4)
    samples += receiver.poll()
    # 207 RMC; the first and last epoch of the excerpt may be cut.
    assert 206 <= len(samples) <= 208
    whole = [sample for sample in samples if sample.speed_over_ground_m_s is not None]
    assert len(whole) >= 206
    assert all(sample.fix is FixType.FIX_3D and sample.utc_s is not None for sample in whole)
    steps_s = [second.utc_s - first.utc_s for first, second in itertools.pairwise(whole)]
    assert all(step_s > 0 for step_s in steps_s)
    assert whole[0].latitude_rad == pytest.approx(math.radians(52.494), abs=1e-4)


INVALID_DATES = ("2208-1", "320126", "000126", "310221", "", "000000", "220826E")
INVALID_POSITIONS = ("0000.0000,N,00000.0000,E", "0000.0000,S,00000.0000,W", "9000.0000,N,00000.0000,E")
POSITIONS_ON_AN_AXIS = ("0000.0000,N,02100.0000,E", "5100.0000,N,00000.0000,E", "0000.0100,N,00000.0000,E")


@pytest.mark.parametrize(
    ("body", "fix", "has_utc", "text"),
    [
        *((rmc(date=date), FixType.FIX_2D, False, "") for date in INVALID_DATES),
        *((rmc(where=where), FixType.NONE, False, "position invalid: no fix") for where in INVALID_POSITIONS),
        *((rmc(where=where), FixType.FIX_2D, True, "") for where in POSITIONS_ON_AN_AXIS),
    ],
)
def test_an_invalid_date_removes_the_time_and_an_invalid_position_the_fix(hear, receiver, body, fix, has_utc, text):
    hear(receiver, body)
    (sample,) = hear(receiver, now_s=9.0)
    assert (sample.fix, sample.latitude_rad is None) == (fix, fix is FixType.NONE)
    assert (sample.utc_s is not None) == has_utc
    assert (receiver.health(9.0).rejected, receiver.health(9.0).text) == (0, text)
