"""The Dynamixel driver against a small servo."""

import math

import pytest

from firmware_py.actuator import dynamixel_frames as frames
from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.common.records import DeviceRole, DeviceState, RudderCommand

COUNT_RAD = 2.0 * math.pi / 4096


@pytest.fixture
def servo(fakes):
    return fakes.dynamixel()


@pytest.fixture
def line(fakes, servo):
    return fakes.line(servo)


@pytest.fixture
def sail(fakes, line):
    return fakes.sail(dynamixel_rudder(line, DynamixelOptions()))


def writes(line, address):
    kinds = (frames.WRITE, frames.SYNC_WRITE)
    return [f for f in line.written if f[7] in kinds and int.from_bytes(f[8:10], "little") == address]


def test_steers_within_a_second_of_ticks(sail, servo, line):
    feedback = sail.ticks(5, shaft_deg=20.0)
    expected = 2048 + round(math.radians(20.0) / COUNT_RAD)
    assert servo.goal == expected
    last = feedback[-1]
    assert last.shaft_rad == pytest.approx((expected - 2048) * COUNT_RAD)
    assert last.temperature_c == 31.0
    assert last.voltage_v == pytest.approx(12.1)
    assert last.current_a == pytest.approx(-0.0269)
    assert (last.hardware_error, last.torque_on) == (0, True)
    health = sail.health()
    assert (health.role, health.state, health.rejected) == (DeviceRole.RUDDER, DeviceState.RUNNING, 0)
    assert health.accepted > 10
    assert health.text == "model 1170, firmware 47"


def test_first_goal_comes_in_the_first_tick_when_bytes_are_served(sail, line):
    sail.slack = 12
    sail.ticks(1, shaft_deg=1.0)
    assert writes(line, 116)
    assert line.written.index(writes(line, 64)[0]) < line.written.index(writes(line, 116)[0])


def test_eeprom_is_written_only_when_different_and_with_torque_off(sail, servo):
    servo.registers[11] = 1  # speed mode
    servo.registers[10] = 0x0D  # reversed, time based, torque on by goal
    servo.registers[64] = 1
    sail.ticks(8, shaft_deg=5.0)
    assert sorted(servo.eeprom_writes) == [(9, 0, 0), (10, 0x01, 0), (11, 3, 0)]
    assert servo.registers[64] == 1
    assert sail.health().state is DeviceState.RUNNING


def test_a_servo_already_set_up_keeps_its_torque(sail, servo, line):
    servo.registers[9] = 0
    servo.registers[64] = 1
    servo.registers[98] = 100
    sail.ticks(4)
    assert servo.eeprom_writes == []
    assert {address for address, _ in servo.ram_writes} == {116}


def test_nothing_is_written_before_the_first_command(fakes, servo, line):
    rudder = dynamixel_rudder(line, DynamixelOptions())
    for tick in range(100):
        rudder.receive(0.02 * tick)
    assert {frame[7] for frame in line.written} == {frames.PING, frames.READ}
    assert len(rudder.poll()) > 3
    assert rudder.health(2.0).state is DeviceState.RUNNING
    assert len(line.written) < 40  # and it does not read as fast as it can
    sail = fakes.sail(rudder)
    sail.now_s = 2.0
    sail.ticks(3, shaft_deg=1.0)
    assert servo.eeprom_writes == [(9, 0, 0)]
    assert servo.goal != 2048


@pytest.mark.parametrize("period_s", [1.0, 0.1, 0.05, 0.02])
def test_the_goal_is_the_first_frame_of_every_tick(fakes, line, servo, period_s):
    sail = fakes.sail(dynamixel_rudder(line, DynamixelOptions()), period_s=period_s, slack=9)
    sail.ticks(5)
    servo.reads.clear()
    for _ in range(200):
        line.written.clear()
        sail.ticks(1)
        assert line.written[:1] == writes(line, 116)
        assert len(line.written) <= 2
    alone = 0 if period_s >= 0.1 else servo.reads.count(64)  # half a period is too short to ask for all at once
    assert len(servo.reads) - alone - servo.reads.count(98) >= 199
    assert servo.reads.count(64) >= 200 * min(period_s, 0.5)  # the state: about twice a second, or every other tick
    assert (servo.reads.count(98) > 0) is (alone > 0)


@pytest.mark.parametrize(("ticks", "first"), [(6, 64), (7, 116)])
def test_a_tick_is_one_write_and_one_reply_that_shows_whether_the_goal_was_accepted(sail, line, servo, ticks, first):
    sail.ticks(ticks)
    sail.slack = 0
    line.written.clear()
    servo.reads.clear()
    accepted = sail.health().accepted
    sail.rudder.command(RudderCommand(0.2, True), sail.now_s)
    assert servo.goal == 2048 + round(0.2 / COUNT_RAD)
    assert (len(line.written), servo.reads) == (1, [first])
    assert not sail.rudder.needs_prompt_io()  # the answer may wait for the next tick
    sail.rudder.receive(sail.now_s + 0.099)
    (feedback,) = sail.rudder.poll()
    assert feedback.t_s == sail.now_s  # when it was asked, not when it was read
    assert feedback.shaft_rad == pytest.approx(0.2, abs=COUNT_RAD)
    assert sail.health().accepted == accepted + 1


@pytest.mark.parametrize("answer", [4, None])
def test_a_servo_without_replies_to_the_combined_read_gets_separate_reads(sail, servo, answer):
    servo.longest_read, servo.too_long = 60, answer  # an error, or silence
    sail.ticks(60)
    assert sail.health().state is DeviceState.RUNNING
    servo.reads.clear()
    before = sail.health().rejected
    feedback = sail.ticks(40)
    assert len(feedback) == 40
    assert sail.health().rejected == before
    assert servo.reads.count(64) >= 6  # and the state is known
    assert servo.reads.count(98) >= 6


@pytest.mark.parametrize(("baud", "calm_ticks"), [(57600, 30), (9600, 20)])
def test_an_answer_is_waited_for_while_something_is_to_follow_it(fakes, line, servo, baud, calm_ticks):
    line.baud = baud
    sail = fakes.sail(dynamixel_rudder(line, DynamixelOptions()))
    assert not sail.rudder.needs_prompt_io()  # nothing has been asked
    sail.rudder.command(RudderCommand(0.0, True), 0.0)
    hurried = []
    for tick in range(40):
        sail.rudder.receive(sail.now_s)
        sail.rudder.command(RudderCommand(0.0, True), sail.now_s)
        while sail.rudder.needs_prompt_io():  # as the loop does: woken by the answer
            hurried.append(tick)
            sail.now_s += 0.001
            sail.rudder.receive(sail.now_s)
        sail.now_s = 0.1 * (tick + 1)
    assert hurried.count(0) > 8  # found and set up in the first tick
    calm = [tick for tick in range(10, 40) if tick not in hurried]
    # On a slow bus state and watchdog are read by themselves, in every third tick.
    assert len(calm) == pytest.approx(calm_ticks, abs=1)
    servo.registers[64] = 0
    sail.ticks(4)
    assert servo.registers[64] == 1
    line.written.clear()
    servo.refuse[116] = 7
    sail.rudder.command(RudderCommand(0.1, True), sail.now_s)
    sail.rudder.receive(sail.now_s)
    assert sail.rudder.needs_prompt_io()  # why it was not taken is being read


def test_a_bus_served_at_ticks_only_still_steers(sail, line):
    sail.slack = 0
    sail.ticks(30)
    line.written.clear()
    feedback = sail.ticks(60)
    # Every third or fourth goal waits one tick for a reading that was overdue.
    assert len(writes(line, 116)) >= 40
    assert len(feedback) >= 8


def test_goal_is_clipped_to_the_servos_limits(sail, servo):
    servo.put(48, 2600, 4)
    servo.put(52, 1500, 4)
    sail.ticks(4, shaft_deg=90.0)
    assert servo.goal == 2600
    assert sail.health().text == "goal at a position limit of the servo"
    sail.ticks(2, shaft_deg=-90.0)
    assert servo.goal == 1500
    sail.ticks(2, shaft_deg=45.0)
    assert sail.health().text.startswith("model")


@pytest.mark.parametrize(("shaft_rad", "counts"), [(1e300, 4095), (-1e300, 0), (math.pi, 4095), (-math.pi, 0)])
def test_goal_is_never_outside_the_turn(sail, servo, shaft_rad, counts):
    sail.ticks(3)
    sail.rudder.command(RudderCommand(shaft_rad, True), sail.now_s)
    assert servo.goal == counts


def test_torque_follows_the_command(sail, servo, line):
    sail.ticks(3)
    feedback = sail.ticks(3, torque_on=False)
    assert servo.registers[64] == 0
    assert feedback[-1].torque_on is False
    line.written.clear()
    sail.ticks(3, torque_on=False, shaft_deg=30.0)
    assert not writes(line, 116)
    sail.ticks(3, shaft_deg=30.0)
    assert servo.registers[64] == 1
    assert servo.goal == 2048 + round(math.radians(30.0) / COUNT_RAD)


def test_long_power_loss_is_configured_again(sail, servo, line):
    sail.ticks(5)
    servo.powered = False
    assert sail.ticks(8) == []
    assert sail.health().state is DeviceState.SILENT
    assert writes(line, 116)
    servo.restart()
    servo.powered = True
    feedback = sail.ticks(5, shaft_deg=-12.0)
    assert sail.health().state is DeviceState.RUNNING
    assert servo.registers[64] == 1
    assert servo.registers[98] == 100
    assert servo.goal == 2048 + round(math.radians(-12.0) / COUNT_RAD)
    assert feedback[-1].torque_on is True


def test_after_a_long_absence_the_combined_read_is_used_again(sail, servo):
    sail.ticks(5)
    servo.powered = False
    sail.ticks(200)
    servo.restart()
    servo.powered = True
    sail.ticks(20)
    servo.reads.clear()
    sail.ticks(40)
    assert (servo.reads.count(64) >= 6, servo.reads.count(98)) == (True, 0)


def test_short_power_loss_between_two_exchanges_is_seen(sail, servo):
    sail.ticks(5)
    servo.restart()
    sail.ticks(12, shaft_deg=7.0)
    assert servo.registers[64] == 1
    assert servo.registers[98] == 100
    assert servo.goal == 2048 + round(math.radians(7.0) / COUNT_RAD)


def test_torque_can_be_switched_as_often_as_one_likes(sail, servo):
    sail.slack = 20
    for _ in range(6):
        sail.ticks(1, torque_on=False)
        assert servo.registers[64] == 0
        sail.ticks(1)
        assert servo.registers[64] == 1


def test_releasing_touches_the_torque_only(sail, servo, line):
    sail.ticks(5)
    line.written.clear()
    servo.reads.clear()
    sail.ticks(1, torque_on=False)
    assert [frame[7] for frame in line.written].count(frames.WRITE) == 1
    assert set(servo.reads) <= {64, 98, 126}


def test_in_silence_the_goal_still_goes_out(sail, servo, line):
    sail.ticks(5)
    line.lose_replies = 10**6  # the answers are lost, the servo hears
    sail.ticks(12)
    sail.ticks(4, shaft_deg=25.0)
    assert servo.goal == 2048 + round(math.radians(25.0) / COUNT_RAD)
    assert sail.health().state is DeviceState.SILENT
    line.lose_replies = 0
    sail.ticks(4)
    assert sail.health().state is DeviceState.RUNNING


@pytest.mark.parametrize("period_s", [0.1, 0.02])
def test_one_lost_reply_changes_nothing(fakes, servo, line, period_s):
    line.baud = 1_000_000  # the wait for it is over before the next tick
    sail = fakes.sail(dynamixel_rudder(line, DynamixelOptions()), period_s=period_s)
    sail.ticks(5)
    for number in range(1, 40):
        line.lose_replies = 1
        feedback = sail.ticks(2, shaft_deg=3.0)
        line.written.clear()
        feedback += sail.ticks(number % 3 + 1, shaft_deg=3.0)
        assert line.written[:1] == writes(line, 116)[:1]  # the goal waits for nothing
        assert feedback
        assert sail.health().state is DeviceState.RUNNING


def test_the_goal_does_not_wait_for_a_lost_reading(fakes, servo, line):
    line.baud = 1_000_000
    sail = fakes.sail(dynamixel_rudder(line, DynamixelOptions()), period_s=0.02)
    sail.ticks(10)
    for _ in range(60):
        line.written.clear()
        sail.rudder.receive(sail.now_s)
        sail.rudder.command(RudderCommand(0.1, True), sail.now_s)
        assert line.written[:1] == writes(line, 116)
        line.lose_replies = 1  # of what is asked for after it
        for step in range(1, 7):
            sail.rudder.receive(sail.now_s + 0.002 * step)
        line.lose_replies = 0
        sail.now_s += 0.02
    assert servo.reads.count(64) > 3


def test_a_write_whose_answer_is_lost_is_not_repeated(sail, servo):
    servo.unheard = [9]
    sail.ticks(15)
    assert sail.health().state is DeviceState.RUNNING
    assert [address for address, *_ in servo.eeprom_writes] == [9]


def test_a_line_that_takes_nothing_is_tried_again(sail, line, servo):
    line.full = True
    sail.ticks(3)
    line.full = False
    sail.ticks(4, shaft_deg=4.0)
    assert sail.health().state is DeviceState.RUNNING


def test_watchdog_trip_is_cleared(sail, servo):
    sail.ticks(5)
    servo.trip_watchdog()
    sail.ticks(3, shaft_deg=15.0)
    assert servo.registers[98] == 100
    assert servo.ram_writes.count((98, 0)) == 1
    assert (64, 0) not in servo.ram_writes  # the torque stays for what is no EEPROM
    assert servo.goal == 2048 + round(math.radians(15.0) / COUNT_RAD)
    assert sail.health().state is DeviceState.RUNNING


@pytest.mark.parametrize("ticks", range(6, 12))
def test_a_watchdog_that_tripped_while_the_autopilot_stood_still_is_cleared_before_the_next_goal(sail, servo, ticks):
    """The servo already has this goal, so its acceptance shows nothing: the rudder stays where it stopped."""
    sail.ticks(ticks, shaft_deg=15.0)
    goal = servo.position
    servo.position = 2048
    servo.trip_watchdog()
    servo.reads.clear()
    sail.now_s += 2.0
    sail.slack = 12
    sail.ticks(1, shaft_deg=15.0)
    assert servo.reads[0] == 98
    assert servo.registers[98] == 100
    assert servo.position == goal


@pytest.mark.parametrize("period_s", [1.0, 0.1])
def test_a_watchdog_that_is_fed_is_not_looked_at_out_of_turn(fakes, line, servo, period_s):
    sail = fakes.sail(dynamixel_rudder(line, DynamixelOptions()), period_s=period_s)
    sail.ticks(20)
    servo.reads.clear()
    sail.ticks(60)
    assert servo.reads.count(98) <= 60 * min(1.0, period_s / 0.5) + 1


@pytest.mark.parametrize(("error", "name"), [(0x20, "overload"), (0x01, "input voltage"), (0x10, "electrical shock")])
def test_shutdown_is_reported_and_rebooted_at_most_every_30_s(sail, servo, error, name):
    sail.ticks(5)
    servo.shut_down(error)
    feedback = sail.ticks(8, shaft_deg=9.0)
    assert feedback[-1].hardware_error == error
    assert feedback[-1].torque_on is False
    assert sail.health().state is DeviceState.FAULTY
    assert sail.health().text == f"servo error: {name}, torque cut"
    assert servo.reboots == 0
    assert servo.ram_writes.count((64, 1)) == 1  # the torque is not asked for while it cannot come
    sail.ticks(30, shaft_deg=9.0)
    assert servo.reboots == 1
    assert sail.health().state is DeviceState.RUNNING
    assert servo.goal == 2048 + round(math.radians(9.0) / COUNT_RAD)
    servo.shut_down(error)
    sail.ticks(200)
    assert servo.reboots == 1
    sail.ticks(150)
    assert servo.reboots == 2


@pytest.mark.parametrize("moment", range(6))
def test_a_hardware_error_is_known_within_half_a_second(sail, servo, moment):
    sail.ticks(5 + moment)
    servo.shut_down(0x20)
    sail.ticks(4)
    assert sail.health().state is DeviceState.FAULTY


def test_what_a_servo_reported_before_the_cable_was_out_is_not_said_of_the_one_that_is_in(sail, servo, line):
    sail.ticks(5)
    servo.shut_down(0x20)
    sail.ticks(8)
    assert sail.health().text == "servo error: overload, torque cut"
    line.unplug()
    servo.powered = False
    sail.ticks(1)
    line.plug()
    sail.ticks(1)
    assert (sail.health().state, sail.health().text) == (DeviceState.STARTING, "model 1170, firmware 47")


def test_a_refused_torque_is_not_requested_again_once_the_reason_is_known(sail, servo):
    sail.ticks(6, torque_on=False)
    servo.shut_down(0x20)
    sail.ticks(6)
    assert servo.ram_writes.count((64, 1)) == 1


def test_a_servo_with_an_error_is_released_too(sail, servo):
    sail.ticks(5)
    servo.registers[70] = 0x01
    sail.ticks(8)
    assert servo.registers[64] == 1
    sail.ticks(3, torque_on=False)
    assert servo.registers[64] == 0


def test_after_a_reboot_nothing_is_taken_for_granted(sail, servo, line):
    sail.ticks(5)
    servo.shut_down(0x20)
    sail.ticks(50)
    rebooted = [frame[7] for frame in line.written].index(frames.REBOOT)
    assert line.written[rebooted + 1] == frames.read(1, 8, 6)  # from the first block on


def test_overheated_servo_cools_first(sail, servo):
    sail.ticks(5)
    servo.shut_down(0x04)
    servo.registers[146] = 78
    sail.ticks(100)
    assert servo.reboots == 0
    servo.registers[146] = 55
    sail.ticks(3)
    assert servo.reboots == 1


def test_error_that_leaves_the_torque_on_is_only_reported(sail, servo):
    sail.ticks(5)
    servo.registers[70] = 0x01
    feedback = sail.ticks(60, shaft_deg=6.0)
    assert servo.reboots == 0
    assert sail.health().state is DeviceState.FAULTY
    assert sail.health().text == "servo error: input voltage"
    assert servo.goal == 2048 + round(math.radians(6.0) / COUNT_RAD)
    assert feedback[-1].torque_on is True


def test_a_servo_without_watchdog_is_steered(sail, servo):
    servo.refuse[98] = 7
    sail.ticks(6, shaft_deg=11.0)
    assert servo.goal == 2048 + round(math.radians(11.0) / COUNT_RAD)
    health = sail.health()
    assert health.state is DeviceState.RUNNING
    assert health.text == "servo rejects bus watchdog: access error"


def test_what_a_servo_can_do_without_is_tried_thrice_and_then_now_and_then(sail, servo):
    servo.ignore.add(98)
    sail.ticks(20)
    assert servo.ram_writes.count((98, 100)) == 3
    sail.ticks(610)
    assert servo.ram_writes.count((98, 100)) == 5  # every 30 s
    servo.ignore.clear()
    sail.ticks(300)
    assert servo.registers[98] == 100


def test_a_setting_without_effect_does_not_wear_out_the_eeprom(sail, servo):
    servo.ignore.add(9)
    sail.ticks(400, shaft_deg=1.0)
    assert len(servo.eeprom_writes) == 3
    assert (64, 0) not in servo.ram_writes  # no torque cut under way for another attempt
    assert sail.health().text == "servo does not store return delay"
    assert servo.goal != 2048


def test_changed_limits_are_read_again(sail, servo):
    sail.ticks(4)
    servo.put(48, 2100, 4)
    sail.ticks(3, shaft_deg=60.0)
    assert servo.goal == 2100
    assert sail.health().state is DeviceState.RUNNING


def test_impossible_values_are_refused_one_by_one(sail, servo):
    sail.ticks(4)
    rejected = sail.health().rejected
    servo.put(144, 9000, 2)
    feedback = sail.ticks(1)
    assert feedback[-1].voltage_v is None
    assert feedback[-1].shaft_rad is not None
    servo.position = 0x7FFFFFFF
    feedback = sail.ticks(1, torque_on=False)
    assert feedback[-1].shaft_rad is None
    assert sail.health().rejected == rejected + 3


def test_answers_of_another_servo_and_late_ones_are_refused(sail, line, fakes):
    sail.ticks(4)
    accepted = sail.health().accepted
    line.inbox += fakes.status_frame(2, 0) + fakes.status_frame(1, 0, bytes(21))
    sail.rudder.receive(sail.now_s)
    assert sail.health().accepted == accepted
    assert sail.health().rejected == 2
    assert sail.rudder.poll() == ()


@pytest.mark.parametrize(
    ("error", "torque_on", "text"),
    [(0x20, False, "servo error: overload, torque cut"), (0x28, True, "servo error: encoder, overload, torque cut")],
)
def test_no_reboot_without_a_torque_command_or_after_an_encoder_error(sail, servo, error, torque_on, text):
    sail.ticks(5)
    servo.shut_down(error)
    sail.ticks(60, torque_on=torque_on)
    assert servo.reboots == 0
    assert sail.health().text == text


@pytest.mark.parametrize(
    ("address", "text"),
    [
        (8, "servo rejects settings: access error"),
        (11, "servo rejects operating mode: access error"),
        (48, "servo rejects position limits: access error"),
        (64, "servo rejects state: access error"),
        (116, "servo rejects goal position"),
    ],
)
def test_a_rejected_essential_instruction_is_a_fault_while_it_lasts(sail, servo, address, text):
    servo.registers[11] = 1  # the operating mode needs a correction
    servo.refuse[address] = 7
    sail.ticks(10)
    assert (sail.health().state, sail.health().text) == (DeviceState.FAULTY, text)
    servo.refuse.clear()
    sail.ticks(20, shaft_deg=5.0)
    assert sail.health().state is DeviceState.RUNNING
    assert sail.health().text.startswith("model")
    assert servo.goal == 2048 + round(math.radians(5.0) / COUNT_RAD)
    assert not sail.rudder.needs_prompt_io()
