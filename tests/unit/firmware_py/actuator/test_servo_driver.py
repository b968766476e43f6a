"""Common part of the servo drivers, with a servo that repeats the request as its reply."""

import math
from dataclasses import dataclass

import pytest

from firmware_py.actuator.servo_driver import ReplyResult, ServoDriver
from firmware_py.common.records import DeviceRole, DeviceState, RudderCommand, RudderFeedback

MAX_FEEDBACK = 8


@dataclass(frozen=True)
class Request:
    frame: bytes


class ChunkParser:
    """Returns each chunk of bytes as one reply."""

    rejected = 0

    def __init__(self):
        self.clears = 0

    def clear(self):
        self.clears += 1

    def feed(self, data):
        return [data] if data else []


class EchoServo:
    """Sends the angle of each command once; a reply is valid if it repeats the request."""

    label = "servo id 7"

    def __init__(self):
        self.parser = ChunkParser()
        self.due = None
        self.commands, self.sent, self.lost, self.processed = [], [], [], []
        self.restarts = self.silences = 0

    def restart(self):
        self.restarts += 1

    def command(self, shaft_rad, now_s, *, torque_on):
        self.commands.append((shaft_rad, now_s, torque_on))
        self.due = Request(repr(shaft_rad).encode())

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

    def matches(self, reply, request):
        return reply == request.frame

    def process_reply(self, request, reply, now_s, *, is_certain):
        self.processed.append((request.frame, is_certain))
        if reply == b"None":
            return ReplyResult(is_accepted=False)
        return ReplyResult(invalid_values=1, feedback=RudderFeedback(now_s, float(reply), None, None, None))

    def condition(self, *, has_replied):
        return (DeviceState.RUNNING if has_replied else DeviceState.STARTING), "well"


@pytest.fixture
def servo():
    return EchoServo()


@pytest.fixture
def line(fakes):
    return fakes.line()


@pytest.fixture
def driver(line, servo):
    return ServoDriver(line, servo, reply_timeout_s=0.02)


@pytest.mark.parametrize("reply_timeout_s", [0.0, 1.01, math.nan])
def test_invalid_reply_timeout_is_rejected(line, servo, reply_timeout_s):
    ServoDriver(line, servo, reply_timeout_s=1.0)
    with pytest.raises(ValueError, match="allowed"):
        ServoDriver(line, servo, reply_timeout_s=reply_timeout_s)


def reply(line, driver, data, now_s):
    line.inbox += data
    driver.receive(now_s)


def test_command_is_sent_at_once_and_its_reply_becomes_feedback(line, driver, servo):
    driver.command(RudderCommand(0.5, torque_on=True), 1.0)
    assert line.written == [b"0.5"]
    assert driver.health(1.0).state is DeviceState.STARTING
    reply(line, driver, b"0.5", 1.01)
    assert [(sample.t_s, sample.shaft_rad) for sample in driver.poll()] == [(1.0, 0.5)]
    assert driver.poll() == ()
    health = driver.health(1.02)
    assert (health.role, health.state, health.text) == (DeviceRole.RUDDER, DeviceState.RUNNING, "well")
    assert (health.accepted, health.rejected) == (1, 1)  # one reply, and one invalid value in it


def test_next_request_is_sent_after_the_reply_timeout(line, driver, servo):
    driver.command(RudderCommand(0.1, torque_on=True), 1.0)
    driver.command(RudderCommand(0.2, torque_on=True), 1.01)
    assert line.written == [b"0.1"]
    driver.receive(1.02)
    assert line.written == [b"0.1", b"0.2"]
    assert servo.lost == [b"0.1"]
    reply(line, driver, b"0.1", 1.03)  # late; its values are from the time of the request
    assert [(sample.t_s, sample.shaft_rad) for sample in driver.poll()] == [(1.0, 0.1)]
    reply(line, driver, b"0.2", 1.03)
    assert [(sample.t_s, sample.shaft_rad) for sample in driver.poll()] == [(1.02, 0.2)]
    reply(line, driver, b"0.1", 1.03)  # no request is left
    assert driver.poll() == ()
    assert driver.health(1.03).rejected == 2 + 1  # an invalid value in two replies, and the reply without a request


def test_ambiguous_reply_is_assigned_to_the_older_request_and_frees_the_bus(line, driver, servo):
    for now_s in (1.0, 1.1):
        driver.command(RudderCommand(0.1, torque_on=True), now_s)
    driver.command(RudderCommand(0.2, torque_on=True), 1.11)
    reply(line, driver, b"0.1", 1.112)
    assert [sample.t_s for sample in driver.poll()] == [1.0]
    assert servo.processed == [(b"0.1", False)]
    assert servo.lost == [b"0.1", b"0.1"]  # it is unknown whether the second reply has arrived
    assert line.written[-1] == b"0.2"


def test_prompt_io_is_needed_only_while_another_request_is_due(line, driver, servo):
    servo.due = Request(b"later")
    assert not driver.needs_prompt_io()
    servo.due = None
    driver.command(RudderCommand(0.1, torque_on=True), 1.0)
    assert not driver.needs_prompt_io()
    driver.command(RudderCommand(0.2, torque_on=True), 1.01)
    assert driver.needs_prompt_io()
    reply(line, driver, b"0.1", 1.012)
    assert line.written == [b"0.1", b"0.2"]
    assert not driver.needs_prompt_io()


def test_goal_that_is_not_finite_is_rejected_and_the_last_one_kept(line, driver, servo):
    for number, shaft_rad in enumerate((math.nan, 0.3, math.inf)):
        driver.command(RudderCommand(shaft_rad, torque_on=True), float(number))
    assert [shaft_rad for shaft_rad, _, _ in servo.commands] == [None, 0.3, 0.3]
    assert driver.health(2.0).rejected == 2


def test_rejection_by_the_servo_is_counted_and_shows_that_it_replies(line, driver, servo):
    driver.command(RudderCommand(math.nan, torque_on=True), 0.0)
    reply(line, driver, b"None", 0.01)
    health = driver.health(0.01)
    assert (health.state, health.accepted, health.rejected) == (DeviceState.RUNNING, 0, 2)


def test_silence_is_reported_to_the_servo_and_in_the_health(line, driver, servo):
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


@pytest.mark.parametrize("is_commanded", [False, True])
def test_reopened_line_restarts_the_servo(line, driver, servo, is_commanded):
    driver.command(RudderCommand(0.1, torque_on=True), 0.0)
    reply(line, driver, b"0.1", 0.01)
    line.unplug()
    driver.command(RudderCommand(0.2, torque_on=True), 0.1)
    assert line.written == [b"0.1"]
    assert (driver.fileno(), driver.health(0.1).state) == (-1, DeviceState.ABSENT)
    line.plug()
    if is_commanded:
        driver.command(RudderCommand(0.2, torque_on=True), 0.2)
    else:
        driver.receive(0.2)
    assert (servo.restarts, servo.parser.clears) == (1, 1)
    assert line.written == [b"0.1", b"0.2"]
    assert driver.health(0.2).state is DeviceState.STARTING


def test_request_is_repeated_after_a_blocked_line(line, driver, servo):
    line.full = True
    driver.command(RudderCommand(0.1, torque_on=True), 0.0)
    assert servo.sent == []
    line.full = False
    driver.receive(0.01)
    assert servo.sent == [(b"0.1", 0.01)]


def test_feedback_without_polls_is_limited(line, driver):
    for number in range(3 * MAX_FEEDBACK):
        driver.command(RudderCommand(float(number), torque_on=True), float(number))
        reply(line, driver, repr(float(number)).encode(), number + 0.01)
    newest = [float(number) for number in range(2 * MAX_FEEDBACK, 3 * MAX_FEEDBACK)]
    assert [sample.shaft_rad for sample in driver.poll()] == newest
