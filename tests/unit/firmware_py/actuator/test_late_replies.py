"""Adapters that delay, lose, split or damage replies: each reply is assigned to its own request."""

import itertools
import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.actuator import feetech_protocol
from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.actuator.dynamixel_registers import GOAL_READS, LIMITS, STATE, WATCHDOG
from firmware_py.actuator.feetech import FeetechOptions, feetech_rudder
from firmware_py.actuator.volz import VolzOptions, volz_rudder
from firmware_py.common.records import DeviceState, RudderCommand
from support.servo_registers import Dynamixel, DynamixelError

COUNT_RAD = 2.0 * math.pi / 4096
CONFIGURED_TICKS = 30  # after these the servo is configured
STEP_S = 0.005


class LateRig:
    """Runs a driver as the loop does: between ticks it receives only while it needs prompt I/O.

    Each tick commands another angle.
    """

    def __init__(self, rudder, line, *, period_s=0.1):
        self.rudder, self.line, self.period_s = rudder, line, period_s
        self.now_s = 0.0
        self.number = 0
        self.states = []

    def tick(self):
        """Return the feedback of a tick, which commands the next angle of a sawtooth."""
        self.number += 1
        angle_rad = (self.number % 500) * 2 * COUNT_RAD
        self.line.now_s = self.now_s
        self.rudder.receive(self.now_s)
        self.rudder.command(RudderCommand(angle_rad, torque_on=True), self.now_s)
        feedback = list(self.rudder.poll())
        for step in range(1, round(self.period_s / STEP_S)):
            self.line.now_s = self.now_s + step * STEP_S
            if self.rudder.needs_prompt_io():
                self.rudder.receive(self.line.now_s)
        self.states.append(self.rudder.health(self.now_s).state)
        self.now_s = round(self.now_s + self.period_s, 9)
        return feedback

    def ticks(self, count):
        return [sample for _ in range(count) for sample in self.tick()]


class RecordingServo:
    """A servo that records its position at each request."""

    def __init__(self, servo):
        self.servo = servo
        self.line = None
        self.positions_by_time = {}  # positions by time of request
        self.last_request_s = {}  # time of the last request by position

    def handle(self, data):
        reply = self.servo.handle(data)
        self.positions_by_time.setdefault(self.line.now_s, set()).add(self.servo.position)
        self.last_request_s[self.servo.position] = self.line.now_s
        return reply

    def has_true_positions(self, feedback):
        """Return whether each feedback has a position that the shaft had at its time."""
        return all(
            round(sample.shaft_rad / COUNT_RAD) + 2048 in self.positions_by_time[sample.t_s] for sample in feedback
        )


@pytest.fixture
def servo(fakes):
    return fakes.dynamixel()


def late_rig(fakes, servo, delay_s, rudder_of=None, **rig):
    recorder = RecordingServo(servo)
    line = recorder.line = fakes.late_line(recorder, delay_s, **({"baud": rig.pop("baud")} if "baud" in rig else {}))
    rudder = (rudder_of or (lambda line: dynamixel_rudder(line, DynamixelOptions())))(line)
    return LateRig(rudder, line, **rig), recorder


@pytest.mark.parametrize("reply_delay_s", [0.02, 0.06, 0.12, 0.24, 0.33])
def test_constant_reply_delay_is_no_fault(fakes, servo, reply_delay_s):
    rig, recorder = late_rig(fakes, servo, lambda: reply_delay_s)
    rig.ticks(CONFIGURED_TICKS)
    rig.states.clear()
    servo.reads.clear()
    servo.ram_writes.clear()
    feedback = rig.ticks(200)
    assert set(rig.states) == {DeviceState.RUNNING}
    assert len(feedback) >= 120
    assert recorder.has_true_positions(feedback)
    assert servo.reads.count(LIMITS.address) == 0  # the limits are read only after a rejected goal
    assert {address for address, _ in servo.ram_writes} == {Dynamixel.GOAL_POSITION}
    assert len(servo.ram_writes) >= 120
    assert STATE.address in servo.reads


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("baud", "period_s"), [(57600, 0.1), (57600, 0.04), (1_000_000, 0.02)])
def test_some_late_and_lost_replies_are_no_fault(fakes, servo, seed, baud, period_s):
    rng = random.Random(seed)
    rig, recorder = late_rig(fakes, servo, lambda: rng.choice([0.016] * 8 + [0.12, None]), baud=baud, period_s=period_s)
    rig.ticks(CONFIGURED_TICKS)
    rig.states.clear()
    servo.reads.clear()
    feedback = rig.ticks(300)
    assert set(rig.states) == {DeviceState.RUNNING}
    assert len(feedback) > 150
    assert recorder.has_true_positions(feedback)
    assert servo.reads.count(LIMITS.address) == 0


def test_rejected_goal_is_detected_by_late_replies(fakes, servo):
    rig, _ = late_rig(fakes, servo, lambda: 0.12)
    rig.ticks(CONFIGURED_TICKS)
    servo.write_errors[Dynamixel.GOAL_POSITION] = DynamixelError.ACCESS
    rig.ticks(20)
    assert rig.rudder.health(rig.now_s).text == "servo rejects goal position"
    servo.write_errors.clear()
    rig.ticks(10)
    assert rig.rudder.health(rig.now_s).state is DeviceState.RUNNING


def test_restart_and_watchdog_trip_are_detected_by_late_replies(fakes, servo):
    rig, _ = late_rig(fakes, servo, lambda: 0.12)
    rig.ticks(CONFIGURED_TICKS)
    servo.restart()
    rig.ticks(30)
    assert (servo.registers[Dynamixel.TORQUE_ENABLE], servo.registers[WATCHDOG.address]) == (1, 100)
    servo.trip_watchdog()
    rig.ticks(30)
    assert servo.registers[WATCHDOG.address] == 100
    rig.ticks(30)
    feedback = rig.ticks(1)
    assert feedback[-1].restarts == 1


def test_shortest_read_is_used_again_after_a_reply_in_time(fakes, servo):
    delay_s = [0.002]
    rig, _ = late_rig(fakes, servo, lambda: delay_s[0])
    rig.ticks(CONFIGURED_TICKS)
    longer = {block.address for block in GOAL_READS[1:]}
    for reply_delay_s, addresses in ((0.002, set()), (0.12, longer), (0.002, set())):
        delay_s[0] = reply_delay_s
        rig.ticks(4)
        servo.reads.clear()
        rig.ticks(60)
        assert {address for address in servo.reads if WATCHDOG.address < address < Dynamixel.GOAL_POSITION} == addresses


DELAYS = st.lists(st.sampled_from([0.0, 0.016, 0.05, 0.12, 0.21, 0.4, None]), min_size=1, max_size=40)


@given(DELAYS, st.sampled_from([0.1, 0.04, 0.02, 0.5]), st.sampled_from([57600, 1_000_000]))
def test_feedback_after_any_delays_is_not_newer_than_stated(fakes, delays, period_s, baud):
    servo = fakes.dynamixel()
    schedule = itertools.cycle([0.0] * 40)
    rig, recorder = late_rig(fakes, servo, lambda: next(schedule), period_s=period_s, baud=baud)
    rig.ticks(CONFIGURED_TICKS)
    rig.states.clear()
    rig.line.delay_s = iter([*delays, *[0.0] * 10_000]).__next__
    for _ in range(len(delays) + 5):
        for sample in rig.tick():
            assert sample.t_s <= recorder.last_request_s[round(sample.shaft_rad / COUNT_RAD) + 2048]
    assert DeviceState.FAULTY not in rig.states
    last_feedback = rig.ticks(round(3.0 / period_s) + 5)
    assert recorder.has_true_positions(last_feedback[-3:])
    assert last_feedback[-1].t_s >= rig.now_s - 2.0 * period_s - 1e-6
    assert rig.states[-1] is DeviceState.RUNNING
    assert servo.goal == servo.position


def test_feedback_of_a_volz_with_late_replies_has_the_time_of_the_request(fakes):
    servo = fakes.volz()
    rig, recorder = late_rig(fakes, servo, lambda: 0.12, lambda line: volz_rudder(line, VolzOptions()), baud=115_200)
    rig.ticks(10)
    before = len(rig.line.request_times_s)
    feedback = [sample for _ in range(100) for sample in rig.tick()]
    radians_per_count = math.radians(100.0) / 0x0780
    assert len(feedback) >= 40
    for sample in feedback:
        assert round(sample.shaft_rad / radians_per_count) + 0x0800 in recorder.positions_by_time[sample.t_s]
    assert len(rig.line.request_times_s) > before
    assert set(rig.states[10:]) == {DeviceState.RUNNING}


def feetech(line):
    return feetech_rudder(line, FeetechOptions())


@pytest.mark.parametrize("reply_delay_s", [0.02, 0.06, 0.12, 0.24, 0.33])
def test_constant_reply_delay_of_a_feetech_is_no_fault(fakes, reply_delay_s):
    servo = fakes.feetech()
    rig, recorder = late_rig(fakes, servo, lambda: reply_delay_s, feetech, baud=115_200)
    rig.ticks(CONFIGURED_TICKS)
    rig.states.clear()
    servo.writes.clear()
    feedback = rig.ticks(200)
    assert set(rig.states) == {DeviceState.RUNNING}
    assert len(feedback) >= 100
    assert recorder.has_true_positions(feedback)
    assert {address for address, _, _ in servo.writes} == {feetech_protocol.GOAL}
    assert len(servo.writes) >= 100


def test_shortest_read_of_a_feetech_is_used_again_after_a_reply_in_time(fakes):
    servo = fakes.feetech()
    delay_s = [0.002]
    rig, _ = late_rig(fakes, servo, lambda: delay_s[0], feetech, baud=115_200)
    rig.ticks(CONFIGURED_TICKS)
    shortest = feetech_protocol.STATES[0]
    for reply_delay_s, is_shortest in ((0.002, True), (0.12, False), (0.002, True)):
        delay_s[0] = reply_delay_s
        rig.ticks(4)
        servo.reads.clear()
        rig.ticks(60)
        assert (set(servo.reads) == {shortest.start}) is is_shortest
        assert set(servo.reads) <= {block.start for block in feetech_protocol.STATES}


@given(DELAYS, st.sampled_from([0.1, 0.04, 0.02, 0.5]), st.sampled_from([115_200, 1_000_000]))
def test_feedback_of_a_feetech_after_any_delays_is_not_newer_than_stated(fakes, delays, period_s, baud):
    servo = fakes.feetech()
    rig, recorder = late_rig(fakes, servo, lambda: 0.0, feetech, period_s=period_s, baud=baud)
    rig.ticks(CONFIGURED_TICKS)
    rig.states.clear()
    rig.line.delay_s = iter([*delays, *[0.0] * 10_000]).__next__
    for _ in range(len(delays) + 5):
        for sample in rig.tick():
            assert sample.t_s <= recorder.last_request_s[round(sample.shaft_rad / COUNT_RAD) + 2048]
    assert DeviceState.FAULTY not in rig.states
    last_feedback = rig.ticks(round(3.0 / period_s) + 5)
    assert recorder.has_true_positions(last_feedback[-3:])
    assert last_feedback[-1].t_s >= rig.now_s - 2.0 * period_s - 1e-6
    assert rig.states[-1] is DeviceState.RUNNING
    assert servo.goal == servo.position


class TestDamagedReplies:
    """Damage by cheap adapters while the goal changes each tick."""

    @pytest.fixture
    def rig(self, fakes, servo):
        recorder = RecordingServo(servo)
        line = recorder.line = fakes.line(recorder)
        line.now_s = 0.0
        rig = LateRig(dynamixel_rudder(line, DynamixelOptions()), line)
        rig.ticks(CONFIGURED_TICKS)
        servo.reads.clear()
        rig.states.clear()
        rig.recorder = recorder
        return rig

    def take_reply(self, rig):
        """Remove and return the reply to the goal after a tick without other requests."""
        while True:
            rig.tick()
            if rig.line.inbox:
                reply = bytes(rig.line.inbox)
                rig.line.inbox.clear()
                return reply

    def assert_unaffected(self, rig, servo, ticks=20):
        feedback = rig.ticks(ticks)
        assert rig.recorder.has_true_positions(feedback)
        assert len(feedback) >= ticks - 2
        assert set(rig.states) == {DeviceState.RUNNING}
        assert servo.reads.count(LIMITS.address) == 0

    def test_reply_divided_between_two_ticks(self, rig, servo):
        for cut in range(1, 42, 5):
            reply = self.take_reply(rig)
            rig.line.inbox += reply[:cut]
            rig.tick()
            rest, rig.line.inbox = bytes(rig.line.inbox), bytearray()
            rig.line.inbox += reply[cut:] + rest
            self.assert_unaffected(rig, servo)

    def test_reply_without_one_byte(self, rig, servo):
        for missing in range(42):
            reply = self.take_reply(rig)
            rig.line.inbox += reply[:missing] + reply[missing + 1 :]
            self.assert_unaffected(rig, servo, 3)

    def test_echo_without_one_byte_before_the_reply(self, rig, servo):
        rig.line.echo = True
        reply = self.take_reply(rig)
        echo = rig.line.written[-1]
        assert reply.startswith(echo)
        for missing in range(len(echo)):
            reply = self.take_reply(rig)
            rig.line.inbox += reply[:missing] + reply[missing + 1 :]
            self.assert_unaffected(rig, servo, 3)

    @pytest.mark.parametrize("garbage", [b"\0", b"\xff\xff\xfd", b"\xff\xff\xfd\x00\x01\x23\x00\x55", bytes(200)])
    def test_garbage_around_the_reply(self, rig, servo, garbage):
        for before, after in ((garbage, b""), (b"", garbage), (garbage, garbage)):
            reply = self.take_reply(rig)
            rig.line.inbox += before + reply + after
            self.assert_unaffected(rig, servo, 5)
