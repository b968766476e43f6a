"""An adapter that holds answers back, loses, cuts or spoils them: none is ever judged by another question."""

import itertools
import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.actuator.dynamixel_registers import GOAL_READS
from firmware_py.actuator.volz import VolzOptions, volz_rudder
from firmware_py.common.records import DeviceState, RudderCommand

COUNT_RAD = 2.0 * math.pi / 4096
CONFIGURED_TICKS = 30
STEP_S = 0.005


class LateSail:
    """Ticks a driver as the loop does: between the ticks it is woken by bytes, and only while it needs_prompt_io.

    Each tick commands another angle; `angles` keeps it by the time at which it was sent.
    """

    def __init__(self, rudder, line, *, period_s=0.1):
        self.rudder, self.line, self.period_s = rudder, line, period_s
        self.now_s = 0.0
        self.number = 0
        self.states = []

    def tick(self, shaft_rad=None):
        """Return the feedback of a tick; without an angle the next one of a saw."""
        self.number += 1
        angle_rad = (self.number % 500) * 2 * COUNT_RAD if shaft_rad is None else shaft_rad
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

    def ticks(self, count, shaft_rad=None):
        return [sample for _ in range(count) for sample in self.tick(shaft_rad)]


class Noted:
    """A servo that remembers where its shaft was at each question."""

    def __init__(self, servo):
        self.servo = servo
        self.line = None
        self.positions_at = {}  # of a time
        self.asked_s = {}  # of a position, the last time

    def handle(self, data):
        answer = self.servo.handle(data)
        self.positions_at.setdefault(self.line.now_s, set()).add(self.servo.position)
        self.asked_s[self.servo.position] = self.line.now_s
        return answer

    def is_reported_truly(self, feedback):
        """Say whether all feedback says where the shaft was at its time."""
        return all(round(sample.shaft_rad / COUNT_RAD) + 2048 in self.positions_at[sample.t_s] for sample in feedback)


@pytest.fixture
def servo(fakes):
    return fakes.dynamixel()


def late_sail(fakes, servo, delay_s, rudder_of=None, **sail):
    noted = Noted(servo)
    line = noted.line = fakes.late_line(noted, delay_s, **({"baud": sail.pop("baud")} if "baud" in sail else {}))
    rudder = (rudder_of or (lambda line: dynamixel_rudder(line, DynamixelOptions())))(line)
    return LateSail(rudder, line, **sail), noted


@pytest.mark.parametrize("late_s", [0.02, 0.06, 0.12, 0.24, 0.33])
def test_an_adapter_that_holds_each_answer_back_is_no_fault(fakes, servo, late_s):
    sail, noted = late_sail(fakes, servo, lambda: late_s)
    sail.ticks(CONFIGURED_TICKS)
    sail.states.clear()
    servo.reads.clear()
    servo.ram_writes.clear()
    feedback = sail.ticks(200)
    assert set(sail.states) == {DeviceState.RUNNING}
    assert len(feedback) >= 120
    assert noted.is_reported_truly(feedback)
    assert servo.reads.count(48) == 0  # the limits are not read again, because no goal was rejected
    assert {address for address, _ in servo.ram_writes} == {116}
    assert len(servo.ram_writes) >= 120
    assert 64 in servo.reads  # and what goes wrong in the servo is still looked for


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("baud", "period_s"), [(57600, 0.1), (57600, 0.04), (1_000_000, 0.02)])
def test_an_answer_that_is_late_or_lost_now_and_then_changes_nothing(fakes, servo, seed, baud, period_s):
    chance = random.Random(seed)
    sail, noted = late_sail(
        fakes, servo, lambda: chance.choice([0.016] * 8 + [0.12, None]), baud=baud, period_s=period_s
    )
    sail.ticks(CONFIGURED_TICKS)
    sail.states.clear()
    servo.reads.clear()
    feedback = sail.ticks(300)
    assert set(sail.states) == {DeviceState.RUNNING}
    assert len(feedback) > 150
    assert noted.is_reported_truly(feedback)
    assert servo.reads.count(48) == 0


def test_a_rejected_goal_is_also_detected_by_late_replies(fakes, servo):
    sail, _ = late_sail(fakes, servo, lambda: 0.12)
    sail.ticks(CONFIGURED_TICKS)
    servo.refuse[116] = 7
    sail.ticks(20)
    assert sail.rudder.health(sail.now_s).text == "servo rejects goal position"
    servo.refuse.clear()
    sail.ticks(10)
    assert sail.rudder.health(sail.now_s).state is DeviceState.RUNNING


def test_what_goes_wrong_is_found_behind_an_adapter_that_is_always_late(fakes, servo):
    sail, _ = late_sail(fakes, servo, lambda: 0.12)
    sail.ticks(CONFIGURED_TICKS)
    servo.restart()
    sail.ticks(30)
    assert (servo.registers[64], servo.registers[98]) == (1, 100)
    servo.trip_watchdog()
    sail.ticks(30)
    assert servo.registers[98] == 100
    sail.ticks(30)
    feedback = sail.ticks(1)
    assert feedback[-1].restarts == 1


def test_an_answer_in_time_brings_the_short_question_back(fakes, servo):
    delay_s = [0.002]
    sail, _ = late_sail(fakes, servo, lambda: delay_s[0])
    sail.ticks(CONFIGURED_TICKS)
    longer = {look.address for look in GOAL_READS[1:]}
    for held_back_s, addresses in ((0.002, set()), (0.12, longer), (0.002, set())):
        delay_s[0] = held_back_s
        sail.ticks(4)
        servo.reads.clear()
        sail.ticks(60)
        assert {address for address in servo.reads if 99 < address < 116} == addresses


DELAYS = st.lists(st.sampled_from([0.0, 0.016, 0.05, 0.12, 0.21, 0.4, None]), min_size=1, max_size=40)


@given(DELAYS, st.sampled_from([0.1, 0.04, 0.02, 0.5]), st.sampled_from([57600, 1_000_000]))
def test_however_late_no_answer_is_said_to_be_newer_than_it_is_and_no_goal_is_said_to_be_refused(
    fakes, delays, period_s, baud
):
    servo = fakes.dynamixel()
    schedule = itertools.cycle([0.0] * 40)
    sail, noted = late_sail(fakes, servo, lambda: next(schedule), period_s=period_s, baud=baud)
    sail.ticks(CONFIGURED_TICKS)
    sail.states.clear()
    sail.line.delay_s = iter([*delays, *[0.0] * 10_000]).__next__
    for _ in range(len(delays) + 5):
        for sample in sail.tick():
            assert sample.t_s <= noted.asked_s[round(sample.shaft_rad / COUNT_RAD) + 2048]
    assert DeviceState.FAULTY not in sail.states
    quiet = sail.ticks(round(3.0 / period_s) + 5)
    assert noted.is_reported_truly(quiet[-3:])
    assert quiet[-1].t_s >= sail.now_s - 2.0 * period_s - 1e-6
    assert sail.states[-1] is DeviceState.RUNNING
    assert servo.goal == servo.position


def test_a_volz_behind_such_an_adapter_is_said_to_be_where_it_was_at_the_time(fakes):
    servo = fakes.volz()
    sail, noted = late_sail(fakes, servo, lambda: 0.12, lambda line: volz_rudder(line, VolzOptions()), baud=115_200)
    sail.ticks(10)
    before = len(sail.line.request_times_s)
    feedback = [sample for _ in range(100) for sample in sail.tick()]
    radians_per_count = math.radians(100.0) / 0x0780
    assert len(feedback) >= 40
    for sample in feedback:
        assert round(sample.shaft_rad / radians_per_count) + 0x0800 in noted.positions_at[sample.t_s]
    assert len(sail.line.request_times_s) > before
    assert set(sail.states[10:]) == {DeviceState.RUNNING}


class TestSpoiled:
    """What cheap adapters do to the bytes, while the goal changes each tick."""

    @pytest.fixture
    def sail(self, fakes, servo):
        noted = Noted(servo)
        line = noted.line = fakes.line(noted)
        line.now_s = 0.0
        sail = LateSail(dynamixel_rudder(line, DynamixelOptions()), line)
        sail.ticks(CONFIGURED_TICKS)
        servo.reads.clear()
        sail.states.clear()
        sail.noted = noted
        return sail

    def answer(self, sail):
        """Take away what lies on the line after a tick in which nothing but the goal is asked for."""
        while True:
            sail.tick()
            if sail.line.inbox:
                whole = bytes(sail.line.inbox)
                sail.line.inbox.clear()
                return whole

    def steers_on(self, sail, servo, ticks=20):
        feedback = sail.ticks(ticks)
        assert sail.noted.is_reported_truly(feedback)
        assert len(feedback) >= ticks - 2
        assert set(sail.states) == {DeviceState.RUNNING}
        assert servo.reads.count(48) == 0
        return True

    def test_an_answer_cut_in_two_over_two_ticks(self, sail, servo):
        for cut in range(1, 42, 5):
            whole = self.answer(sail)
            sail.line.inbox += whole[:cut]
            sail.tick()
            rest, sail.line.inbox = bytes(sail.line.inbox), bytearray()
            sail.line.inbox += whole[cut:] + rest
            assert self.steers_on(sail, servo)

    def test_an_answer_with_a_byte_missing(self, sail, servo):
        for missing in range(42):
            whole = self.answer(sail)
            sail.line.inbox += whole[:missing] + whole[missing + 1 :]
            assert self.steers_on(sail, servo, 3)

    def test_an_echo_with_a_byte_missing_before_the_answer(self, sail, servo):
        sail.line.echo = True
        whole = self.answer(sail)
        echo = sail.line.written[-1]
        assert whole.startswith(echo)
        for missing in range(len(echo)):
            whole = self.answer(sail)
            sail.line.inbox += whole[:missing] + whole[missing + 1 :]
            assert self.steers_on(sail, servo, 3)

    @pytest.mark.parametrize("garbage", [b"\0", b"\xff\xff\xfd", b"\xff\xff\xfd\x00\x01\x23\x00\x55", bytes(200)])
    def test_garbage_before_between_and_behind(self, sail, servo, garbage):
        for before, behind in ((garbage, b""), (b"", garbage), (garbage, garbage)):
            whole = self.answer(sail)
            sail.line.inbox += before + whole + behind
            assert self.steers_on(sail, servo, 5)
