"""Corrections of a Dynamixel, its restarts, and its readings, at exact times."""

import pytest

from firmware_py.actuator import dynamixel_registers as table
from firmware_py.actuator.dynamixel import DynamixelOptions, DynamixelServo
from firmware_py.actuator.dynamixel_configuration import Kind, Request, RestartCounter, read_request
from firmware_py.actuator.dynamixel_readings import Readings
from firmware_py.common.records import DeviceState
from support.servo_registers import Dynamixel, DynamixelError, HardwareError

TORQUE, WATCHDOG = "torque enable", "bus watchdog"


@pytest.fixture
def servo(fakes):
    return fakes.dynamixel()


@pytest.fixture
def conversation(fakes, servo):
    return fakes.conversation(DynamixelServo(DynamixelOptions(), 0.04), servo)


@pytest.fixture
def corrections(conversation):
    """Function that runs the conversation at a time and returns the names of the registers that are written."""
    return lambda now_s: [request.name for request in conversation.run(now_s) if request.kind is Kind.CORRECT]


def test_failed_essential_correction_is_repeated_every_second(conversation, corrections, servo):
    servo.ignored_addresses.add(Dynamixel.TORQUE_ENABLE)
    assert corrections(1.0) == ["return delay", WATCHDOG, TORQUE, TORQUE, TORQUE]
    assert conversation.servo.condition(has_replied=True)[1] == "servo does not store torque enable"
    assert [corrections(now_s) for now_s in (1.99, 2.0, 2.99, 3.0)] == [[], [TORQUE], [], [TORQUE]]
    servo.ignored_addresses.clear()
    assert corrections(4.0) == [TORQUE]
    assert conversation.servo.condition(has_replied=True) == (DeviceState.RUNNING, "model 1170, firmware 47")


@pytest.mark.parametrize(
    ("times_s", "expected"), [((30.99, 60.99), [[], [WATCHDOG]]), ((31.0, 61.0), [[WATCHDOG]] * 2)]
)
def test_failed_optional_correction_is_repeated_every_thirty_seconds(corrections, servo, times_s, expected):
    servo.ignored_addresses.add(Dynamixel.BUS_WATCHDOG)
    assert corrections(1.0) == ["return delay", WATCHDOG, WATCHDOG, WATCHDOG, TORQUE]
    assert [corrections(now_s) for now_s in times_s] == expected


def test_failed_corrections_begin_again_on_a_reopened_line(conversation, corrections, servo):
    servo.ignored_addresses |= {Dynamixel.TORQUE_ENABLE, Dynamixel.BUS_WATCHDOG}
    for now_s in (1.0, 1.5):
        assert corrections(now_s)[-6:] == [WATCHDOG] * 3 + [TORQUE] * 3
        assert conversation.servo.condition(has_replied=True)[0] is DeviceState.FAULTY
        conversation.servo.restart()
        assert conversation.servo.condition(has_replied=True) == (DeviceState.STARTING, "model 1170, firmware 47")


def test_registers_from_before_a_correction_are_not_used(conversation, servo):
    """The reply to the read is late."""
    conversation.run(1.0)
    driver, read = conversation.servo, read_request(1, table.STATE)
    (late_reply,) = driver.parser.feed(servo.handle(read.frame))
    driver.command(0.1, 1.2, torque_on=False)
    correction = driver.next_request(1.2)
    driver.note_sent(correction, 1.2)
    (reply,) = driver.parser.feed(servo.handle(correction.frame))
    driver.process_reply(correction, reply, 1.2, is_certain=True)
    driver.process_reply(read, late_reply, 1.1, is_certain=True)
    assert (correction.name, driver.next_request(1.2).block) == (TORQUE, table.STATE)


def test_block_of_a_rejected_correction_is_read_again(conversation, servo):
    servo.registers[Dynamixel.OPERATING_MODE], servo.write_errors[Dynamixel.OPERATING_MODE] = 1, DynamixelError.ACCESS
    names = [request.name for request in conversation.run(1.0)]
    assert names[names.index("operating mode") + 1] == "settings"


def test_each_lost_goal_is_read_with_another_length(conversation):
    conversation.run(1.0)
    driver, lengths = conversation.servo, []
    for tick in range(1, 8):
        driver.command(0.1, 1.0 + 0.1 * tick, torque_on=True)
        request = driver.next_request(1.0 + 0.1 * tick)
        driver.note_sent(request, 1.0 + 0.1 * tick)
        driver.note_lost(request)
        lengths.append(request.parameters)
    assert lengths == [31, 35, 39, 43, 47, 83, 35]  # 83: with state and watchdog


@pytest.mark.parametrize(
    ("code", "text"),
    [(1, "result fail"), (2, "instruction error"), (3, "CRC error"), (4, "range error"), (5, "length error"),
     (6, "limit error"), (7, "access error"), (8, "error 8")],
)  # fmt: skip
def test_error_of_the_servo_is_named(conversation, servo, code, text):
    servo.write_errors[table.SETTINGS.address] = code
    conversation.run(1.0)
    assert conversation.servo.condition(has_replied=True)[1] == f"servo rejects settings: {text}"


@pytest.mark.parametrize(("pause_s", "is_read"), [(1.79, False), (1.81, True)])
def test_watchdog_is_read_before_the_goal_after_nine_tenths_of_its_time(conversation, pause_s, is_read):
    conversation.run(1.0)
    names = [request.name for request in conversation.run(1.0 + pause_s)]
    assert (names[0] == WATCHDOG) is is_read
    assert "goal position" in names


def test_reboots_after_three_seconds_and_then_every_thirty(conversation, servo):
    def reboots(now_s):
        return [request.kind for request in conversation.run(now_s)].count(Kind.REBOOT)

    conversation.run(1.0)
    servo.shut_down(HardwareError.OVERLOAD)
    assert [reboots(now_s) for now_s in (2.0, 4.99, 5.0)] == [0, 0, 1]
    conversation.run(6.0)
    servo.shut_down(HardwareError.OVERLOAD)
    assert [reboots(now_s) for now_s in (7.0, 34.99, 35.0)] == [0, 0, 1]
    conversation.run(65.0)
    servo.shut_down(HardwareError.OVERLOAD)
    assert [reboots(now_s) for now_s in (70.0, 72.99, 73.0)] == [0, 0, 1]


@pytest.mark.parametrize(
    ("request_sent", "restarts"),
    [
        (Request(Kind.CORRECT, b"", TORQUE), 0),
        (Request(Kind.REBOOT, b"", "reboot"), 0),
        (Request(Kind.CORRECT, b"", WATCHDOG), 1),
        (Request(Kind.READ, b"", TORQUE), 1),
    ],
)
def test_torque_that_the_driver_has_not_switched_off_is_a_restart(request_sent, restarts):
    counter, reading = RestartCounter(), read_request(1, table.STATE)
    counter.process_result(reading, b"\1" + bytes(6))
    counter.note_sent(request_sent)
    for _ in range(2):
        counter.process_result(reading, bytes(7))
    assert counter.count == restarts


def combined(device_id=1):
    return Request(Kind.GOAL, b"", "goal position", block=table.COMBINED)


@pytest.mark.parametrize(
    ("last_s", "combined_s", "is_due"), [(0.375, 0.125, True), (0.374, 0.125, False), (0.375, 0.126, False)]
)
def test_combined_read_every_half_second_if_half_a_period_is_long_enough(last_s, combined_s, is_due):
    readings = Readings(1, combined_s)
    readings.note_command(0.0)
    readings.note_sent(combined(), 0.0)
    readings.note_command(0.125)
    assert not readings.is_combined_due()
    readings.note_command(last_s)
    assert readings.is_combined_due() is is_due


def test_state_and_watchdog_alternate_every_quarter_second_and_later_if_there_is_no_time():
    readings = Readings(1, 0.04)
    for now_s in (-1.0, 0.0):
        readings.note_command(now_s)  # readings are early until 0.5 s
    names = []
    for now_s in (0.0, 0.0, 0.24, 0.25, 0.49, 0.5, 0.75, 2.49, 2.5, 2.99, 3.0, 3.25):
        request = readings.next_request(now_s)
        names.append(request and request.name)
        if request is not None:
            readings.note_sent(request, now_s)
    expected = ["telemetry", "state", None, WATCHDOG, None, "state", None, None, "telemetry", None, None, WATCHDOG]
    assert names == expected


@pytest.mark.parametrize("readings_before", [1, 2, 3])
def test_requested_state_is_the_next_slow_reading(readings_before):
    readings = Readings(1, 0.04)
    for now_s in (-1.0, 0.0):
        readings.note_command(now_s)
    for tick in range(readings_before):  # telemetry, state, watchdog
        readings.note_sent(readings.next_request(0.25 * tick), 0.25 * tick)
    readings.request_state()
    assert readings.next_request(0.5).name == "state"


def test_prompt_io_is_needed_for_the_goal_only_with_torque(conversation):
    driver = conversation.servo
    for now_s, torque_on in ((1.0, True), (1.1, True), (1.2, False), (1.3, False)):
        driver.command(0.1, now_s, torque_on=torque_on)
        assert driver.needs_prompt_io()
        conversation.run(now_s, torque_on=torque_on)
        assert not driver.needs_prompt_io()


@pytest.mark.parametrize(("losses", "is_due"), [(2, True), (3, False)])
def test_third_lost_combined_read_is_the_last(losses, is_due):
    readings = Readings(1, 0.04)
    for _ in range(2):
        readings.note_combined_lost()
    readings.split_combined(bytes(83))
    for _ in range(losses):
        readings.note_combined_lost()
    readings.note_command(1.0)
    assert readings.is_combined_due() is is_due
