"""Driver of a Maestro on a line under control of the test."""

import math
import re
from types import SimpleNamespace

import pytest

from firmware_py.actuator.maestro import MaestroOptions, MaestroServo, ReplyParser, crc7, maestro_rudder
from firmware_py.common.records import DeviceRole, DeviceState, RudderCommand
from hil.devices.hobby_servo import HobbyServo
from hil.devices.maestro import MaestroEmulator, divide
from hil.ship.servo import ServoShaft

SET_TARGET, SET_SPEED, SET_ACCELERATION, GET_POSITION, GET_ERRORS = 0x84, 0x87, 0x89, 0x90, 0xA1
POLOLU_PROTOCOL = 0xAA  # first byte of the search, which reads the errors
LENGTHS = {SET_TARGET: 4, SET_SPEED: 4, SET_ACCELERATION: 4, GET_POSITION: 2, GET_ERRORS: 1, POLOLU_PROTOCOL: 3}


class FakeMaestro:
    """A Maestro that replies at once; it knows the commands that the driver uses, in any concatenation."""

    def __init__(self, channel=0):
        self.channel = channel
        self.powered = True
        self.position = self.errors = self.speed = self.acceleration = 0
        self.limits = (0, 16383)
        self.commands = []

    def handle(self, data):
        if not self.powered:
            return b""
        reply = b""
        while data:
            packet, data = data[: LENGTHS[data[0]]], data[LENGTHS[data[0]] :]
            self.commands.append(packet[0])
            number = packet[-2] + 128 * packet[-1] if len(packet) == 4 else 0
            assert packet[0] in (GET_ERRORS, POLOLU_PROTOCOL) or packet[1] == self.channel
            if packet[0] == SET_TARGET:
                self.position = min(max(number, self.limits[0]), self.limits[1]) if number else 0
            elif packet[0] == SET_SPEED:
                self.speed = number
            elif packet[0] == SET_ACCELERATION:
                self.acceleration = number
            elif packet[0] == GET_POSITION:
                reply += self.position.to_bytes(2, "little")
            else:
                reply += self.errors.to_bytes(2, "little")
                self.errors = 0
        return reply

    def cut_power(self):
        self.position = self.speed = self.acceleration = self.errors = 0
        self.powered = False


@pytest.fixture
def maestro():
    return FakeMaestro()


@pytest.fixture
def line(fakes, maestro):
    return fakes.line(maestro)


@pytest.fixture
def rig(fakes, line):
    return fakes.rig(maestro_rudder(line, MaestroOptions()))


def first_frames(fakes, options, shaft_deg=0.0, torque_on=True):
    """Return the frames of the first ticks of a Maestro that replies 0 to everything."""
    line = fakes.line()
    line.write = lambda data: line.written.append(bytes(data)) or line.inbox.extend(b"\0\0") or True
    fakes.rig(maestro_rudder(line, options)).ticks(2, shaft_deg=shaft_deg, torque_on=torque_on)
    return line.written


def test_frames_of_the_manual(fakes):
    """Section 5.c: set the target of servo 0 to 1500 us; section 5.e: the other commands."""
    search, target, reading = first_frames(fakes, MaestroOptions())[:3]
    assert search == bytes.fromhex("AA 0C 21")
    assert target == bytes.fromhex("90 00 84 00 70 2E")
    assert reading == bytes.fromhex("87 00 00 00 89 00 00 00 A1")


def test_options_are_in_the_frames(fakes):
    options = MaestroOptions(channel=5, device=20, speed=140, acceleration=200, us_per_rad=500.0)
    search, target, reading = first_frames(fakes, options, shaft_deg=math.degrees(0.5))[:3]
    assert search == bytes.fromhex("AA 14 21")
    assert target == bytes.fromhex("90 05 84 05 58 36")  # 7000 quarter microseconds
    assert reading == bytes.fromhex("87 05 0C 01 89 05 48 01 A1")


def test_crc_of_the_manual():
    """Section 5.d: the command 83 01 has the CRC 17."""
    assert crc7(bytes.fromhex("83 01")) == 0x17


def test_replies_are_two_bytes_and_each_is_returned_once():
    parser = ReplyParser()
    assert (parser.feed(b"\x01\x02\x03"), parser.pending) == ([0x0201], 1)
    assert (parser.feed(b"\x04"), parser.pending) == ([0x0403], 0)


def test_every_command_has_a_crc_if_the_maestro_requires_one(fakes):
    for plain, frame in zip(
        first_frames(fakes, MaestroOptions()), first_frames(fakes, MaestroOptions(crc=True)), strict=True
    ):
        packets = re.findall(rb"[\x80-\xff][\x00-\x7f]*", plain)
        assert frame == b"".join(
            packet + bytes([divide(list(packet))]) for packet in packets
        )  # the CRC by long division


def test_target_is_sent_and_the_feedback_has_no_angle(rig, maestro):
    feedback = rig.ticks(3, shaft_deg=20.0)
    assert maestro.position == round(4 * (1500 + 636.6 * math.radians(20.0)))
    assert [(record.shaft_rad, record.torque_on, record.restarts) for record in feedback] == [(None, True, 0)] * 3
    health = rig.health()
    assert (health.role, health.state, health.text) == (DeviceRole.RUDDER, DeviceState.RUNNING, "")
    assert health.rejected == 0


def test_limits_of_speed_and_acceleration_are_set_every_second(fakes, maestro, line):
    rig = fakes.rig(maestro_rudder(line, MaestroOptions(speed=300, acceleration=7)))
    rig.ticks(5)
    assert (maestro.speed, maestro.acceleration) == (300, 7)
    maestro.commands.clear()
    rig.ticks(50)
    assert maestro.commands.count(SET_TARGET) == 50
    assert 4 <= maestro.commands.count(GET_ERRORS) <= 6
    assert maestro.commands.count(POLOLU_PROTOCOL) == 0


def test_released_servo_has_no_pulse(rig, maestro):
    rig.ticks(2, shaft_deg=10.0)
    feedback = rig.ticks(2, torque_on=False)
    assert maestro.position == 0
    assert feedback[-1].torque_on is False
    assert rig.health().text == "no pulse; the servo is free"
    assert rig.ticks(3, shaft_deg=10.0)[-1].restarts == 0


def test_power_cut_is_counted_as_a_restart_and_the_target_is_set_again(rig, maestro):
    rig.ticks(5, shaft_deg=10.0)
    position = maestro.position
    maestro.cut_power()
    assert rig.ticks(15, shaft_deg=10.0) == []
    assert rig.health().state is DeviceState.SILENT
    maestro.powered = True
    feedback = rig.ticks(4, shaft_deg=10.0)
    assert maestro.position == position
    assert [record.restarts for record in feedback][-2:] == [1, 1]
    assert rig.health().state is DeviceState.RUNNING
    assert rig.ticks(30, shaft_deg=10.0)[-1].restarts == 1


def test_short_power_cut_without_a_lost_reply_is_noticed(rig, maestro):
    rig.ticks(5, shaft_deg=10.0)
    maestro.cut_power()
    maestro.powered = True
    assert rig.ticks(3, shaft_deg=10.0)[-1].restarts == 1


def test_search_sets_the_baud_rate_after_every_silence(rig, maestro):
    rig.ticks(3)
    maestro.powered = False
    rig.ticks(10)
    maestro.commands.clear()
    maestro.powered = True
    rig.ticks(2)
    assert POLOLU_PROTOCOL in maestro.commands[:2]


def test_maestro_of_another_device_number_is_driven(rig, maestro):
    """It does not reply to the search."""
    handle = maestro.handle
    maestro.handle = lambda data: b"" if data[0] == POLOLU_PROTOCOL else handle(data)
    rig.ticks(5, shaft_deg=10.0)
    assert maestro.position == round(4 * (1500 + 636.6 * math.radians(10.0)))
    maestro.powered = False
    rig.ticks(15)
    maestro.powered = True
    assert rig.ticks(5, shaft_deg=10.0)
    assert rig.health().state is DeviceState.RUNNING


@pytest.mark.parametrize(
    ("errors", "text"),
    [
        (1 << 0, "serial signal error: wrong baud rate?"),
        (1 << 3, "CRC error: check option crc"),
        (1 << 4, "serial protocol error: check option crc"),
        (1 << 8, "script counter error"),
        (1 << 2 | 1 << 4, "serial buffer full"),
    ],
)
def test_error_is_reported_and_is_no_restart(rig, maestro, errors, text):
    rig.ticks(5, shaft_deg=10.0)
    maestro.errors, maestro.position = errors, 0  # the servo goes home
    feedback = rig.ticks(12, shaft_deg=10.0)
    assert maestro.position > 0
    assert feedback[-1].restarts == 0
    assert (rig.health().state, rig.health().text) == (DeviceState.RUNNING, text)


def test_missing_pulses_after_an_error_was_read_are_no_restart(rig, maestro):
    rig.ticks(5, shaft_deg=10.0)
    handle = maestro.handle

    def go_home(data):
        if data[-1] == GET_ERRORS:
            maestro.errors, maestro.position, maestro.handle = 2, 0, handle
        return handle(data)

    maestro.handle = go_home
    assert rig.ticks(25, shaft_deg=10.0)[-1].restarts == 0
    assert rig.health().text == "serial overrun"


def test_lost_and_foreign_bytes_have_no_lasting_effect(rig, line, maestro):
    rig.ticks(5, shaft_deg=10.0)
    line.lose_replies = 1
    rig.ticks(2, shaft_deg=10.0)
    line.noise = b"\xff\xff"
    rig.ticks(3, shaft_deg=10.0)
    assert rig.health().rejected > 0
    line.noise = b""
    feedback = rig.ticks(5, shaft_deg=-10.0)
    assert len(feedback) >= 4
    assert feedback[-1].restarts == 0
    assert maestro.position == round(4 * (1500 - 636.6 * math.radians(10.0)))


def test_silent_maestro_is_starting_and_a_wrong_baud_rate_gives_no_feedback(fakes):
    line = fakes.line()
    rig = fakes.rig(maestro_rudder(line, MaestroOptions()))
    assert rig.ticks(10) == []
    assert rig.health().state is DeviceState.STARTING
    assert rig.health().text == "no reply from Maestro"
    line.noise = b"\xf8\x00\xff"  # what another baud rate makes of a reply
    assert rig.ticks(20) == []
    assert (rig.health().state, rig.health().text) == (
        DeviceState.STARTING, "no position from the Maestro: wrong baud rate?",
    )  # fmt: skip


def test_line_that_was_opened_again_begins_with_a_search(rig, line):
    rig.ticks(3)
    line.unplug()
    rig.ticks(3)
    assert rig.health().state is DeviceState.ABSENT
    line.plug()
    line.written.clear()
    assert rig.ticks(3)[-1].restarts == 0  # the missing port is reported as such
    assert line.written[0] == bytes.fromhex("AA 0C 21")


def test_power_cut_together_with_the_port_is_no_restart(rig, line, maestro):
    rig.ticks(3, shaft_deg=10.0)
    line.unplug()
    maestro.cut_power()
    rig.ticks(3, shaft_deg=10.0)
    line.plug()
    maestro.powered = True
    assert rig.ticks(5, shaft_deg=10.0)[-1].restarts == 0


def test_position_from_before_the_line_was_reopened_is_not_used(rig, line, maestro):
    rig.ticks(3)
    handle = maestro.handle
    maestro.handle = lambda data: handle(data) if data[0] == POLOLU_PROTOCOL else b""
    line.plug()
    rig.ticks(2)
    assert rig.health().state is DeviceState.STARTING


def test_no_target_is_set_before_the_first_command(fakes, line, maestro):
    rudder = maestro_rudder(line, MaestroOptions())
    for tick in range(20):
        rudder.receive(0.1 * tick)
    assert set(maestro.commands) == {POLOLU_PROTOCOL, SET_SPEED, SET_ACCELERATION, GET_ERRORS}


def test_prompt_io_is_needed_while_the_target_waits(fakes):
    line = fakes.line()
    rudder = maestro_rudder(line, MaestroOptions())
    rudder.command(RudderCommand(0.1, torque_on=True), 1.0)
    assert rudder.needs_prompt_io()
    line.inbox += b"\0\0"
    rudder.receive(1.002)
    assert not rudder.needs_prompt_io()


def test_errors_are_read_late_in_a_tick_if_there_was_no_time_early(fakes, maestro):
    rudder = maestro_rudder(fakes.line(maestro), MaestroOptions())
    for tick in range(40):
        rudder.receive(1.098 + tick / 10)  # the reply of the tick
        rudder.command(RudderCommand(0.1, torque_on=True), 1.1 + tick / 10)
    assert 2 <= maestro.commands.count(GET_ERRORS) <= 4


def test_limited_pulse_is_reported(rig):
    rig.ticks(3, shaft_deg=60.0)
    assert rig.health().text == "pulse limited by min_us or max_us"


@pytest.mark.parametrize(
    ("name", "default", "limits"),
    [
        ("channel", 0, "0 to 23"),
        ("device", 12, "0 to 127"),
        ("speed", 0, "0 to 16383"),
        ("acceleration", 0, "0 to 255"),
    ],
)
def test_options_out_of_range_are_refused(name, default, limits):
    assert getattr(MaestroOptions(), name) == default
    for value in (-1, int(limits.split()[-1]) + 1):
        with pytest.raises(ValueError, match=f"{name}: .* allowed: {limits}$"):
            MaestroOptions(**{name: value})


@pytest.mark.parametrize(
    ("number", "is_accepted"), [(0, True), (255, False), (256, True), (13120, True), (13121, False), (65535, False)]
)
def test_position_that_no_channel_can_have_is_rejected(rig, maestro, number, is_accepted):
    rig.ticks(3)
    handle = maestro.handle
    maestro.handle = lambda data: handle(data) and (number.to_bytes(2, "little") if GET_POSITION in data else b"\0\0")
    rejected = rig.health().rejected
    feedback = rig.ticks(1)
    assert (len(feedback), rig.health().rejected - rejected) == ((1, 0) if is_accepted else (0, 1))


@pytest.mark.parametrize(("number", "is_accepted"), [(0x01FF, True), (0x0200, False)])
def test_error_register_has_nine_bits(fakes, number, is_accepted):
    device = FakeMaestro()
    device.errors = number
    rig = fakes.rig(maestro_rudder(fakes.line(device), MaestroOptions()))
    rig.ticks(1)
    assert (rig.health().rejected == 0) is is_accepted


def test_missing_pulses_after_a_lost_reply_are_no_restart(rig, line, maestro):
    """The zero may be a late reply to a request of the errors."""
    rig.ticks(5, shaft_deg=10.0)
    line.lose_replies = 1
    rig.ticks(1, shaft_deg=10.0)
    maestro.position = 0
    assert rig.ticks(5, shaft_deg=10.0)[-1].restarts == 0
    maestro.position = 0
    assert rig.ticks(3, shaft_deg=10.0)[-1].restarts == 1


def test_maestro_that_replies_only_to_requests_of_errors_is_silent(rig, maestro):
    rig.ticks(5)
    handle = maestro.handle
    maestro.handle = lambda data: b"" if GET_POSITION in data else handle(data)
    rig.ticks(17)
    assert rig.health().state is DeviceState.SILENT


@pytest.fixture
def conversation(fakes, maestro):
    return fakes.conversation(MaestroServo(MaestroOptions()), maestro)


def test_errors_are_read_every_second(conversation, maestro):
    for now_s, count in ((1.0, 1), (1.99, 1), (2.0, 2)):
        conversation.run(now_s)
        assert maestro.commands.count(GET_ERRORS) == count


def test_errors_are_read_early_in_a_tick_or_when_they_are_overdue(conversation):
    conversation.run(1.0)
    servo = conversation.servo
    for command_s in (1.5, 2.25):  # early until 2.625 s
        servo.command(0.1, command_s, torque_on=True)
    servo.note_sent(servo.next_request(2.25), 2.25)
    assert [servo.next_request(now_s) is not None for now_s in (2.625, 2.7, 2.874, 2.875)] == [True, False, False, True]


def test_error_is_reported_for_ten_seconds_and_a_position_is_recent_for_one_and_a_half(conversation, maestro):
    def state_and_text(now_s):
        conversation.servo.command(0.1, now_s, torque_on=True)
        return conversation.servo.condition(has_replied=True)

    maestro.errors = 2
    conversation.run(1.0)
    assert state_and_text(2.5) == (DeviceState.RUNNING, "serial overrun")
    assert state_and_text(2.51) == (DeviceState.SILENT, "no position from the Maestro: wrong baud rate?")
    conversation.run(10.0)
    assert state_and_text(11.0) == (DeviceState.RUNNING, "serial overrun")
    assert state_and_text(11.01) == (DeviceState.RUNNING, "")


def test_request_is_given_up_after_the_longest_exchange(fakes):
    line = fakes.line(baud=1_000_000)
    rudder = maestro_rudder(line, MaestroOptions())
    timeout_s = 0.016 + 16 * 10 / 1_000_000  # of a USB adapter, and of 16 bytes
    for now_s, count in ((0.0, 1), (timeout_s - 1e-6, 1), (timeout_s + 1e-6, 2)):
        rudder.command(RudderCommand(0.1, True), now_s)
        assert len(line.written) == count


@pytest.mark.parametrize(
    "options", [{}, {"crc": True}, {"device": 20}, {"speed": 20}, {"crc": True, "device": 20, "channel": 17}]
)
def test_driver_and_emulator_together(fakes, options):
    """The emulator has the same settings, and detects the baud rate."""
    shaft = ServoShaft(low_stop_rad=-2.0, high_stop_rad=2.0)
    settings = {name: value for name, value in options.items() if name != "speed"}
    emulator = MaestroEmulator(HobbyServo(shaft), detects_baud=True, **settings)
    line = fakes.line()
    rig = fakes.rig(maestro_rudder(line, MaestroOptions(**options)))

    def handle(data):
        shaft.advance(rig.now_s)
        emulator.receive(rig.now_s, data)
        return emulator.take_output(rig.now_s + 0.005)

    line.device = SimpleNamespace(handle=handle)
    rig.ticks(40, shaft_deg=20.0)
    assert math.degrees(shaft.angle_rad()) == pytest.approx(20.0, abs=0.1)
    assert (rig.health().state, rig.health().text, rig.health().rejected) == (DeviceState.RUNNING, "", 0)
    emulator.power_cycle(rig.now_s, off_s=1.0)
    feedback = rig.ticks(40, shaft_deg=-20.0)
    assert feedback[-1].restarts == 1
    assert math.degrees(shaft.angle_rad()) == pytest.approx(-20.0, abs=0.1)
