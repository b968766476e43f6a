"""Echo sounder driver: sentences of instruments, offsets, lost bottom, preference, health."""

import pytest

from firmware_py.common.records import DepthSample, DeviceRole, DeviceState
from firmware_py.sensors.nmea_depth import NmeaDepth, NmeaDepthOptions

MOUNTED = {"transducer_depth_m": 0.4, "keel_depth_m": 2.5}


@pytest.fixture
def sounder(line):
    return NmeaDepth(line, NmeaDepthOptions(**MOUNTED))


@pytest.mark.parametrize(
    ("data", "depth_m", "transducer_m"),
    [
        # Sentences of the tests of Signal K and of captures, with their checksums.
        (b"$IIDBT,035.53,f,010.83,M,005.85,F*23\r\n", 11.23, 0.4),
        (b"$IIDBS,035.53,f,010.83,M,005.85,F*24\r\n", 10.83, 0.4),
        (b"$IIDBK,035.53,f,010.83,M,005.85,F*3C\r\n", 13.33, 0.4),
        (b"$IIDBT,432.8,f,,M,,F*1C\r\n", 432.8 * 0.3048 + 0.4, 0.4),
        (b"$IIDPT,4.1,1.0*44\r\n", 5.1, 1.0),
        (b"$IIDPT,4.1,-1.0*69\r\n", 4.5, 0.4),
        (b"$IIDPT,4.1,*6B\r\n", 4.5, 0.4),
        (b"$SDDPT,23.9,0.0,*43\r\n", 24.3, 0.4),
        (b"$SDDPT,5.3,*7F\r\n", 5.7, 0.4),
        ("SDDBT,,f,,M,2.0,F", 2.0 * 1.8288 + 0.4, 0.4),
        ("SDDPT,0.1,0.5", 0.6, 0.5),
    ],
)
def test_depth_below_the_surface(deliver, sounder, data, depth_m, transducer_m):
    (sample,) = deliver(sounder, data, now_s=2.5)
    assert sample.t_s == 2.5
    assert sample.depth_m == pytest.approx(depth_m)
    assert sample.transducer_m == transducer_m


def test_offsets_are_zero_by_default(deliver, line):
    sounder = NmeaDepth(line, NmeaDepthOptions())
    assert deliver(sounder, "SDDPT,4.1,", now_s=1.0) == (DepthSample(1.0, 4.1, 0.0),)
    assert deliver(sounder, "SDDBK,,f,4.1,M,,F", now_s=9.0) == (DepthSample(9.0, 4.1, 0.0),)


@pytest.mark.parametrize(
    "body",
    ["SDDPT,,0.5", "SDDPT,0.0,0.5", "SDDBT,,f,,M,,F", "SDDBT,0.0,f,0.0,M,0.0,F", "SDDBS,,f,0,M,,F", "SDDBK,,f,0,M,,F"],
)
def test_lost_bottom_gives_no_sample_but_is_accepted(deliver, sounder, body):
    assert not deliver(sounder, body)
    health = sounder.health(1.0)
    assert (health.role, health.state) == (DeviceRole.DEPTH, DeviceState.RUNNING)
    assert (health.accepted, health.rejected, health.text) == (1, 0, f"{body[:5]}: no bottom")


@pytest.mark.parametrize(
    "body",
    ["SDDPT,12001,0.5", "SDDPT,-1.0,0.5", "SDDPT,4.1,101", "SDDBT,4.1,f,4.1,f,,F", "SDDPT,4.1", "SDDBS,1,f,1,x,,F"],
)
def test_invalid_sentence_is_rejected(deliver, sounder, body):
    assert not deliver(sounder, body)
    assert (sounder.health(1.0).accepted, sounder.health(1.0).rejected) == (0, 1)


DBS, DPT, DBT, DBK = "SDDBS,,f,9.0,M,,F", "SDDPT,8.0,0.5", "SDDBT,,f,7.0,M,,F", "SDDBK,,f,6.0,M,,F"


def depths(samples):
    return [sample.depth_m for sample in samples]


def test_sentences_are_preferred_in_the_order_dbs_dpt_dbt_dbk(deliver, sounder):
    assert depths(deliver(sounder, DBS, DPT, DBT, DBK, now_s=1.0)) == [9.0]
    assert depths(deliver(sounder, DPT, DBT, DBK, now_s=6.0)) == []
    assert depths(deliver(sounder, DPT, DBT, DBK, now_s=6.1)) == [8.5]
    assert depths(deliver(sounder, DBT, DBK, now_s=11.2)) == [7.4]
    assert depths(deliver(sounder, DBK, now_s=16.3)) == [8.5]


def test_selected_sentences_are_used_only(deliver, line):
    sounder = NmeaDepth(line, NmeaDepthOptions(sentences=("DBT",)))
    assert depths(deliver(sounder, DBS, DPT, DBT)) == [7.0]


def test_options_are_checked():
    assert NmeaDepthOptions(transducer_depth_m=100.0, keel_depth_m=100.0).keel_depth_m == 100.0
    for name in ("transducer_depth_m", "keel_depth_m"):
        for value in (-0.1, 100.1):
            with pytest.raises(ValueError, match=name):
                NmeaDepthOptions(**{name: value})
    with pytest.raises(ValueError, match="sentences"):
        NmeaDepthOptions(sentences=("DEP",))


def test_checksum_is_required_by_default(deliver, line, sounder):
    data = b"$SDDPT,4.1,0.5\r\n"
    assert not deliver(sounder, data)
    assert len(deliver(NmeaDepth(line, NmeaDepthOptions(require_checksum=False)), data)) == 1


def test_sounder_is_silent_after_its_timeout_and_recovers(deliver, sounder, line):
    for second in range(1, 21):
        deliver(sounder, DPT, now_s=float(second))
    assert sounder.health(25.0).state is DeviceState.RUNNING
    assert sounder.health(25.1).state is DeviceState.SILENT
    deliver(sounder, DPT, now_s=40.0)
    assert sounder.health(40.0).state is DeviceState.RUNNING
    line.unplug()
    assert sounder.health(41.0).state is DeviceState.ABSENT


def test_preference_is_reset_when_the_port_is_reopened(deliver, sounder, line):
    assert depths(deliver(sounder, DBS, b"$SDDBS,,f", now_s=1.0)) == [9.0]
    line.plug()
    assert depths(deliver(sounder, DBK, now_s=2.0)) == [8.5]
    assert sounder.health(2.0).rejected == 0  # the incomplete sentence was discarded


def test_next_depth_clears_the_health_text(deliver, sounder):
    deliver(sounder, "SDDPT,,0.5")
    assert sounder.health(1.0).text == "SDDPT: no bottom"
    deliver(sounder, DPT)
    assert sounder.health(1.0).text == ""
