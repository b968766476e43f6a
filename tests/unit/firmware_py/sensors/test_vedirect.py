"""The VE.Direct driver: blocks as Victron's devices send them, and bytes that are none."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.records import DeviceRole, DeviceState, PowerSample
from firmware_py.devices import decode
from firmware_py.sensors.vedirect import VeDirectPower
from firmware_py.sensors.vedirect_blocks import MAX_BLOCK_BYTES, BlockFramer

END = b"\r\nChecksum\t"


def block(**fields):
    body = b"".join(b"\r\n%s\t%s" % (label.encode(), value.encode()) for label, value in fields.items()) + END
    return body + bytes([-sum(body) & 0xFF])


CHARGER = block(PID="0xA053", V="13790", I="-10", VPV="15950", PPV="37", CS="3", ERR="0", LOAD="ON", IL="320")
MONITOR = block(PID="0xA389", V="12341", T="---", I="-1520", P="-19", SOC="876", Alarm="OFF", AR="0", BMV="SmartShunt")
HISTORY = block(H1="-188890", H17="1563", H18="2095")


@pytest.fixture
def device(line):
    return VeDirectPower(line)


@pytest.fixture
def hear(line):
    def give(device, data, now_s=1.0):
        line.inbox += data
        device.receive(now_s)
        return device.poll()

    return give


def test_a_charger_reports_battery_panels_and_load(line, hear):
    (sample,) = hear(VeDirectPower(line), CHARGER, now_s=2.5)
    assert sample == PowerSample(2.5, 0, pytest.approx(13.79), pytest.approx(-0.01), None, 37.0, pytest.approx(0.32))


def test_a_monitor_reports_the_charge_and_its_history_counts_as_accepted(hear, device):
    (sample,) = hear(device, MONITOR + HISTORY)
    assert (sample.charge, sample.current_a) == (pytest.approx(0.876), pytest.approx(-1.52))
    assert (sample.solar_w, sample.load_a, sample.temperature_c) == (None, None, None)
    health = device.health(1.0)
    assert (health.role, health.state, health.accepted, health.rejected) == (
        DeviceRole.POWER,
        DeviceState.RUNNING,
        2,
        0,
    )


def test_a_charge_that_is_not_known_is_not_made_up(line, hear):
    (sample,) = hear(VeDirectPower(line), block(V="12341", I="0", SOC="---"))
    assert sample.charge is None


def test_a_charger_from_another_battery_has_labels_of_its_own(line, hear):
    (sample,) = hear(VeDirectPower(line), block(V="13790", I="5100", DC_IN_V="26400", DC_IN_P="72", ERR="0"))
    assert sample.current_a == pytest.approx(5.1)


def test_a_block_that_was_under_way_is_passed_over_without_a_word(hear, device):
    assert len(hear(device, MONITOR[20:] + CHARGER)) == 1
    assert device.health(1.0).rejected == 0


def test_answers_of_the_other_protocol_between_the_fields_count_for_nothing(line, hear):
    cut = MONITOR.index(b"\r\nSOC")
    mixed = b":7F0ED0071\n" + MONITOR[:cut] + b":A0102000543B\n" + MONITOR[cut:]
    assert len(hear(VeDirectPower(line), HISTORY + mixed)) == 1


@pytest.mark.parametrize("checksum", [0x0A, 0x0D, 0x3A, 0x09])
def test_a_checksum_may_be_any_byte(line, hear, checksum):
    blocks = (
        block(V="12000", SER="HQ" + "0" * count + letter) for count in range(12) for letter in "ABCDEFGHIJKLMNOPQ"
    )
    one = next(data for data in blocks if data[-1] == checksum)
    assert len(hear(VeDirectPower(line), HISTORY + one + MONITOR)) == 2


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (MONITOR[:-1] + b"!", "checksum"),
        (block(V="x"), "V 'x' is not a number"),
        (block(V="1_0"), "V '1_0' is not a number"),
        (block(V="-1"), "V -0.001 out of range"),
        (block(SOC="1001"), "SOC 1.001 out of range"),
        (block(I="99999999"), "I 99999.999 out of range"),
        (block(**{"V\x7f": "1"}), "malformed"),
    ],
)
def test_damaged_and_invalid_blocks_are_rejected_and_reported(hear, data, text, device):
    hear(device, HISTORY)
    assert hear(device, data) == ()
    health = device.health(1.0)
    assert (health.rejected, health.text) == (1, text)


def test_an_error_of_the_charger_is_a_fault_of_the_device_until_it_goes(hear, device):
    hear(device, block(V="12000", PPV="0", ERR="17"))
    assert (device.health(1.0).state, device.health(1.0).text) == (DeviceState.FAULTY, "charger reports error 17")
    hear(device, CHARGER)
    assert device.health(1.0).state is DeviceState.RUNNING


def test_an_alarm_of_the_monitor_is_reported(hear, device):
    hear(device, block(V="10100", I="-10", Alarm="ON", AR="1"))
    assert device.health(1.0).text == "alarm, reason code 1"


def test_who_says_nothing_is_silent(hear, device):
    hear(device, MONITOR)
    assert device.health(4.0).state is DeviceState.RUNNING
    assert device.health(7.0).state is DeviceState.SILENT


@given(st.lists(st.sampled_from([CHARGER, MONITOR, HISTORY, b"noise\r\n", MONITOR[:30]]), max_size=6), st.data())
def test_however_the_stream_is_cut_the_blocks_are_the_same(pieces, data):
    stream = b"".join(pieces)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=5)))
    whole, cut = BlockFramer(), BlockFramer()
    expected = whole.feed(stream)
    found = [
        one for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True) for one in cut.feed(stream[start:end])
    ]
    assert found == expected


def test_a_stream_without_an_end_is_forgotten_and_counted_once_it_is_too_long():
    framer = BlockFramer()
    framer.feed(HISTORY)
    found = framer.feed(b"\r\nV\t1" * MAX_BLOCK_BYTES)
    assert [one.fault for one in found] == ["malformed"]
    assert [one.fault for one in framer.feed(MONITOR + CHARGER)] == [""]


def test_a_capture_is_decoded_line_by_line():
    results = list(decode("vedirect", HISTORY + MONITOR + CHARGER[:-1] + b"\x00"))
    assert [one["type"] for one in results] == ["other", "power", "error"]
    assert (results[1]["voltage_v"], results[1]["charge"], results[1]["line"]) == (12.341, 0.876, 2)
