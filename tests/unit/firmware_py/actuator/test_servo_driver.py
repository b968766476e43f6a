"""The skeleton of the servo drivers, around a servo that answers with what it was asked."""

import math
from dataclasses import dataclass

import pytest

from firmware_py.actuator.servo_driver import MAX_FEEDBACK, ReplyResult, ServoDriver
from firmware_py.common.records import DeviceRole, DeviceState, RudderCommand, RudderFeedback


@dataclass(frozen=True)
class Question:
    frame: bytes


class WholeReads:
    """Takes each read for one reply."""

    rejected = 0

    def __init__(self):
        self.clears = 0

    def clear(self):
        self.clears += 1

    def feed(self, data):
        return [data] if data else []


class PlainServo:
    """Sends the angle of each command once; a reply is right when it repeats the question."""

    device_id = 7

    def __init__(self):
        self.parser = WholeReads()
        self.due = None
        self.commands, self.sent, self.lost, self.answered = [], [], [], []
        self.restarts = self.silences = 0

    def restart(self):
        self.restarts += 1

    def command(self, shaft_rad, now_s, *, torque_on):
        self.commands.append((shaft_rad, now_s, torque_on))
        self.due = Question(repr(shaft_rad).encode())

    def next_request(self, now_s):
        return self.due

    def note_sent(self, request, now_s):
        self.due = None
        self.sent.append((request.frame, now_s))

    def note_lost(self, request):
        self.lost.append(request.frame)

    def note_silence(self):
        self.silences += 1

    def needs_prompt_io(self):
        return self.due is not None

    def answers(self, reply, request):
        return reply == request.frame

    def process_reply(self, request, reply, now_s, *, is_certain):
        self.answered.append((request.frame, is_certain))
        if reply == b"None":
            return ReplyResult(is_accepted=False)
        return ReplyResult(invalid_values=1, feedback=RudderFeedback(now_s, float(reply), None, None, None))

    def condition(self, *, answered):
        return (DeviceState.RUNNING if answered else DeviceState.STARTING), "well"


@pytest.fixture
def servo():
    return PlainServo()


@pytest.fixture
def line(fakes):
    return fakes.line()


@pytest.fixture
def driver(line, servo):
    return ServoDriver(line, servo, reply_timeout_s=0.02)


@pytest.mark.parametrize("reply_timeout_s", [0.0, 2.0, math.nan])
def test_a_wait_for_replies_that_cannot_be_is_refused(line, servo, reply_timeout_s):
    with pytest.raises(ValueError, match="allowed"):
        ServoDriver(line, servo, reply_timeout_s=reply_timeout_s)


def reply(line, driver, data, now_s):
    line.inbox += data
    driver.receive(now_s)


def test_a_command_goes_out_at_once_and_its_answer_becomes_feedback(line, driver, servo):
    driver.command(RudderCommand(0.5, torque_on=True), 1.0)
    assert line.written == [b"0.5"]
    assert driver.health(1.0).state is DeviceState.STARTING
    reply(line, driver, b"0.5", 1.01)
    assert [(sample.t_s, sample.shaft_rad) for sample in driver.poll()] == [(1.0, 0.5)]
    assert driver.poll() == ()
    health = driver.health(1.02)
    assert (health.role, health.state, health.text) == (DeviceRole.RUDDER, DeviceState.RUNNING, "well")
    assert (health.accepted, health.rejected) == (1, 1)  # an answer, and one value in it that cannot be


def test_one_question_at_a_time_and_the_next_when_the_reply_is_given_up(line, driver, servo):
    driver.command(RudderCommand(0.1, torque_on=True), 1.0)
    driver.command(RudderCommand(0.2, torque_on=True), 1.01)
    assert line.written == [b"0.1"]
    driver.receive(1.02)
    assert line.written == [b"0.1", b"0.2"]
    assert servo.lost == [b"0.1"]
    reply(line, driver, b"0.1", 1.03)  # late: it still says how things were when it was asked for
    assert [(sample.t_s, sample.shaft_rad) for sample in driver.poll()] == [(1.0, 0.1)]
    reply(line, driver, b"0.2", 1.03)
    assert [(sample.t_s, sample.shaft_rad) for sample in driver.poll()] == [(1.02, 0.2)]
    reply(line, driver, b"0.1", 1.03)  # once more: it answers nothing now
    assert driver.poll() == ()
    assert driver.health(1.03).rejected == 2 + 1  # a value in each answer that cannot be


def test_a_reply_that_may_be_a_later_one_is_taken_for_the_older_and_the_bus_is_free(line, driver, servo):
    for now_s in (1.0, 1.1):
        driver.command(RudderCommand(0.1, torque_on=True), now_s)
    driver.command(RudderCommand(0.2, torque_on=True), 1.11)
    reply(line, driver, b"0.1", 1.112)
    assert [sample.t_s for sample in driver.poll()] == [1.0]
    assert servo.answered == [(b"0.1", False)]
    assert servo.lost == [b"0.1", b"0.1"]  # that of the second has come, or has not
    assert line.written[-1] == b"0.2"


def test_a_reply_is_waited_for_only_when_something_waits_for_the_bus(line, driver, servo):
    servo.due = Question(b"later")
    assert not driver.needs_prompt_io()  # nothing is awaited
    servo.due = None
    driver.command(RudderCommand(0.1, torque_on=True), 1.0)
    assert not driver.needs_prompt_io()
    driver.command(RudderCommand(0.2, torque_on=True), 1.01)
    assert driver.needs_prompt_io()
    reply(line, driver, b"0.1", 1.012)
    assert line.written == [b"0.1", b"0.2"]
    assert not driver.needs_prompt_io()


def test_a_goal_that_is_not_finite_is_refused_and_the_last_one_kept(line, driver, servo):
    for number, shaft_rad in enumerate((math.nan, 0.3, math.inf)):
        driver.command(RudderCommand(shaft_rad, torque_on=True), float(number))
    assert [shaft_rad for shaft_rad, _, _ in servo.commands] == [None, 0.3, 0.3]
    assert driver.health(2.0).rejected == 2


def test_a_refusal_is_counted_and_is_an_answer(line, driver, servo):
    driver.command(RudderCommand(math.nan, torque_on=True), 0.0)
    reply(line, driver, b"None", 0.01)
    health = driver.health(0.01)
    assert (health.state, health.accepted, health.rejected) == (DeviceState.RUNNING, 0, 2)


def test_silence_is_passed_to_the_servo_and_to_the_health(line, driver, servo):
    for tick in range(8):
        driver.command(RudderCommand(0.1, torque_on=True), 0.1 * tick)
    assert servo.silences > 0
    health = driver.health(0.8)
    assert (health.state, health.text) == (DeviceState.STARTING, "no reply from servo id 7")
    reply(line, driver, b"0.1", 0.81)
    assert driver.health(0.81).state is DeviceState.RUNNING
    for tick in range(8):
        driver.command(RudderCommand(0.1, torque_on=True), 1.0 + 0.1 * tick)
    assert driver.health(1.8).state is DeviceState.SILENT


def test_a_closed_line_gets_no_data_and_a_reopened_one_starts_again(line, driver, servo):
    driver.command(RudderCommand(0.1, torque_on=True), 0.0)
    reply(line, driver, b"0.1", 0.01)
    line.unplug()
    driver.command(RudderCommand(0.2, torque_on=True), 0.1)
    assert line.written == [b"0.1"]
    assert (driver.fileno(), driver.health(0.1).state) == (-1, DeviceState.ABSENT)
    line.plug()
    driver.receive(0.2)
    assert (servo.restarts, servo.parser.clears) == (1, 1)
    assert line.written == [b"0.1", b"0.2"]
    assert driver.health(0.2).state is DeviceState.STARTING


def test_a_line_that_takes_nothing_is_tried_again(line, driver, servo):
    line.full = True
    driver.command(RudderCommand(0.1, torque_on=True), 0.0)
    assert servo.sent == []
    line.full = False
    driver.receive(0.01)
    assert servo.sent == [(b"0.1", 0.01)]


def test_feedback_without_polls_is_bounded(line, driver):
    for number in range(3 * MAX_FEEDBACK):
        driver.command(RudderCommand(float(number), torque_on=True), float(number))
        reply(line, driver, repr(float(number)).encode(), number + 0.01)
    assert [sample.shaft_rad for sample in driver.poll()] == [
        float(number) for number in range(2 * MAX_FEEDBACK, 3 * MAX_FEEDBACK)
    ]
