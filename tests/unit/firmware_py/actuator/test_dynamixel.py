"""Dynamixel driver with a simulated servo: goals, configuration, faults and recovery."""

import math

import pytest

from firmware_py.actuator import dynamixel_frames as frames
from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.common.records import DeviceRole, DeviceState, RudderCommand
from support.servo_registers import Dynamixel, DynamixelError, HardwareError

COUNT_RAD = 2.0 * math.pi / 4096
# First addresses of the blocks that the driver reads.
SETTINGS, LIMITS, STATE = Dynamixel.BAUD_RATE, Dynamixel.MAX_POSITION, Dynamixel.TORQUE_ENABLE
WATCHDOG, TELEMETRY = Dynamixel.BUS_WATCHDOG, Dynamixel.PRESENT_CURRENT


@pytest.fixture
def servo(fakes):
    return fakes.dynamixel()


@pytest.fixture
def line(fakes, servo):
    return fakes.line(servo)


@pytest.fixture
def rig(fakes, line):
    return make_rig(fakes, line)


@pytest.fixture
def running(rig):
    """The rig after the configuration of the servo."""
    rig.ticks(5)
    return rig


def counts(shaft_deg):
    return 2048 + round(math.radians(shaft_deg) / COUNT_RAD)


def writes(line, address):
    codes = (frames.WRITE, frames.SYNC_WRITE)
    return [frame for frame in line.written if frame[7] in codes and int.from_bytes(frame[8:10], "little") == address]


def assert_follows(rig, ticks, shaft_deg):
    """Check that the servo reaches an angle within the ticks, with torque and watchdog; return the last feedback."""
    feedback = rig.ticks(ticks, shaft_deg=shaft_deg)
    servo = rig.servo
    assert servo.goal == counts(shaft_deg)
    assert (servo.registers[Dynamixel.TORQUE_ENABLE], servo.registers[Dynamixel.BUS_WATCHDOG]) == (1, 100)
    assert rig.health().state is DeviceState.RUNNING
    return feedback[-1]


def make_rig(fakes, line, **options):
    rig = fakes.rig(dynamixel_rudder(line, DynamixelOptions()), **options)
    rig.servo = line.device
    return rig


def test_goal_is_sent_and_feedback_returned_within_five_ticks(rig, servo):
    last = assert_follows(rig, 5, 20.0)
    assert last.shaft_rad == pytest.approx((servo.goal - 2048) * COUNT_RAD)
    assert last.temperature_c == 31.0
    assert last.voltage_v == pytest.approx(12.1)
    assert last.current_a == pytest.approx(-0.0269)
    assert (last.hardware_error, last.torque_on) == (0, True)
    health = rig.health()
    assert (health.role, health.state, health.rejected) == (DeviceRole.RUDDER, DeviceState.RUNNING, 0)
    assert health.accepted > 10
    assert health.text == "model 1170, firmware 47"


def test_first_goal_is_sent_in_the_first_tick_if_replies_are_read(rig, line):
    rig.slack = 12
    rig.ticks(1, shaft_deg=1.0)
    assert writes(line, Dynamixel.GOAL_POSITION)
    assert line.written.index(writes(line, Dynamixel.TORQUE_ENABLE)[0]) < line.written.index(
        writes(line, Dynamixel.GOAL_POSITION)[0]
    )


def test_eeprom_is_written_only_if_different_and_with_torque_off(rig, servo):
    servo.registers[Dynamixel.OPERATING_MODE] = 1  # speed mode
    servo.registers[Dynamixel.DRIVE_MODE] = 0x0D  # reversed, time based, torque on by goal
    servo.registers[Dynamixel.TORQUE_ENABLE] = 1
    assert_follows(rig, 8, 5.0)
    assert sorted(servo.eeprom_writes) == [
        (Dynamixel.RETURN_DELAY, 0, 0),
        (Dynamixel.DRIVE_MODE, 0x01, 0),
        (Dynamixel.OPERATING_MODE, 3, 0),
    ]


def test_configured_servo_keeps_its_torque(rig, servo, line):
    servo.registers[Dynamixel.RETURN_DELAY] = 0
    servo.registers[Dynamixel.TORQUE_ENABLE] = 1
    servo.registers[Dynamixel.BUS_WATCHDOG] = 100
    rig.ticks(4)
    assert servo.eeprom_writes == []
    assert {address for address, _ in servo.ram_writes} == {Dynamixel.GOAL_POSITION}


def test_nothing_is_written_before_the_first_command(fakes, servo, line):
    rudder = dynamixel_rudder(line, DynamixelOptions())
    for tick in range(100):
        rudder.receive(0.02 * tick)
    assert {frame[7] for frame in line.written} == {frames.PING, frames.READ}
    assert len(rudder.poll()) > 3
    assert rudder.health(2.0).state is DeviceState.RUNNING
    assert len(line.written) < 40
    rig = fakes.rig(rudder)
    rig.now_s = 2.0
    rig.ticks(3, shaft_deg=1.0)
    assert servo.eeprom_writes == [(Dynamixel.RETURN_DELAY, 0, 0)]
    assert servo.goal != 2048


@pytest.mark.parametrize("period_s", [1.0, 0.1, 0.05, 0.02])
def test_goal_is_the_first_frame_of_every_tick(fakes, line, servo, period_s):
    rig = make_rig(fakes, line, period_s=period_s, slack=9)
    rig.ticks(5)
    servo.reads.clear()
    for _ in range(200):
        line.written.clear()
        rig.ticks(1)
        assert line.written[:1] == writes(line, Dynamixel.GOAL_POSITION)
        assert len(line.written) <= 2
    separate_reads = 0 if period_s >= 0.1 else servo.reads.count(STATE)  # the combined read needs half a period
    assert len(servo.reads) - separate_reads - servo.reads.count(WATCHDOG) >= 199
    assert servo.reads.count(STATE) >= 200 * min(period_s, 0.5)  # twice a second, or every second tick
    assert (servo.reads.count(WATCHDOG) > 0) is (separate_reads > 0)


@pytest.mark.parametrize(("ticks", "first_address"), [(6, STATE), (7, Dynamixel.GOAL_POSITION)])
def test_tick_is_one_write_and_one_reply_with_the_accepted_goal(rig, line, servo, ticks, first_address):
    rig.ticks(ticks)
    rig.slack = 0
    line.written.clear()
    servo.reads.clear()
    accepted = rig.health().accepted
    rig.rudder.command(RudderCommand(0.2, True), rig.now_s)
    assert servo.goal == 2048 + round(0.2 / COUNT_RAD)
    assert (len(line.written), servo.reads) == (1, [first_address])
    assert not rig.rudder.needs_prompt_io()  # the reply may be read in the next tick
    rig.rudder.receive(rig.now_s + 0.099)
    (feedback,) = rig.rudder.poll()
    assert feedback.t_s == rig.now_s  # the time of the request
    assert feedback.shaft_rad == pytest.approx(0.2, abs=COUNT_RAD)
    assert rig.health().accepted == accepted + 1


@pytest.mark.parametrize("error", [DynamixelError.RANGE, None])
def test_servo_that_rejects_the_combined_read_gets_separate_reads(rig, servo, error):
    servo.max_read, servo.read_error = 60, error
    rig.ticks(60)
    assert rig.health().state is DeviceState.RUNNING
    servo.reads.clear()
    before = rig.health().rejected
    feedback = rig.ticks(40)
    assert len(feedback) == 40
    assert rig.health().rejected == before
    assert servo.reads.count(STATE) >= 6
    assert servo.reads.count(WATCHDOG) >= 6


@pytest.mark.parametrize(("baud", "undisturbed_ticks"), [(57600, 30), (9600, 20)])
def test_prompt_io_is_needed_while_another_request_is_due(fakes, line, servo, baud, undisturbed_ticks):
    line.baud = baud
    rig = make_rig(fakes, line)
    assert not rig.rudder.needs_prompt_io()
    rig.rudder.command(RudderCommand(0.0, True), 0.0)
    prompt_ticks = []
    for tick in range(40):
        rig.rudder.receive(rig.now_s)
        rig.rudder.command(RudderCommand(0.0, True), rig.now_s)
        while rig.rudder.needs_prompt_io():  # the loop reads each reply at once
            prompt_ticks.append(tick)
            assert prompt_ticks.count(tick) < 50
            rig.now_s += 0.001
            rig.rudder.receive(rig.now_s)
        rig.now_s = 0.1 * (tick + 1)
    assert prompt_ticks.count(0) > 8  # the servo is configured in the first tick
    undisturbed = [tick for tick in range(10, 40) if tick not in prompt_ticks]
    # On a slow bus, state and watchdog are read separately, in every third tick.
    assert len(undisturbed) == pytest.approx(undisturbed_ticks, abs=1)
    servo.registers[Dynamixel.TORQUE_ENABLE] = 0
    rig.ticks(4)
    assert servo.registers[Dynamixel.TORQUE_ENABLE] == 1
    line.written.clear()
    servo.write_errors[Dynamixel.GOAL_POSITION] = DynamixelError.ACCESS
    rig.rudder.command(RudderCommand(0.1, True), rig.now_s)
    rig.rudder.receive(rig.now_s)
    assert rig.rudder.needs_prompt_io()  # the cause of the rejection is read


def test_goals_are_sent_if_replies_are_read_only_at_ticks(rig, line):
    rig.slack = 0
    rig.ticks(30)
    line.written.clear()
    feedback = rig.ticks(60)
    # An overdue reading delays every third or fourth goal by one tick.
    assert len(writes(line, Dynamixel.GOAL_POSITION)) >= 40
    assert len(feedback) >= 8


def test_goal_is_limited_to_the_position_limits(rig, servo):
    servo.put(Dynamixel.MAX_POSITION, 2600, 4)
    servo.put(Dynamixel.MIN_POSITION, 1500, 4)
    rig.ticks(4, shaft_deg=90.0)
    assert servo.goal == 2600
    assert rig.health().text == "goal at a position limit of the servo"
    rig.ticks(2, shaft_deg=-90.0)
    assert servo.goal == 1500
    rig.ticks(2, shaft_deg=45.0)
    assert rig.health().text.startswith("model")
    servo.put(Dynamixel.MAX_POSITION, 2100, 4)  # changed limits are read after a rejected goal
    rig.ticks(3, shaft_deg=60.0)
    assert servo.goal == 2100
    assert rig.health().state is DeviceState.RUNNING


@pytest.mark.parametrize(("shaft_rad", "counts"), [(1e300, 4095), (-1e300, 0), (math.pi, 4095), (-math.pi, 0)])
def test_goal_is_limited_to_one_turn(rig, servo, shaft_rad, counts):
    rig.ticks(3)
    rig.rudder.command(RudderCommand(shaft_rad, True), rig.now_s)
    assert servo.goal == counts


def test_torque_follows_the_command(running, servo, line):
    line.written.clear()
    servo.reads.clear()
    feedback = running.ticks(1, torque_on=False)
    assert (servo.registers[Dynamixel.TORQUE_ENABLE], feedback[-1].torque_on) == (0, False)
    assert [frame[7] for frame in line.written].count(frames.WRITE) == 1
    assert set(servo.reads) <= {STATE, WATCHDOG, TELEMETRY}
    line.written.clear()
    last = running.ticks(3, torque_on=False, shaft_deg=30.0)[-1]
    assert (last.torque_on, last.restarts) == (False, 0)
    assert not writes(line, Dynamixel.GOAL_POSITION)
    assert_follows(running, 3, 30.0)
    running.slack = 20
    for _ in range(6):
        for torque_on in (False, True):
            running.ticks(1, torque_on=torque_on)
            assert servo.registers[Dynamixel.TORQUE_ENABLE] == torque_on


@pytest.mark.parametrize("silent_ticks", [8, 200])
def test_servo_is_configured_again_after_a_long_power_loss(running, servo, line, silent_ticks):
    servo.powered = False
    assert running.ticks(silent_ticks) == []
    assert running.health().state is DeviceState.SILENT
    assert writes(line, Dynamixel.GOAL_POSITION)
    servo.restart()
    servo.powered = True
    assert assert_follows(running, 5, -12.0).torque_on is True
    running.ticks(15)
    servo.reads.clear()
    running.ticks(40)
    assert (servo.reads.count(STATE) >= 6, servo.reads.count(WATCHDOG)) == (True, 0)  # the combined read


def test_short_power_loss_is_detected_and_configured_again(running, servo):
    servo.restart()
    assert_follows(running, 12, 7.0)


def test_goal_is_sent_during_silence(running, servo, line):
    line.lose_replies = 10**6  # the servo receives, but its replies are lost
    running.ticks(12)
    running.ticks(4, shaft_deg=25.0)
    assert servo.goal == counts(25.0)
    assert running.health().state is DeviceState.SILENT
    line.lose_replies = 0
    assert_follows(running, 4, 25.0)


@pytest.mark.parametrize("period_s", [0.1, 0.02])
def test_one_lost_reply_changes_nothing(fakes, servo, line, period_s):
    line.baud = 1_000_000  # the reply timeout ends before the next tick
    rig = make_rig(fakes, line, period_s=period_s)
    rig.ticks(5)
    for number in range(1, 40):
        line.lose_replies = 1
        feedback = rig.ticks(2, shaft_deg=3.0)
        line.written.clear()
        feedback += rig.ticks(number % 3 + 1, shaft_deg=3.0)
        assert line.written[:1] == writes(line, Dynamixel.GOAL_POSITION)[:1]
        assert feedback
        assert rig.health().state is DeviceState.RUNNING


def test_lost_reading_does_not_delay_the_goal(fakes, servo, line):
    line.baud = 1_000_000
    rig = make_rig(fakes, line, period_s=0.02)
    rig.ticks(10)
    for _ in range(60):
        line.written.clear()
        rig.rudder.receive(rig.now_s)
        rig.rudder.command(RudderCommand(0.1, True), rig.now_s)
        assert line.written[:1] == writes(line, Dynamixel.GOAL_POSITION)
        line.lose_replies = 1  # the reply to the reading after the goal
        for step in range(1, 7):
            rig.rudder.receive(rig.now_s + 0.002 * step)
        line.lose_replies = 0
        rig.now_s += 0.02
    assert servo.reads.count(STATE) > 3


def test_write_with_a_lost_reply_is_not_repeated(rig, servo):
    servo.lost_replies = [Dynamixel.RETURN_DELAY]
    rig.ticks(15)
    assert rig.health().state is DeviceState.RUNNING
    assert [address for address, *_ in servo.eeprom_writes] == [Dynamixel.RETURN_DELAY]


def test_watchdog_trip_is_cleared_without_switching_the_torque(running, servo):
    servo.trip_watchdog()
    assert_follows(running, 3, 15.0)
    assert servo.ram_writes.count((Dynamixel.BUS_WATCHDOG, 0)) == 1
    assert (Dynamixel.TORQUE_ENABLE, 0) not in servo.ram_writes  # the watchdog is in the RAM


@pytest.mark.parametrize("ticks", range(6, 12))
def test_watchdog_is_read_before_the_first_goal_after_a_pause(rig, servo, ticks):
    # The servo already has this goal, so its register does not show that the goal was rejected.
    rig.ticks(ticks, shaft_deg=15.0)
    goal = servo.position
    servo.position = 2048
    servo.trip_watchdog()
    servo.reads.clear()
    rig.now_s += 2.0
    rig.slack = 12
    rig.ticks(1, shaft_deg=15.0)
    assert servo.reads[0] == WATCHDOG
    assert servo.registers[Dynamixel.BUS_WATCHDOG] == 100
    assert servo.position == goal


@pytest.mark.parametrize("period_s", [1.0, 0.1])
def test_watchdog_is_read_at_its_interval_while_goals_are_sent(fakes, line, servo, period_s):
    rig = make_rig(fakes, line, period_s=period_s)
    rig.ticks(20)
    servo.reads.clear()
    rig.ticks(60)
    assert servo.reads.count(WATCHDOG) <= 60 * min(1.0, period_s / 0.5) + 1


@pytest.mark.parametrize(
    ("error", "name"),
    [
        (HardwareError.OVERLOAD, "overload"),
        (HardwareError.INPUT_VOLTAGE, "input voltage"),
        (HardwareError.ELECTRICAL_SHOCK, "electrical shock"),
    ],
)
def test_shutdown_is_reported_and_rebooted(running, servo, line, error, name):
    servo.shut_down(error)
    feedback = running.ticks(8, shaft_deg=9.0)
    assert (feedback[-1].hardware_error, feedback[-1].torque_on) == (error, False)
    health = running.health()
    assert (health.state, health.text) == (DeviceState.FAULTY, f"servo error: {name}, torque cut")
    assert (servo.reboots, servo.ram_writes.count((Dynamixel.TORQUE_ENABLE, 1))) == (0, 1)
    assert_follows(running, 30, 9.0)
    assert (servo.reboots, running.health().rejected) == (1, health.rejected)
    reboot = [frame[7] for frame in line.written].index(frames.REBOOT)
    assert line.written[reboot + 1] == frames.read(1, SETTINGS, 6)  # all registers are read again


@pytest.mark.parametrize("max_read", [255, 60])  # 60: without the combined read
@pytest.mark.parametrize("extra_ticks", range(6))
def test_hardware_error_is_reported_within_four_ticks(running, servo, extra_ticks, max_read):
    servo.max_read = max_read
    running.ticks(20 + extra_ticks)
    servo.shut_down(HardwareError.OVERLOAD)
    running.ticks(4)
    assert running.health().state is DeviceState.FAULTY


def test_error_is_discarded_when_the_line_is_reopened(running, servo, line):
    servo.shut_down(HardwareError.OVERLOAD)
    running.ticks(8)
    line.unplug()
    servo.powered = False
    running.ticks(1)
    line.plug()
    running.ticks(1)
    assert (running.health().state, running.health().text) == (DeviceState.STARTING, "model 1170, firmware 47")


def test_torque_is_not_requested_again_after_a_hardware_error(rig, servo):
    rig.ticks(6, torque_on=False)
    servo.shut_down(HardwareError.OVERLOAD)
    rig.ticks(6)
    assert servo.ram_writes.count((Dynamixel.TORQUE_ENABLE, 1)) == 1


def test_overheated_servo_is_rebooted_when_it_is_cool(running, servo):
    servo.shut_down(HardwareError.OVERHEATING)
    servo.registers[Dynamixel.PRESENT_TEMPERATURE] = 61
    running.ticks(100)
    assert servo.reboots == 0
    servo.registers[Dynamixel.PRESENT_TEMPERATURE] = 60
    running.ticks(3)
    assert servo.reboots == 1


def test_hot_servo_with_another_error_is_rebooted(running, servo):
    servo.shut_down(HardwareError.INPUT_VOLTAGE)
    servo.registers[Dynamixel.PRESENT_TEMPERATURE] = 78
    running.ticks(38)
    assert servo.reboots == 1


def test_error_with_torque_on_is_reported_and_the_servo_can_be_released(running, servo):
    servo.registers[Dynamixel.HARDWARE_ERROR] = HardwareError.INPUT_VOLTAGE
    feedback = running.ticks(60, shaft_deg=6.0)
    assert (servo.reboots, servo.goal, feedback[-1].torque_on) == (0, counts(6.0), True)
    assert (running.health().state, running.health().text) == (DeviceState.FAULTY, "servo error: input voltage")
    running.ticks(3, torque_on=False)
    assert servo.registers[Dynamixel.TORQUE_ENABLE] == 0


def test_servo_without_a_watchdog_is_used(rig, servo):
    servo.write_errors[Dynamixel.BUS_WATCHDOG] = DynamixelError.ACCESS
    rig.ticks(6, shaft_deg=11.0)
    assert servo.goal == counts(11.0)
    health = rig.health()
    assert (health.state, health.text) == (DeviceState.RUNNING, "servo rejects bus watchdog: access error")
    assert health.rejected == 3  # attempts to read it


def test_eeprom_setting_without_effect_is_written_three_times(rig, servo):
    servo.ignored_addresses.add(Dynamixel.RETURN_DELAY)
    rig.ticks(400, shaft_deg=1.0)
    assert len(servo.eeprom_writes) == 3
    assert (Dynamixel.TORQUE_ENABLE, 0) not in servo.ram_writes  # the torque stays on
    assert rig.health().text == "servo does not store return delay"
    assert servo.goal != 2048


def test_values_out_of_range_are_rejected_separately(rig, servo):
    rig.ticks(4)
    rejected = rig.health().rejected
    servo.put(Dynamixel.PRESENT_VOLTAGE, 9000, 2)
    feedback = rig.ticks(1)
    assert feedback[-1].voltage_v is None
    assert feedback[-1].shaft_rad is not None
    servo.position = 0x7FFFFFFF
    feedback = rig.ticks(1, torque_on=False)
    assert feedback[-1].shaft_rad is None
    assert rig.health().rejected == rejected + 3


def test_replies_of_another_servo_and_without_a_request_are_rejected(rig, line, fakes):
    rig.ticks(4)
    accepted = rig.health().accepted
    line.inbox += fakes.status_frame(2, 0) + fakes.status_frame(1, 0, bytes(21))
    rig.rudder.receive(rig.now_s)
    assert rig.health().accepted == accepted
    assert rig.health().rejected == 2
    assert rig.rudder.poll() == ()


@pytest.mark.parametrize(
    ("error", "torque_on", "text"),
    [
        (HardwareError.OVERLOAD, False, "servo error: overload, torque cut"),
        (HardwareError.ENCODER | HardwareError.OVERLOAD, True, "servo error: encoder, overload, torque cut"),
    ],
)
def test_no_reboot_without_a_torque_command_or_after_an_encoder_error(running, servo, error, torque_on, text):
    servo.shut_down(error)
    running.ticks(60, torque_on=torque_on)
    assert (servo.reboots, running.health().text) == (0, text)


def test_third_rejected_goal_is_a_fault(rig, servo, line):
    servo.write_errors[Dynamixel.GOAL_POSITION] = DynamixelError.ACCESS
    while rig.health().state is not DeviceState.FAULTY:
        assert len(writes(line, Dynamixel.GOAL_POSITION)) < 3
        rig.ticks(1, shaft_deg=5.0)
    assert len(writes(line, Dynamixel.GOAL_POSITION)) == 3


@pytest.mark.parametrize(
    ("address", "text"),
    [
        (SETTINGS, "servo rejects settings: access error"),
        (Dynamixel.OPERATING_MODE, "servo rejects operating mode: access error"),
        (LIMITS, "servo rejects position limits: access error"),
        (STATE, "servo rejects state: access error"),
        (Dynamixel.GOAL_POSITION, "servo rejects goal position"),
    ],
)
def test_rejected_essential_instruction_is_a_fault_until_it_succeeds(rig, servo, address, text):
    servo.registers[Dynamixel.OPERATING_MODE] = 1  # the operating mode needs a correction
    servo.write_errors[address] = DynamixelError.ACCESS
    rig.ticks(10)
    assert (rig.health().state, rig.health().text) == (DeviceState.FAULTY, text)
    servo.write_errors.clear()
    assert_follows(rig, 20, 5.0)
    assert rig.health().text.startswith("model")
    assert not rig.rudder.needs_prompt_io()
