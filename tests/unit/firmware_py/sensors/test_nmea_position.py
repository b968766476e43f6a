"""NMEA position: one sample per epoch, fix type, time, and invalid data."""

import datetime as dt
import itertools
import math

import pytest

from firmware_py.common.records import DeviceRole, DeviceState, FixType
from firmware_py.sensors.nmea_position import NmeaPosition, NmeaPositionOptions

EPOCH_TIMEOUT_S = 0.5

NORTH_SEA = "5327.03942,N,00214.42462,W"
VTG = "GNVTG,90.0,T,,M,2.0,N,3.7,K,A"


def rmc(time="103607.00", status="A", where=NORTH_SEA, date="060321", mode="A", speed="2.0", course="90.0"):
    return f"GNRMC,{time},{status},{where},{speed},{course},{date},,,{mode}"


def gga(time="103607.00", quality="1", where=NORTH_SEA):
    return f"GNGGA,{time},{where},{quality},06,5.88,56.0,M,48.5,M,,"


def gll(time="103607.00", status="A", where=NORTH_SEA):
    return f"GNGLL,{where},{time},{status},A"


def gns(modes):
    return f"GNGNS,103607.00,{NORTH_SEA},{modes},06,5.88,56.0,48.5,,,V"


def utc(*date_and_time):
    return dt.datetime(*date_and_time, tzinfo=dt.UTC).timestamp()


@pytest.fixture
def receiver(line):
    return NmeaPosition(line, NmeaPositionOptions())


@pytest.fixture
def epoch_sample(deliver, receiver):
    """Function that delivers one burst of sentences and returns its only sample."""

    def epoch_sample(*bodies):
        assert deliver(receiver, *bodies) == ()
        (sample,) = deliver(receiver, now_s=1.1 + EPOCH_TIMEOUT_S)
        return sample

    return epoch_sample


def test_sentences_of_an_epoch_are_merged(epoch_sample, near):
    sample = epoch_sample(rmc(speed="", course=""), VTG, gga(), gll())
    assert near(sample.latitude_rad, 53 + 27.03942 / 60)
    assert near(sample.longitude_rad, -(2 + 14.42462 / 60))
    assert near(sample.course_over_ground_rad, 90.0)
    assert sample.speed_over_ground_m_s == pytest.approx(2 * 1852 / 3600)
    assert (sample.t_s, sample.fix, sample.satellites, sample.hdop, sample.altitude_m) == (
        1.0,
        FixType.FIX_3D,
        6,
        5.88,
        56.0,
    )
    assert sample.utc_s == utc(2021, 3, 6, 10, 36, 7)


@pytest.mark.parametrize(("text", "hdop"), [("1000", 1000.0), ("1000.1", None), ("9999", None), ("", None)])
def test_hdop_above_1000_is_unknown(epoch_sample, text, hdop):
    assert epoch_sample(gga().replace("5.88", text)).hdop == hdop


@pytest.mark.parametrize(("delay_s", "has_course"), [(0.5, True), (0.51, False)])
def test_vtg_belongs_to_an_epoch_for_half_a_second(deliver, receiver, delay_s, has_course):
    deliver(receiver, gga(), now_s=1.0)
    samples = deliver(receiver, VTG, now_s=1.0 + delay_s) or deliver(receiver, now_s=9.0)
    assert [sample.course_over_ground_rad is not None for sample in samples] == [has_course]


@pytest.mark.parametrize(
    "burst",
    [lambda t: (rmc(t), VTG, gga(t), gll(t)), lambda t: (gga(t), gll(t), rmc(t), VTG), lambda t: (VTG, gga(t), rmc(t)),
     lambda t: (gga(t),), lambda t: (gll(t),), lambda t: (rmc(t),)],
)  # fmt: skip
def test_each_epoch_gives_one_sample_at_its_last_sentence(deliver, burst, receiver):
    deliver(receiver, *burst("103600.00"), now_s=0.0)
    for second in range(1, 9):
        samples = deliver(receiver, *burst(f"10360{second}.00"), now_s=float(second))
        # The start of the second epoch shows that the first one is complete.
        assert [sample.t_s for sample in samples] == ([0.0, 1.0] if second == 1 else [float(second)])
    assert deliver(receiver, now_s=99.0) == ()


def test_lost_sentence_delays_an_epoch_by_the_epoch_timeout(deliver, receiver):
    for second in range(2):
        deliver(receiver, rmc(f"10360{second}.00"), gga(f"10360{second}.00"), now_s=float(second))
    assert deliver(receiver, rmc("103602.00"), now_s=2.0) == ()
    assert deliver(receiver, now_s=2.0 + EPOCH_TIMEOUT_S) == ()
    assert [sample.t_s for sample in deliver(receiver, now_s=2.01 + EPOCH_TIMEOUT_S)] == [2.0]
    assert [sample.t_s for sample in deliver(receiver, rmc("103603.00"), gga("103603.00"), now_s=3.0)] == [3.0]


def test_time_of_a_sample_is_that_of_its_last_sentence(deliver, receiver):
    deliver(receiver, gga(), now_s=1.0)
    assert deliver(receiver, rmc(), now_s=1.25) == ()
    assert deliver(receiver, now_s=1.75) == ()
    assert [sample.t_s for sample in deliver(receiver, now_s=1.76)] == [1.25]


def test_sentence_with_another_time_starts_an_epoch(deliver, receiver):
    samples = deliver(receiver, rmc("103600.00"), gga("103601.00"))
    assert [(sample.fix, sample.altitude_m) for sample in samples] == [(FixType.FIX_2D, None)]


def test_ten_fixes_per_second_with_one_rmc_per_second(deliver, receiver):
    samples = []
    for tenth in range(100):
        time = f"1036{tenth // 10:02d}.{tenth % 10}0"
        samples += deliver(receiver, *([rmc(time)] if tenth % 10 == 0 else []), gga(time), now_s=tenth / 10)
    assert len(samples) in {99, 100}
    start_s = utc(2021, 3, 6, 10, 36)
    assert [sample.utc_s - start_s for sample in samples] == pytest.approx([sample.t_s for sample in samples])


@pytest.mark.parametrize(
    ("sentences", "fix"),
    [
        ((rmc(),), FixType.FIX_2D),  # no altitude
        ((gga(),), FixType.FIX_3D),
        ((gga(quality="2"), rmc()), FixType.DGPS),
        ((gga(quality="3"),), FixType.FIX_3D),
        ((gga(quality="4"),), FixType.RTK_FIXED),
        ((gga(quality="5"),), FixType.RTK_FLOAT),
        ((rmc(mode="D"),), FixType.DGPS),
        ((rmc(mode="P"),), FixType.FIX_2D),
        ((rmc(mode="F"),), FixType.RTK_FLOAT),
        ((rmc(mode=""),), FixType.FIX_2D),
        ((gns("AANN"),), FixType.FIX_3D),
        ((gns("RANN"),), FixType.RTK_FIXED),
        ((gns("NNNN"),), FixType.NONE),
        *(((gga(quality=quality),), FixType.NONE) for quality in ("0", "", "6", "7", "8")),
        *(
            ((sentence,), FixType.NONE)
            for sentence in (rmc(mode="E"), rmc(status="V"), rmc(status=""), gll(status="V"))
        ),
        ((gga(), rmc(status="V")), FixType.NONE),  # one sentence without a fix is sufficient
        ((rmc(where=",,,"),), FixType.NONE),
        ((rmc(where="5327.03942,N,,"),), FixType.NONE),
    ],
)
def test_fix_type(epoch_sample, sentences, fix):
    sample = epoch_sample(*sentences)
    assert sample.fix is fix
    assert (sample.latitude_rad is None) == (sample.utc_s is None and fix is FixType.NONE) == (fix is FixType.NONE)


def test_receiver_without_fix_is_running_and_reports_it(deliver, receiver):
    no_fix = ("GNRMC,,V,,,,,,,,,,N,V", "GNVTG,,,,,,,,,N", "GNGGA,,,,,,0,00,99.99,,,,,,", "GNGLL,,,,,,V,N")
    samples = [sample for second in range(6) for sample in deliver(receiver, *no_fix, now_s=float(second))]
    assert [sample.fix for sample in samples] == [FixType.NONE] * 6
    health = receiver.health(5.0)
    assert (health.role, health.state, health.text) == (DeviceRole.POSITION, DeviceState.RUNNING, "no fix")
    assert receiver.health(8.0).state is DeviceState.SILENT


def test_time_of_day_that_does_not_advance_is_no_fix(deliver, receiver):
    fixes = [sample.fix for tenth in range(40) for sample in deliver(receiver, rmc(), gga(), now_s=tenth / 10)]
    assert fixes == [FixType.FIX_3D] * 31 + [FixType.NONE] * 9
    assert receiver.health(5.0).text == "time not advancing: no fix"
    for second in range(3):
        samples = deliver(receiver, rmc(time=f"10370{second}.00"), now_s=6.0 + second)
    assert samples[-1].fix is FixType.FIX_2D
    assert receiver.health(9.0).text == ""


def test_whole_seconds_of_a_fast_receiver_are_valid(deliver, receiver):
    fixes = [
        sample.fix
        for tenths in range(300)
        for sample in deliver(receiver, rmc(time=f"1036{tenths // 10:02d}"), now_s=tenths / 10)
    ]
    assert len(fixes) > 290
    assert FixType.NONE not in fixes


def test_utc_without_a_date_is_extrapolated_from_the_last_date(deliver, receiver):
    samples = [
        *deliver(receiver, "GPZDA,235959.00,31,12,2024,00,00", gga("235959.50"), now_s=90_000.5),
        *deliver(receiver, gga("000000.00"), now_s=90_001.0),
        *deliver(receiver, gga("000000.50"), now_s=90_001.5),
    ]
    midnight_s = utc(2025, 1, 1)
    assert [sample.utc_s for sample in samples] == [midnight_s - 0.5, midnight_s, midnight_s + 0.5]
    (sample,) = deliver(receiver, gga("120000.00"), now_s=219_601.0)
    assert sample.utc_s == utc(2025, 1, 2, 12)


def test_invalid_date_of_zda_is_rejected_and_leaves_no_utc(deliver, receiver):
    deliver(receiver, gga(), rmc(date="310221"), "GPZDA,103607.00,31,02,2021,00,00")
    (sample,) = deliver(receiver, now_s=9.0)
    assert (sample.fix, sample.utc_s) == (FixType.FIX_3D, None)
    assert receiver.health(1.0).rejected == 1  # ZDA contains only the date


@pytest.mark.parametrize(("is_required", "counts"), [(False, (1, 0)), (True, (0, 1))])
def test_missing_checksum_is_rejected_if_it_is_required(line, deliver, is_required, counts):
    assert NmeaPositionOptions().require_checksum
    receiver = NmeaPosition(line, NmeaPositionOptions(require_checksum=is_required))
    deliver(receiver, f"${gga()}\r\n".encode())
    health = receiver.health(1.0)
    assert (health.accepted, health.rejected) == counts


def test_reopened_port_discards_sentence_epoch_time_and_date(line, deliver, receiver):
    deliver(receiver, "GPZDA,103607.00,06,03,2021,00,00", gga(), now_s=0.0)
    assert len(deliver(receiver, gga(), b"$GNGGA,1036", now_s=1.0)) == 2
    line.unplug()
    assert receiver.health(1.0).state is DeviceState.ABSENT
    line.plug()
    assert deliver(receiver, gga(), now_s=4.0) == ()
    (sample,) = deliver(receiver, now_s=5.0)
    assert (sample.fix, sample.utc_s, sample.t_s) == (FixType.FIX_3D, None, 4.0)
    assert receiver.health(5.0).rejected == 0


def test_recording_gives_one_sample_per_rmc(deliver, recordings, receiver):
    data = (recordings / "nmea" / "avnav_20160815_excerpt.nmea").read_bytes()
    samples = []
    for step, start in enumerate(range(0, len(data), 1000)):
        samples += deliver(receiver, data[start : start + 1000], now_s=step * 0.8)
    samples += deliver(receiver, now_s=1e4)
    # 207 RMC; the first and last epoch of the excerpt may be truncated.
    assert 206 <= len(samples) <= 208
    complete = [sample for sample in samples if sample.speed_over_ground_m_s is not None]
    assert len(complete) >= 206
    assert all(sample.fix is FixType.FIX_3D and sample.utc_s is not None for sample in complete)
    assert all(later.utc_s > earlier.utc_s for earlier, later in itertools.pairwise(complete))
    assert complete[0].latitude_rad == pytest.approx(math.radians(52.494), abs=1e-4)


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
def test_invalid_date_removes_the_time_and_invalid_position_the_fix(epoch_sample, receiver, body, fix, has_utc, text):
    sample = epoch_sample(body)
    assert (sample.fix, sample.latitude_rad is None) == (fix, fix is FixType.NONE)
    assert (sample.utc_s is not None) == has_utc
    assert (receiver.health(2.0).rejected, receiver.health(2.0).text) == (0, text)
