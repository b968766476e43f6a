"""Battery of a flight controller."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from firmware_py.common.records import DeviceState
from firmware_py.sensors.mavlink_frames import Message
from firmware_py.sensors.mavlink_power import MavlinkPower, MavlinkPowerOptions
from support.flight_controller import Board, decode_all, requested, requested_streams

NO_CELL = 0xFFFF
# Cells in mV, currents in 0.01 A, remaining charge in percent, temperature in 0.01 deg C.


def battery(number=0, *, cells=(12_800,), current=120, remaining=77, temperature=2150, more=(0, 0, 0, 0)):
    voltages = [*cells, *[NO_CELL] * (10 - len(cells))]
    return dialect.MAVLink_battery_status_message(
        number, 0, 0, temperature, voltages, current, -1, -1, remaining, 0, 0, more, 2
    )


def summary(voltage=12_700, current=-50, remaining=66):
    return dialect.MAVLink_sys_status_message(0, 0, 0, 100, voltage, current, remaining, 0, 0, 0, 0, 0, 0)


class Rig:
    """A battery monitor, its line, and a board that it has selected."""

    def __init__(self, line, **options):
        self.line, self.board = line, Board()
        self.power = MavlinkPower(line, MavlinkPowerOptions(**options))
        self.samples(0.0, None, None)

    def samples(self, now_s, *messages):
        for message in messages:
            self.line.inbox += self.board.heartbeat() if message is None else self.board.pack(message)
        self.power.receive(now_s)
        return self.power.poll()


@pytest.fixture
def rig(line):
    return Rig(line)


def test_battery(rig):
    (sample,) = rig.samples(1.0, battery())
    assert sample.t_s == 1.0
    assert sample.voltage_v == pytest.approx(12.8)
    assert sample.current_a == pytest.approx(-1.2)  # a discharge current is positive in MAVLink
    assert sample.charge == pytest.approx(0.77)
    assert sample.temperature_c == pytest.approx(21.5)
    assert (sample.solar_w, sample.load_a) == (None, None)
    health = rig.power.health(1.0)
    assert (health.state, health.text, health.accepted) == (DeviceState.RUNNING, "", 1)


def test_voltage_is_the_sum_of_the_cells(rig):
    (sample,) = rig.samples(1.0, battery(cells=[4000] * 10, more=(4100, 4100, 0, 0)))
    assert sample.voltage_v == pytest.approx(48.2)


def test_unknown_values_are_none(rig):
    (sample,) = rig.samples(1.0, battery(current=-1, remaining=-1, temperature=32767))
    assert (sample.current_a, sample.charge, sample.temperature_c) == (None, None, None)
    (sample,) = rig.samples(2.0, battery(cells=()))
    assert (sample.voltage_v, sample.charge) == (None, pytest.approx(0.77))


def test_empty_battery(rig):
    (sample,) = rig.samples(1.0, battery(remaining=0))
    assert sample.charge == 0.0


def test_battery_that_is_not_measured_gives_no_sample(rig):
    assert rig.samples(1.0, battery(cells=(), remaining=-1)) == ()
    assert rig.power.health(1.0).text == "battery not measured"


def test_summary_is_used_while_there_is_no_battery_message(rig):
    (sample,) = rig.samples(1.0, summary())
    assert (sample.voltage_v, sample.current_a) == (pytest.approx(12.7), pytest.approx(0.5))
    assert (sample.charge, sample.temperature_c) == (pytest.approx(0.66), None)
    assert len(rig.samples(2.0, battery(), summary())) == 1
    assert rig.samples(7.0, summary()) == ()
    assert len(rig.samples(7.01, summary())) == 1


@pytest.mark.parametrize("voltage", [0, 65535])
def test_summary_without_a_voltage(rig, voltage):
    assert rig.samples(1.0, summary(voltage=voltage))[0].voltage_v is None
    assert rig.samples(2.0, summary(voltage=voltage, remaining=-1)) == ()


def test_other_battery(line):
    with pytest.raises(ValueError, match=r"battery: .* 0 to 255$"):
        MavlinkPowerOptions(battery=256)
    rig = Rig(line, battery=2)
    assert rig.samples(1.0, battery(0), summary()) == ()
    assert len(rig.samples(2.0, battery(2))) == 1


@pytest.mark.parametrize(
    "values", [{"remaining": 101}, {"remaining": -2}, {"temperature": 15_001}, {"temperature": -10_001}]
)
def test_impossible_values_are_rejected(rig, values):
    assert rig.samples(1.0, battery(**values)) == ()
    assert rig.power.health(1.0).rejected == 1


def test_requested_messages_and_silence(rig):
    assert requested(rig.line.written) == [(Message.BATTERY_STATUS, 1_000_000), (Message.SYS_STATUS, 1_000_000)]
    assert {message.get_srcComponent() for message in decode_all(rig.line.written)} == {
        dialect.MAV_COMP_ID_ONBOARD_COMPUTER3
    }
    assert rig.power.health(0.1).text == "connected, no battery yet"
    rig.samples(1.0, battery())
    assert rig.power.health(6.0).state is DeviceState.RUNNING
    assert rig.power.health(6.01).state is DeviceState.SILENT


def test_groups_of_an_older_board(rig):
    rig.samples(
        0.5, dialect.MAVLink_command_ack_message(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_RESULT_UNSUPPORTED)
    )
    rig.samples(1.0)
    assert requested_streams(rig.line.written) == [
        dialect.MAV_DATA_STREAM_EXTRA3,
        dialect.MAV_DATA_STREAM_EXTENDED_STATUS,
    ]
