"""Feetech driver with a simulated servo: goals, corrections, faults, power losses and late replies."""

import math

import pytest

from firmware_py.actuator.feetech import DRIVER, FeetechOptions, FeetechServo, feetech_rudder
from firmware_py.common.records import DeviceRole, DeviceState, RudderCommand
from support.servo_registers import Feetech, FeetechInstruction, FeetechStatus

COUNT_RAD = math.tau / 4096
ON = 1


@pytest.fixture
def servo(fakes):
    return fakes.feetech()


@pytest.fixture
def line(fakes, servo):
    return fakes.line(servo, baud=1_000_000)


@pytest.fixture
def rig(fakes, line):
    return fakes.rig(feetech_rudder(line, FeetechOptions()))


@pytest.fixture
def running(rig):
    """The rig with a servo that follows."""
    rig.ticks(5)
    rig.rudder.poll()
    return rig


def counts(shaft_deg):
    return 2048 + round(shaft_deg * 4096 / 360)


def test_goal_is_sent_and_feedback_returned_within_two_ticks(rig, servo):
    last = rig.ticks(2, shaft_deg=20.0)[-1]
    assert servo.position == counts(20.0) == 2276
    assert last.shaft_rad == pytest.approx(228 * COUNT_RAD)
    assert last.temperature_c == 31.0
    assert last.voltage_v == pytest.approx(12.1)
    assert last.current_a == pytest.approx(-0.065)
    assert (last.hardware_error, last.torque_on, last.restarts) == (0, True, 0)
    health = rig.health()
    assert (health.role, health.state, health.rejected) == (DeviceRole.RUDDER, DeviceState.RUNNING, 0)
    assert health.text == "model 777, firmware 3.10"
    rig.ticks(1, shaft_deg=0.0)
    assert servo.position == 2048


def test_torque_is_switched_on_together_with_the_goal(rig, servo, line):
    rig.ticks(2, shaft_deg=-5.0)
    goal = counts(-5.0).to_bytes(2, "little")
    assert servo.writes == [
        (Feetech.ACCELERATION, b"\xfe", 0),
        (Feetech.TORQUE, bytes((1, 254)) + goal, 0),
        (Feetech.GOAL, goal, 1),
    ]
    assert bytes.fromhex("FFFF 01 07 03 28 01 FE C7 07 FF") in line.written


def test_tick_is_the_goal_and_one_read(running, servo, line):
    line.written.clear()
    running.ticks(1, shaft_deg=30.0)
    assert line.written == [bytes.fromhex("FFFF 01 05 03 2A 55 09 6E"), bytes.fromhex("FFFF 01 04 02 28 1F B1")]
    assert sum(map(len, line.written)) + 6 + 37 == 60


def test_goal_is_the_first_request_of_every_tick(running, servo, line):
    for _ in range(100):
        line.written.clear()
        running.ticks(1)
        assert [frame[4] for frame in line.written] == [FeetechInstruction.WRITE, FeetechInstruction.READ]


def test_nothing_is_written_before_the_first_command(fakes, servo, line):
    servo.registers[Feetech.OPERATING_MODE] = 1
    rudder = feetech_rudder(line, FeetechOptions())
    for tick in range(100):
        rudder.receive(0.02 * tick)
    assert servo.writes == []
    assert 3 <= len(line.written) < 40
    assert rudder.health(2.0).state is DeviceState.RUNNING
    servo.registers[Feetech.OPERATING_MODE] = 0


def test_angle_is_measured_before_the_first_command(servo, line):
    servo.position = 2500
    rudder = feetech_rudder(line, FeetechOptions())
    for tick in range(20):
        rudder.receive(0.1 * tick)
    feedback = rudder.poll()
    assert len(feedback) >= 4
    assert feedback[-1].shaft_rad == pytest.approx(452 * COUNT_RAD)
    assert feedback[-1].torque_on is False


def test_torque_is_not_switched_on_without_a_goal(rig, servo):
    rig.ticks(3, shaft_deg=math.nan)
    assert servo.writes == [(Feetech.ACCELERATION, b"\xfe", 0)]
    assert rig.health().state is DeviceState.RUNNING
    rig.ticks(2, shaft_deg=1.0)
    assert servo.position == counts(1.0)


def test_settings_are_corrected_in_ram_with_the_torque_off(rig, servo):
    servo.stored[Feetech.OPERATING_MODE], servo.stored[Feetech.RESPONSE_LEVEL] = 3, 0
    servo.restart()
    servo.registers[Feetech.LOCK], servo.registers[Feetech.TORQUE] = 0, 2
    rig.ticks(10, shaft_deg=10.0)
    corrections = [(address, data) for address, data, _ in servo.writes[1:5]]
    assert corrections == [
        (Feetech.LOCK, b"\1"),
        (Feetech.TORQUE, b"\0"),
        (Feetech.OPERATING_MODE, b"\0"),
        (Feetech.RESPONSE_LEVEL, b"\1"),
    ]
    assert servo.writes[3][2] == 0  # the mode with the torque off
    assert (servo.stored[Feetech.OPERATING_MODE], servo.stored[Feetech.RESPONSE_LEVEL]) == (3, 0)  # nothing is stored
    assert servo.position == counts(10.0)
    assert rig.health().state is DeviceState.RUNNING


def test_correct_settings_are_not_written(running, servo):
    assert {address for address, _, _ in servo.writes} == {Feetech.TORQUE, Feetech.ACCELERATION, Feetech.GOAL}


def test_mode_that_cannot_be_set_is_a_fault_and_no_goal_is_sent(rig, servo):
    servo.registers[Feetech.OPERATING_MODE] = 3
    servo.ignored_addresses.add(Feetech.OPERATING_MODE)
    feedback = rig.ticks(8, shaft_deg=10.0)
    health = rig.health()
    assert (health.state, health.text) == (DeviceState.FAULTY, "servo does not accept operating mode")
    assert {address for address, _, _ in servo.writes} == {Feetech.OPERATING_MODE, Feetech.ACCELERATION}
    assert servo.position == 2048
    assert [sample.shaft_rad for sample in feedback] == [None] * len(feedback)  # a difference in this mode
    assert len(servo.writes) == 1 + 3
    rig.ticks(20)  # 2 s
    assert len(servo.writes) == 1 + 4
    servo.ignored_addresses.clear()
    rig.ticks(25, shaft_deg=10.0)
    assert (rig.health().state, rig.health().text) == (DeviceState.RUNNING, "model 777, firmware 3.10")
    assert servo.position == counts(10.0)


@pytest.mark.parametrize(
    ("address", "name"),
    [(Feetech.LOCK, "lock"), (Feetech.RESPONSE_LEVEL, "response level"), (Feetech.ACCELERATION, "acceleration")],
)
def test_optional_setting_that_cannot_be_set_is_reported_and_the_servo_is_used(rig, servo, address, name):
    servo.registers[address] = 0
    servo.ignored_addresses.add(address)
    rig.ticks(9, shaft_deg=10.0)
    health = rig.health()
    assert (health.state, health.text) == (DeviceState.RUNNING, f"servo does not accept {name}")
    assert servo.position == counts(10.0)


def test_nothing_is_stored_in_a_servo_that_cannot_be_locked(rig, servo):
    servo.stored[Feetech.OPERATING_MODE] = 3
    servo.restart()
    servo.registers[Feetech.LOCK] = 0
    servo.ignored_addresses.add(Feetech.LOCK)
    rig.ticks(12, shaft_deg=10.0)
    assert {address for address, _, _ in servo.writes} == {Feetech.ACCELERATION, Feetech.LOCK}
    assert servo.stored[Feetech.OPERATING_MODE] == 3
    assert (rig.health().state, rig.health().text) == (DeviceState.FAULTY, "servo does not accept lock")


def test_servo_without_acknowledgements_is_used(fakes, servo, line):
    servo.registers[Feetech.RESPONSE_LEVEL] = 0
    servo.ignored_addresses.add(Feetech.RESPONSE_LEVEL)
    rig = fakes.rig(feetech_rudder(line, FeetechOptions()), slack=30)
    rig.ticks(10)
    assert len(rig.ticks(20, shaft_deg=-10.0)) >= 18
    assert servo.position == counts(-10.0)
    assert rig.health().state is DeviceState.RUNNING


def test_big_endian_servo_is_not_written(rig, servo):
    servo.registers[Feetech.BYTE_ORDER] = 1
    rig.ticks(5)
    assert servo.writes == []
    assert (rig.health().state, rig.health().text) == (DeviceState.FAULTY, "SCS servo (big-endian) not supported")


@pytest.mark.parametrize(
    ("shaft_deg", "goal", "is_at_limit"),
    [
        (-95.0, 1000, True),
        (-91.2, 1010, True),
        (-91.05, 1012, False),
        (82.6, 2988, False),
        (82.7, 2989, True),
        (90.0, 3000, True),
    ],
)
def test_goal_is_within_the_angle_limits(rig, servo, shaft_deg, goal, is_at_limit):
    servo.put(Feetech.MIN_ANGLE, 1000)
    servo.put(Feetech.MAX_ANGLE, 3000)
    rig.ticks(4, shaft_deg=shaft_deg)
    assert servo.goal == goal
    assert (rig.health().text == "goal at an angle limit of the servo") is is_at_limit
    assert rig.health().state is DeviceState.RUNNING


def test_released_servo_is_still_read_and_engages_with_the_goal(running, servo):
    servo.writes.clear()
    feedback = running.ticks(5, shaft_deg=5.0, torque_on=False)
    assert [(address, data) for address, data, _ in servo.writes] == [(Feetech.TORQUE, b"\0")]
    assert feedback[-1].torque_on is False
    servo.position = 2100
    assert running.ticks(1, torque_on=False)[-1].shaft_rad == pytest.approx(52 * COUNT_RAD)
    assert running.health().state is DeviceState.RUNNING
    servo.writes.clear()
    running.ticks(1, shaft_deg=7.0)
    assert servo.writes == [(Feetech.TORQUE, bytes((1, 254)) + counts(7.0).to_bytes(2, "little"), 0)]
    assert running.ticks(1, shaft_deg=7.0)[-1].restarts == 0


def test_rejected_goal_is_a_fault_after_three_ticks(running, servo):
    servo.ignored_addresses |= {Feetech.GOAL, Feetech.GOAL_HIGH_BYTE}
    running.ticks(2, shaft_deg=10.0)
    assert running.health().state is DeviceState.RUNNING
    rejected = running.health().rejected
    running.ticks(1, shaft_deg=10.0)
    assert (running.health().state, running.health().text) == (DeviceState.FAULTY, "servo rejects goal position")
    assert running.health().rejected == rejected + 1
    servo.ignored_addresses.clear()
    running.ticks(1, shaft_deg=10.0)
    assert running.health().state is DeviceState.RUNNING


def test_rejected_goals_before_the_line_was_reopened_do_not_count(running, servo, line):
    servo.ignored_addresses |= {Feetech.GOAL, Feetech.GOAL_HIGH_BYTE}
    running.ticks(2, shaft_deg=10.0)
    line.unplug()
    line.plug()
    running.ticks(3, shaft_deg=10.0)  # in the first one the state is read before the goal is sent
    assert running.health().state is DeviceState.RUNNING
    running.ticks(1, shaft_deg=10.0)
    assert running.health().state is DeviceState.FAULTY


def test_goal_of_a_released_servo_is_not_compared(running, servo):
    running.ticks(2, torque_on=False)
    servo.restart()  # the goal is lost
    running.ticks(5, torque_on=False)
    assert running.health().state is DeviceState.RUNNING


def test_power_loss_without_silence_is_counted_and_the_settings_are_read_again(running, servo):
    servo.stored[Feetech.OPERATING_MODE] = 1
    servo.restart()
    servo.reads.clear()
    feedback = running.ticks(3, shaft_deg=-10.0)
    assert (servo.registers[Feetech.OPERATING_MODE], servo.registers[Feetech.TORQUE]) == (0, ON)
    assert servo.position == counts(-10.0)
    assert Feetech.FIRMWARE in servo.reads
    assert [sample.restarts for sample in feedback][-1] == 1
    assert running.health().state is DeviceState.RUNNING


def test_power_loss_with_silence_is_counted(running, servo):
    servo.powered = False
    running.ticks(10)
    assert running.health().state is DeviceState.SILENT
    servo.powered = True
    servo.restart()
    feedback = running.ticks(4, shaft_deg=10.0)
    assert servo.position == counts(10.0)
    assert feedback[-1].restarts == 1


def test_power_loss_while_released_is_counted_and_the_mode_is_corrected_before_it_engages(running, servo):
    running.ticks(2, torque_on=False)
    servo.stored[Feetech.OPERATING_MODE] = 3
    servo.restart()
    assert running.ticks(3, torque_on=False)[-1].restarts == 1
    assert servo.registers[Feetech.OPERATING_MODE] == 0
    servo.restart()
    servo.writes.clear()
    running.ticks(3, shaft_deg=10.0)
    assert [address for address, _, _ in servo.writes][:3] == [
        Feetech.ACCELERATION,
        Feetech.OPERATING_MODE,
        Feetech.TORQUE,
    ]
    assert servo.position == counts(10.0)


def test_error_with_torque_is_reported_and_the_servo_follows(running, servo):
    servo.status = FeetechStatus.VOLTAGE
    feedback = running.ticks(3, shaft_deg=10.0)
    assert feedback[-1].hardware_error == FeetechStatus.VOLTAGE
    assert (running.health().state, running.health().text) == (DeviceState.FAULTY, "servo error: voltage")
    assert servo.position == counts(10.0)
    servo.status = 0
    running.ticks(1)
    assert running.health().state is DeviceState.RUNNING


def switched_on(servo):
    return [data for address, data, _ in servo.writes if address == Feetech.TORQUE and data[0] == ON]


def test_torque_cut_by_the_servo_is_switched_on_after_three_seconds(running, servo):
    servo.cut_torque(FeetechStatus.OVERLOAD)
    servo.ignored_addresses.add(Feetech.TORQUE)
    servo.writes.clear()
    feedback = running.ticks(29)
    assert running.health().text == "servo error: overload, torque cut"
    assert feedback[-1].restarts == 0
    assert feedback[-1].torque_on is False
    assert switched_on(servo) == []
    running.ticks(3)
    assert len(switched_on(servo)) == 1
    running.ticks(296)
    assert len(switched_on(servo)) == 1
    running.ticks(6)
    assert len(switched_on(servo)) == 2  # 30 s later
    servo.ignored_addresses.clear()
    servo.status = 0
    running.ticks(2, shaft_deg=10.0)
    assert servo.position == counts(10.0)
    assert running.health().state is DeviceState.RUNNING


@pytest.mark.parametrize(
    "status",
    [
        FeetechStatus.ENCODER,
        FeetechStatus.OVERHEATING,
        FeetechStatus.ENCODER | FeetechStatus.OVERHEATING,
        FeetechStatus.ENCODER | FeetechStatus.OVERLOAD,
    ],
)
def test_torque_is_not_switched_on_with_an_encoder_error_or_while_hot(running, servo, status):
    servo.cut_torque(status)
    servo.writes.clear()
    running.ticks(400)
    assert [address for address, _, _ in servo.writes] == [Feetech.GOAL]  # before the first reply with the error


def test_overload_with_torque_is_reset_after_three_seconds(running, servo):
    """The servo reduces its output without switching the torque off."""
    servo.status = FeetechStatus.OVERLOAD
    servo.writes.clear()
    running.ticks(28)
    assert switched_on(servo) == []
    running.ticks(5)
    assert len(switched_on(servo)) == 1


def test_servo_with_a_warning_starts_at_once(rig, servo):
    servo.status = FeetechStatus.VOLTAGE
    rig.ticks(2, shaft_deg=10.0)
    assert servo.position == counts(10.0)


def test_servo_with_a_warning_engages_at_once(running, servo):
    servo.status = FeetechStatus.VOLTAGE
    running.ticks(2)
    running.ticks(2, torque_on=False)
    running.ticks(1, shaft_deg=10.0)
    assert servo.position == counts(10.0)


def test_torque_that_cannot_be_switched_on_is_a_fault(rig, servo):
    servo.ignored_addresses.add(Feetech.TORQUE)
    rig.ticks(6)
    assert (rig.health().state, rig.health().text) == (DeviceState.FAULTY, "servo does not accept torque")
    writes = len(servo.writes)
    rig.ticks(60)
    assert writes + 2 <= len(servo.writes) <= writes + 4  # once in 2 s


def test_values_out_of_range_are_rejected(running, servo):
    servo.position = 6000
    servo.registers[Feetech.TEMPERATURE] = 200
    rejected = running.health().rejected
    last = running.ticks(1, torque_on=True, shaft_deg=0.0)[-1]
    assert last.temperature_c is None
    assert last.voltage_v == pytest.approx(12.1)
    assert running.health().rejected > rejected


def test_reply_of_another_servo_is_not_used(fakes, line, servo):
    line.noise = fakes.feetech_frame(2, 0, bytes(31)) + fakes.feetech_frame(2, 0)
    rig = fakes.rig(feetech_rudder(line, FeetechOptions()))
    feedback = rig.ticks(5, shaft_deg=3.0)
    assert {round(sample.shaft_rad / COUNT_RAD) for sample in feedback} <= {0, 34}
    assert rig.health().rejected == 0


class OtherBaud:
    """A servo that sends at half the baud rate of the line: each of its bits is received as two."""

    def __init__(self, servo):
        self.servo = servo

    def handle(self, frame):
        bits = "".join("0" + f"{byte:08b}"[::-1] + "1" for byte in self.servo.handle(frame))
        doubled = "".join(2 * bit for bit in bits)
        return bytes(int(doubled[start + 1 : start + 9][::-1], 2) for start in range(0, len(doubled) - 9, 10))


def test_bytes_of_another_baud_rate_give_no_feedback(fakes, servo):
    rig = fakes.rig(feetech_rudder(fakes.line(OtherBaud(servo)), FeetechOptions()))
    assert rig.ticks(30, shaft_deg=10.0) == []
    assert servo.writes == []
    assert (rig.health().state, rig.health().text) == (DeviceState.STARTING, "no reply from servo id 1")


def test_lost_byte_that_equals_the_next_header_gives_no_angle(running, servo, line):
    """Without it, and with the first byte of the next reply as checksum, the sum of this reply is correct."""
    servo.position = 2047
    running.rudder.receive(running.now_s)
    running.rudder.command(RudderCommand(-COUNT_RAD, True), running.now_s)
    running.rudder.receive(running.now_s)
    reply = bytes(line.inbox)
    assert reply[5 + 16 : 5 + 18] == b"\xff\x07"  # the position in the state
    line.inbox.clear()
    line.inbox += reply[: 5 + 16] + reply[5 + 17 :]
    running.now_s += 0.1
    feedback = running.ticks(5, shaft_deg=-1.0 * 360 / 4096)
    assert {round(sample.shaft_rad / COUNT_RAD) for sample in feedback} == {-1}


def test_prompt_io_is_needed_until_the_reading_after_the_goal(running, servo, fakes):
    line = fakes.line()
    rudder = feetech_rudder(line, FeetechOptions())
    rudder.receive(0.0)
    assert rudder.needs_prompt_io()
    for _ in range(7):  # settings, state, acceleration, state, settings, torque, state
        rudder.command(RudderCommand(0.1, True), 1.0)
        line.inbox += servo.handle(line.written[-1])
        rudder.receive(1.0)
    assert line.written[-1][4:6] == bytes((FeetechInstruction.WRITE, Feetech.GOAL))
    assert rudder.needs_prompt_io()  # for the reading
    line.inbox += servo.handle(line.written[-1])
    rudder.receive(1.0)
    assert line.written[-1][4:6] == bytes((FeetechInstruction.READ, Feetech.TORQUE))
    assert not rudder.needs_prompt_io()
    rudder.command(RudderCommand(0.1, False), 1.02)
    assert rudder.needs_prompt_io()
    for _ in range(3):  # torque, state, reading
        line.inbox += servo.handle(line.written[-1])
        rudder.receive(1.021)
    rudder.command(RudderCommand(0.1, False), 1.04)
    assert line.written[-1][4:6] == bytes((FeetechInstruction.READ, Feetech.TORQUE))
    assert not rudder.needs_prompt_io()  # without torque no goal is due


def test_settings_are_read_again_while_no_state_is_received(rig, servo):
    handle = servo.handle
    servo.handle = lambda data: handle(data) if data[5] == Feetech.FIRMWARE else b""
    rig.ticks(40)
    assert servo.reads.count(Feetech.FIRMWARE) >= 2


def test_lost_acknowledgement_and_lost_settings_do_not_change_the_length_of_the_next_read(rig, servo, line):
    line.lose_replies = 1  # of the settings
    rig.ticks(3)
    line.lose_replies = 1  # of the goal
    rig.ticks(3)
    assert set(servo.reads) == {Feetech.FIRMWARE, Feetech.TORQUE}


@pytest.fixture
def conversation(fakes, servo):
    return fakes.conversation(FeetechServo(FeetechOptions()), servo)


@pytest.fixture
def writes(conversation, servo):
    """Function that runs the conversation at a time and returns the addresses of the writes."""

    def writes(now_s):
        first = len(servo.writes)
        conversation.run(now_s)
        return [address for address, _, _ in servo.writes[first:]]

    return writes


def test_each_lost_state_makes_the_next_read_longer_up_to_the_longest(conversation):
    driver, blocks = conversation.servo, []
    conversation.run(1.0)
    for tick in range(6):
        driver.command(0.1, 2.0 + tick, torque_on=True)
        while (request := driver.next_request(2.0 + tick)).block is None:
            driver.note_sent(request, 2.0 + tick)
        driver.note_sent(request, 2.0 + tick)
        driver.note_lost(request)
        blocks.append(request.block.start)
    assert blocks == [40, 37, 34, 28, 25, 40]


def test_failed_correction_is_repeated_every_two_seconds(writes, servo):
    servo.ignored_addresses.add(Feetech.TORQUE)
    assert writes(1.0) == [Feetech.ACCELERATION, *[Feetech.TORQUE] * 3]
    assert writes(2.99) == []
    assert writes(3.0) == [Feetech.TORQUE]
    assert writes(4.99) == []
    assert writes(5.0) == [Feetech.TORQUE]


@pytest.mark.parametrize("status", [FeetechStatus.VOLTAGE, FeetechStatus.OVERLOAD])
def test_torque_after_an_error_is_switched_on_after_3_s_and_every_30_s(writes, servo, status):
    writes(1.0)
    servo.cut_torque(status)
    servo.ignored_addresses.add(Feetech.TORQUE)
    assert writes(2.0) == [Feetech.GOAL]  # before the error is read
    assert writes(4.99) == []
    assert writes(5.0) == [Feetech.TORQUE]
    assert writes(34.99) == []
    assert writes(35.0) == [Feetech.TORQUE]


def test_next_error_waits_for_the_end_of_the_30_s(writes, servo):
    writes(1.0)
    servo.cut_torque(FeetechStatus.OVERLOAD)
    writes(2.0)
    assert writes(5.0) == [Feetech.TORQUE]
    servo.status = 0
    writes(6.0)
    servo.cut_torque(FeetechStatus.OVERLOAD)
    writes(7.0)
    assert writes(34.99) == []
    assert writes(35.0) == [Feetech.TORQUE]
    servo.status = 0
    writes(36.0)
    assert writes(65.0) == [Feetech.GOAL]  # 30 s are over
    servo.cut_torque(FeetechStatus.OVERLOAD)
    writes(65.5)
    assert writes(68.49) == []
    assert writes(68.5) == [Feetech.TORQUE]


def test_state_from_before_a_correction_is_read_again(writes, conversation, servo):
    """Its reply is late; the servo was not locked at that time."""
    servo.registers[Feetech.LOCK] = 0
    conversation.servo.command(0.1, 1.0, torque_on=True)
    requests = []
    for now_s in (1.0, 1.1):  # settings and state
        requests.append(conversation.servo.next_request(now_s))
        conversation.servo.note_sent(requests[-1], now_s)
        replies = conversation.servo.parser.feed(servo.handle(requests[-1].frame))
        conversation.servo.process_reply(requests[-1], replies[0], now_s, is_certain=True)
    late_reply = replies[0]
    correction = conversation.servo.next_request(1.2)
    conversation.servo.note_sent(correction, 1.2)
    servo.handle(correction.frame)
    conversation.servo.process_reply(requests[-1], late_reply, 1.1, is_certain=True)
    assert conversation.servo.next_request(1.2).block is not None
    assert writes(1.3) == [Feetech.LOCK, Feetech.TORQUE]


def test_driver_needs_a_serial_port():
    assert DRIVER.writes
    assert (DRIVER.interface, DRIVER.options, DRIVER.device) == (1, FeetechOptions, "Feetech STS and SMS bus servos")


@pytest.mark.parametrize("device_id", [0, 253])
def test_other_id_is_used(fakes, device_id):
    servo = fakes.feetech(device_id=device_id)
    rig = fakes.rig(feetech_rudder(fakes.line(servo), FeetechOptions(id=device_id)))
    rig.ticks(3, shaft_deg=4.0)
    assert servo.position == counts(4.0)
