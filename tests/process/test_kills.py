"""After a kill at any moment the autopilot starts with all acknowledged requests in force.

The test suite kills it a few times. The proof kills it a thousand times, or as often as `KILLS` says:
`KILLS=100 pytest -m proof tests/process/test_kills.py`.
"""

import math
import os
import random
import time
from dataclasses import dataclass, field, replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hil.sim.process import AutopilotProcess
from support.processes import running_devices
from support.retrying_station import RetryingStation, send_once
from support.station import off_deg, yaw_deg

FEW_KILLS, MANY_KILLS = 2, int(os.environ.get("KILLS", "1000"))
SETTINGS = {"BOOT_RESUME": 2, "LOG_ENABLE": 0, "WP_RADIUS": 5.0}
MANUAL, STEERING, HOLD, AUTO, GUIDED = 0, 3, 4, 10, 15
ARM, SET_MODE, SET_HOME, SET_CURRENT, CHANGE_HEADING = 400, 176, 179, 224, 43002
HEARTBEAT, CURRENT, TARGET, HOME = 0, 42, 83, 242
FORCE_ARM = 21196.0  # skips the arming checks
STORAGE_DELAY_S = 0.2  # until an unacknowledged request is on disk
TIMEOUT_S = 5.0


@dataclass(frozen=True)
class ExpectedState:
    """State that a ground station expects of the boat; None: any value."""

    armed: bool | None = None
    mode: int | None = None
    goal_deg: float | None = None
    current: int | None = None
    gain: float | None = None
    items: tuple[tuple[int, int], ...] | None = None
    home: tuple[int, int] | None = None

    def fits(self, actual):
        """Return whether the actual state agrees with the expected one."""
        for name in ("armed", "mode", "current", "gain", "items", "home"):
            expected = getattr(self, name)
            if expected is not None and expected != getattr(actual, name):
                return False
        if self.goal_deg is None or self.mode not in (GUIDED, STEERING):
            return True
        return actual.goal_deg is not None and abs(off_deg(actual.goal_deg, self.goal_deg)) < 0.01


@dataclass
class Request:
    """A request of a ground station.

    `send` gets the station and returns a generator that ends at the acknowledgement and returns whether the request was
    accepted. `change` returns the state expected after the request from the state before it.
    """

    name: str
    send: object
    change: object


def command_request(name, number, *values, **changes):
    """Return a command that changes these fields of the state."""
    return Request(
        name,
        lambda station: send_once(station, station.command(number, *values), number),
        lambda expected: replace(expected, **changes),
    )


def arm(rng, _expected):
    arms = rng.random() < 0.6
    return command_request(f"armed {arms}", ARM, float(arms), FORCE_ARM, armed=arms)


def set_mode(rng, expected):
    mode = rng.choice((MANUAL, STEERING, HOLD, AUTO, GUIDED, GUIDED))
    # Another mode that steers headings starts with the present heading as goal.
    changes = {} if expected.mode == mode else {"mode": mode, "goal_deg": None}
    return command_request(f"mode {mode}", SET_MODE, 1.0, float(mode), **changes)


def change_heading(rng, _expected):
    goal_deg = float(rng.randrange(360))
    return command_request(f"goal {goal_deg}", CHANGE_HEADING, 1.0, goal_deg, goal_deg=goal_deg)


def set_current(rng, expected):
    number = rng.randrange(1, 1 + len(expected.items or (1,)))
    return command_request(f"item {number}", SET_CURRENT, float(number), current=number)


def setpoint(rng, _expected):
    """Return a setpoint, which has no acknowledgement: it is accepted when it is in force and stored."""
    goal_deg = float(rng.randrange(360))
    half_rad = math.radians(goal_deg) / 2.0
    q = [math.cos(half_rad), 0.0, 0.0, math.sin(half_rad)]

    def send(station):
        station.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0, q, 0.0, 0.0, 0.0, 0.0))
        yield
        end_s = time.monotonic() + TIMEOUT_S
        while abs(off_deg(yaw_deg(station.request(TARGET).q), goal_deg)) > 0.01:
            if time.monotonic() > end_s:
                return None  # unknown, as the heading may be invalid
            yield
        time.sleep(STORAGE_DELAY_S)
        return True

    return Request(f"setpoint {goal_deg}", send, lambda expected: replace(expected, goal_deg=goal_deg))


def set_gain(rng, _expected):
    gain = float(rng.randrange(1, 200))

    def send(station):
        station.send(mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", gain, mavlink.MAV_PARAM_TYPE_REAL32))
        while True:
            for message in station.messages():
                if message.get_type() == "PARAM_VALUE" and message.param_id == "CTL_K1":
                    return message.param_value == gain
            yield

    return Request(f"gain {gain}", send, lambda expected: replace(expected, gain=gain))


def set_home(rng, _expected):
    position = (rng.randrange(-800_000_000, 800_000_000), rng.randrange(-1_700_000_000, 1_700_000_000))
    message = mavlink.MAVLink_command_int_message(1, 1, 5, SET_HOME, 0, 0, 0.0, 0.0, 0.0, 0.0, *position, 0.0)
    return Request(
        f"home {position}",
        lambda station: send_once(station, [message], SET_HOME),
        lambda expected: replace(expected, home=position),
    )


def new_mission(rng, _expected):
    """Return a mission far away, so that no item is reached."""
    positions = tuple(
        (rng.randrange(100_000_000, 800_000_000), rng.randrange(10**9)) for _ in range(rng.randrange(2, 5))
    )
    return Request(
        f"mission of {len(positions)}",
        lambda station: station.upload(positions),
        lambda expected: replace(expected, items=positions, current=1),
    )


# Modes and goals are changed twice as often as the others.
REQUESTS = (
    arm,
    set_mode,
    set_mode,
    change_heading,
    change_heading,
    setpoint,
    set_current,
    set_gain,
    set_home,
    new_mission,
)


@dataclass
class KillRig:
    """A boat whose autopilot is killed repeatedly, and the state that its ground station expects."""

    boat: object
    station: RetryingStation
    rng: random.Random
    expected: ExpectedState = field(default_factory=ExpectedState)
    possible: tuple[ExpectedState, ...] = ()
    requests: list[str] = field(default_factory=list)
    kills: int = 0

    def end(self):
        self.process._process.kill()
        self.process._process.wait()
        self.process._log.close()
        self.station.socket.close()

    def start(self):
        """Start an autopilot and compare its state with the expected ones."""
        url = f"udpin:127.0.0.1:{self.station.connect()}"
        words = ["run", str(self.boat._vehicle), "--state", str(self.boat.state), "--link", url]
        self.process = AutopilotProcess(words, self.boat.directory / "firmware.log")
        self.station.end_reason = lambda: "" if self.process.running() else f"ended: {self.process.last_output()}"
        actual = self.read_state()
        fitting = [expected for expected in self.possible or (self.expected,) if expected.fits(actual)]
        assert fitting, f"kill {self.kills}: started with\n{actual}\nexpected one of\n{self.possible}\n{self.requests}"
        # If two states fit, only their common fields are reliable.
        self.expected = fitting[0] if len(fitting) == 1 else common_state(*fitting)
        self.requests.clear()

    def read_state(self):
        """Request the state of the boat."""
        self.station.ask(
            [mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)],
            lambda _message: True,
        )
        heartbeat = self.station.request(HEARTBEAT)
        home = None if self.expected.home is None else self.station.request(HOME)
        gain = self.station.ask(
            [mavlink.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1)],
            lambda message: (
                message.param_value if message.get_type() == "PARAM_VALUE" and message.param_id == "CTL_K1" else None
            ),
        )
        has_goal = heartbeat.custom_mode in (GUIDED, STEERING) and self.expected.goal_deg is not None
        return ExpectedState(
            armed=bool(heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            mode=heartbeat.custom_mode,
            goal_deg=yaw_deg(self.station.request(TARGET).q) % 360.0 if has_goal else None,
            current=self.station.request(CURRENT).seq,
            gain=gain,
            items=self.station.download(),
            home=None if home is None else (home.latitude, home.longitude),
        )

    def send_request(self, *, is_acknowledged):
        """Send a random request; without waiting for the acknowledgement, it may be in force or not."""
        request = self.rng.choice(REQUESTS)(self.rng, self.expected)
        if self.expected.mode not in (GUIDED, STEERING) and request.name.startswith(("goal", "setpoint")):
            request = set_mode(self.rng, self.expected)
        next_state = request.change(self.expected)
        steps = request.send(self.station)
        if not is_acknowledged:
            for _ in range(self.rng.randrange(4)):
                next(steps, None)
            self.requests.append(f"{request.name}, not acknowledged")
            self.possible = (self.expected, next_state)
            return
        accepted = finish_request(steps)
        self.requests.append(f"{request.name}{'' if accepted else ', refused'}")
        if accepted is None:
            self.expected = common_state(self.expected, next_state)
        elif accepted:
            self.expected = next_state
        self.possible = (self.expected,)

    def kill(self):
        """Kill the autopilot at a random time, mostly soon after the last message."""
        time.sleep(self.rng.choice((0.0, self.rng.uniform(0.0, 0.01), self.rng.uniform(0.0, 0.3))))
        self.end()
        self.kills += 1


def finish_request(steps):
    """Wait for the acknowledgement; return whether the request was accepted, None if unknown."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def common_state(first, second):
    """Return the state of the fields that are equal in both."""
    common_fields = {
        name: getattr(first, name)
        for name in ExpectedState.__dataclass_fields__
        if getattr(first, name) == getattr(second, name)
    }
    return ExpectedState(**common_fields)


@pytest.fixture
def rig(make_boat):
    boat = make_boat(speed=None, settings=SETTINGS, without=("link",))
    rig = KillRig(boat, RetryingStation(), random.Random(20180825))
    with running_devices(boat):
        try:
            yield rig
        finally:
            rig.end()


@pytest.mark.parametrize(
    "kills", [pytest.param(FEW_KILLS, id="few"), pytest.param(MANY_KILLS, id="many", marks=pytest.mark.proof)]
)
def test_acknowledged_requests_are_in_force_after_a_kill_at_any_moment(rig, kills):
    start_s = time.monotonic()
    for _ in range(kills):
        rig.start()
        for _ in range(rig.rng.randrange(1, 5)):
            rig.send_request(is_acknowledged=True)
        if rig.rng.random() < 0.5:
            rig.send_request(is_acknowledged=False)
        rig.kill()
    rig.start()
    print(f"{rig.kills} kills in {time.monotonic() - start_s:.0f} s")
