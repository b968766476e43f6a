"""VE.Direct driver: blocks of Victron devices, invalid blocks, and reported faults."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.records import DeviceRole, DeviceState, PowerSample
from firmware_py.devices import decode
from firmware_py.sensors.vedirect import VeDirectPower
from firmware_py.sensors.vedirect_blocks import BlockFramer

MAX_BLOCK_BYTES = 1024


def block(**fields):
    body = b"".join(b"\r\n%s\t%s" % (label.encode(), value.encode()) for label, value in fields.items())
    body += b"\r\nChecksum\t"
    return body + bytes([-sum(body) & 0xFF])


CHARGER = block(PID="0xA053", V="13790", I="-10", VPV="15950", PPV="37", CS="3", ERR="0", LOAD="ON", IL="320")
MONITOR = block(PID="0xA389", V="12341", T="---", I="-1520", P="-19", SOC="876", Alarm="OFF", AR="0", BMV="SmartShunt")
HISTORY = block(H1="-188890", H17="1563", H18="2095")
# Label, value, and the value in SI units.
OUT_OF_RANGE = [
    ("V", "-1", "-0.001"), ("V", "1000001", "1000.001"), ("I", "-5000001", "-5000.001"), ("I", "5000001", "5000.001"),
    ("SOC", "-1", "-0.001"), ("SOC", "1001", "1.001"), ("PPV", "-1", "-1"), ("PPV", "100001", "100001"),
    ("IL", "-1", "-0.001"), ("IL", "1000001", "1000.001"), ("T", "-61", "-61"), ("T", "151", "151"),
    ("ERR", "-1", "-1"), ("ERR", "256", "256"), ("AR", "-1", "-1"), ("AR", "65536", "65536"),
]  # fmt: skip


@pytest.fixture
def device(line):
    return VeDirectPower(line)


@pytest.mark.parametrize(
    ("data", "sample"),
    [
        (CHARGER, PowerSample(2.5, 0, 13.79, -0.01, solar_w=37.0, load_a=0.32)),
        (MONITOR, PowerSample(2.5, 0, 12.341, -1.52, charge=0.876)),
        (block(V="12341", I="0", SOC="---"), PowerSample(2.5, 0, 12.341, 0.0)),
        # A charger that is supplied by another battery.
        (block(V="13790", I="5100", DC_IN_V="26400", DC_IN_P="72", ERR="0"), PowerSample(2.5, 0, 13.79, 5.1)),
        (
            block(V="0", I="-5000000", SOC="0", PPV="0", IL="0", T="-60", ERR="255"),
            PowerSample(2.5, 0, 0.0, -5000.0, 0.0, 0.0, 0.0, -60.0),
        ),
        (
            block(V="1000000", I="5000000", SOC="1000", PPV="100000", IL="1000000", T="150", AR="65535"),
            PowerSample(2.5, 0, 1000.0, 5000.0, 1.0, 100_000.0, 1000.0, 150.0),
        ),
    ],
    ids=["charger", "monitor", "unknown charge", "other labels", "lower limits", "upper limits"],
)
def test_sample_of_a_block(deliver, device, data, sample):
    (measured,) = deliver(device, data, now_s=2.5)
    for name in PowerSample.__struct_fields__:
        value = getattr(sample, name)
        assert getattr(measured, name) == (None if value is None else pytest.approx(value)), name


def test_history_of_a_monitor_gives_no_sample_but_is_accepted(deliver, device):
    assert len(deliver(device, MONITOR + HISTORY)) == 1
    health = device.health(1.0)
    assert (health.role, health.state) == (DeviceRole.POWER, DeviceState.RUNNING)
    assert (health.accepted, health.rejected) == (2, 0)


def test_incomplete_first_block_is_skipped_without_a_report(deliver, device):
    assert len(deliver(device, MONITOR[20:] + CHARGER)) == 1
    assert device.health(1.0).rejected == 0


def test_hexadecimal_replies_between_the_fields_are_ignored(deliver, device):
    position = MONITOR.index(b"\r\nSOC")
    mixed = b":7F0ED0071\n" + MONITOR[:position] + b":A0102000543B\n" + MONITOR[position:]
    assert len(deliver(device, HISTORY + mixed)) == 1


@pytest.mark.parametrize("checksum", [0x0A, 0x0D, 0x3A, 0x09])
def test_checksum_can_be_a_control_character_or_colon(deliver, device, checksum):
    blocks = (
        block(V="12000", SER="HQ" + "0" * count + letter) for count in range(12) for letter in "ABCDEFGHIJKLMNOPQ"
    )
    data = next(data for data in blocks if data[-1] == checksum)
    assert len(deliver(device, HISTORY + data + MONITOR)) == 2


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (MONITOR[:-1] + b"!", "checksum"),
        (block(V="x"), "V 'x' is not a number"),
        (block(V="1_0"), "V '1_0' is not a number"),
        *((block(**{label: value}), f"{label} {text} out of range") for label, value, text in OUT_OF_RANGE),
        (block(**{"V\x7f": "1", "I": "1"}), "malformed"),
        (block(**{"I": "1", "V\x7f": "1"}), "malformed"),
    ],
)
def test_damaged_and_invalid_blocks_are_rejected_and_reported(deliver, data, text, device):
    deliver(device, HISTORY)
    assert deliver(device, data) == ()
    health = device.health(1.0)
    assert (health.rejected, health.text) == (1, text)


def test_error_of_the_charger_is_a_fault_until_it_ends(deliver, device):
    deliver(device, block(V="12000", PPV="0", ERR="17"))
    assert (device.health(1.0).state, device.health(1.0).text) == (DeviceState.FAULTY, "charger reports error 17")
    deliver(device, CHARGER)
    assert device.health(1.0).state is DeviceState.RUNNING


def test_fault_and_incomplete_block_end_when_the_line_is_reopened(line, deliver, device):
    deliver(device, block(V="12000", ERR="17") + MONITOR[:30])
    line.plug()
    assert len(deliver(device, MONITOR[30:] + HISTORY + MONITOR)) == 1
    line.plug()
    deliver(device, block(V="12000", ERR="17"))
    line.plug()
    deliver(device, HISTORY)
    assert device.health(1.0).state is DeviceState.RUNNING
    line.plug()
    deliver(device, b"noise")
    assert device.health(1.0).text == "data not understood: wrong baud rate?"


@pytest.mark.parametrize(
    ("fields", "text"),
    [({"Alarm": "ON", "AR": "1"}, "alarm, reason code 1"), ({"Alarm": "On", "AR": "2"}, "alarm, reason code 2"),
     ({"Alarm": "ON"}, ""), ({"Alarm": "OFF", "AR": "1"}, ""), ({"AR": "1"}, "")],
)  # fmt: skip
def test_alarm_of_the_monitor_is_reported(deliver, device, fields, text):
    deliver(device, block(V="10100", I="-10", **fields))
    assert device.health(1.0).text == text


def test_device_without_data_is_silent_after_five_seconds(deliver, device):
    deliver(device, MONITOR)
    assert device.health(6.0).state is DeviceState.RUNNING
    assert device.health(6.01).state is DeviceState.SILENT


@given(st.lists(st.sampled_from([CHARGER, MONITOR, HISTORY, b"noise\r\n", MONITOR[:30]]), max_size=6), st.data())
def test_blocks_do_not_depend_on_the_chunks(pieces, data):
    stream = b"".join(pieces)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=5)))
    framer, blocks = BlockFramer(), []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        blocks += framer.feed(stream[start:end])
    assert blocks == BlockFramer().feed(stream)


def test_too_long_block_is_discarded_and_reported_once():
    framer = BlockFramer()
    framer.feed(HISTORY)
    assert framer.feed(b"x" * MAX_BLOCK_BYTES) == []
    assert [block.fault for block in framer.feed(b"x")] == ["malformed"]
    framer.feed(b"\r\nChecksum\t\0")
    assert [block.fault for block in framer.feed(b"\r\nV\t1" * MAX_BLOCK_BYTES)] == ["malformed"]
    assert [block.fault for block in framer.feed(MONITOR + CHARGER)] == [""]


def test_decoded_capture():
    history, monitor, damaged = decode("vedirect", HISTORY + MONITOR + CHARGER[:-1] + b"\x00")
    assert (history["type"], monitor["type"], damaged["type"]) == ("other", "power", "error")
    assert (monitor["voltage_v"], monitor["charge"], monitor["line"]) == (12.341, 0.876, 2)
