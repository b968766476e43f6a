"""Killed at any moment, the real autopilot comes up with all that it has acknowledged.

The proof kills it a thousand times, or `KILLS=100 pytest -m proof tests/process/test_kills.py`; the suite a few.
"""

import math
import os
import random
import threading
import time
from dataclasses import dataclass, field, replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hil.sim.process import AutopilotProcess
from support.asking_station import AskingStation, answered
from support.station import off_deg, yaw_deg

FEW, MANY = 2, int(os.environ.get("KILLS", "1000"))
SETTINGS = {"BOOT_RESUME": 2, "LOG_ENABLE": 0, "WP_RADIUS": 5.0}
MANUAL, STEERING, HOLD, AUTO, GUIDED = 0, 3, 4, 10, 15
ARM, SET_MODE, SET_HOME, SET_CURRENT, CHANGE_HEADING = 400, 176, 179, 224, 43002
HEARTBEAT, CURRENT, TARGET, HOME = 0, 42, 83, 242
UNACKNOWLEDGED_S = 0.2  # what is not acknowledged is on disk by then
SEEN_S = 5.0


@dataclass(frozen=True)
class Known:
    """What a station knows of the boat; None: anything."""

    armed: bool | None = None
    mode: int | None = None
    goal_deg: float | None = None
    current: int | None = None
    gain: float | None = None
    items: tuple[tuple[int, int], ...] | None = None
    home: tuple[int, int] | None = None

    def fits(self, found):
        """Whether the state that was found agrees with the expected one."""
        for name in ("armed", "mode", "current", "gain", "items", "home"):
            known = getattr(self, name)
            if known is not None and known != getattr(found, name):
                return False
        if self.goal_deg is None or self.mode not in (GUIDED, STEERING):
            return True
        return found.goal_deg is not None and abs(off_deg(found.goal_deg, self.goal_deg)) < 0.01


@dataclass
class Order:
    """A request of a station: how it is sent, when it is acknowledged, and the state expected then."""

    name: str
    send: (
        object  # station: sends it and returns a generator that is through when it is answered: whether it was accepted
    )
    known: object  # Known before: Known after


def arm(numbers, _known):
    wanted = numbers.random() < 0.6
    return Order(
        f"armed {wanted}",
        lambda station: answered(station, station.command(ARM, float(wanted), 21196.0), ARM),
        lambda known: replace(known, armed=wanted),
    )


def set_mode(numbers, _known):
    mode = numbers.choice((MANUAL, STEERING, HOLD, AUTO, GUIDED, GUIDED))
    # Entering a mode of headings takes the present one for the goal.
    return Order(
        f"mode {mode}",
        lambda station: answered(station, station.command(SET_MODE, 1.0, float(mode)), SET_MODE),
        lambda known: known if known.mode == mode else replace(known, mode=mode, goal_deg=None),
    )


def change_heading(numbers, _known):
    goal_deg = float(numbers.randrange(360))
    return Order(
        f"goal {goal_deg}",
        lambda station: answered(station, station.command(CHANGE_HEADING, 1.0, goal_deg), CHANGE_HEADING),
        lambda known: replace(known, goal_deg=goal_deg),
    )


def setpoint(numbers, _known):
    """Not acknowledged: seen in force, and a fifth of a second later it counts as if it were."""
    goal_deg = float(numbers.randrange(360))
    half_rad = math.radians(goal_deg) / 2.0
    q = [math.cos(half_rad), 0.0, 0.0, math.sin(half_rad)]

    def send(station):
        station.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0, q, 0.0, 0.0, 0.0, 0.0))
        yield
        give_up_s = time.monotonic() + SEEN_S
        while abs(off_deg(yaw_deg(station.request(TARGET).q), goal_deg)) > 0.01:
            if time.monotonic() > give_up_s:
                return None  # perhaps without a heading: unknown
            yield
        time.sleep(UNACKNOWLEDGED_S)
        return True

    return Order(f"setpoint {goal_deg}", send, lambda known: replace(known, goal_deg=goal_deg))


def set_current(numbers, known):
    number = numbers.randrange(1, 1 + len(known.items or (1,)))
    return Order(
        f"item {number}",
        lambda station: answered(station, station.command(SET_CURRENT, float(number)), SET_CURRENT),
        lambda known: replace(known, current=number),
    )


def set_gain(numbers, _known):
    gain = float(numbers.randrange(1, 200))

    def send(station):
        station.send(mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", gain, 9))
        while True:
            for one in station.messages():
                if one.get_type() == "PARAM_VALUE" and one.param_id == "CTL_K1":
                    return one.param_value == gain
            yield

    return Order(f"gain {gain}", send, lambda known: replace(known, gain=gain))


def set_home(numbers, _known):
    place = (numbers.randrange(-800_000_000, 800_000_000), numbers.randrange(-1_700_000_000, 1_700_000_000))
    message = mavlink.MAVLink_command_int_message(1, 1, 5, SET_HOME, 0, 0, 0.0, 0.0, 0.0, 0.0, *place, 0.0)
    return Order(
        f"home {place}",
        lambda station: answered(station, [message], SET_HOME),
        lambda known: replace(known, home=place),
    )


def new_mission(numbers, _known):
    """Far away, so that none of its items is reached."""
    places = tuple(
        (numbers.randrange(100_000_000, 800_000_000), numbers.randrange(10**9)) for _ in range(numbers.randrange(2, 5))
    )
    return Order(
        f"mission of {len(places)}",
        lambda station: station.upload(places),
        lambda known: replace(known, items=places, current=1),
    )


ORDERS = (
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
class Voyage:
    """A boat whose autopilot is killed again and again, and what its station knows."""

    boat: object
    station: AskingStation
    numbers: random.Random
    known: Known = field(default_factory=Known)
    possible: tuple[Known, ...] = ()
    orders: list[str] = field(default_factory=list)
    kills: int = 0

    def end(self):
        self.process._process.kill()
        self.process._process.wait()
        self.process._log.close()
        self.station.socket.close()

    def start(self):
        """Start an autopilot, and compare what it comes up with."""
        url = f"udpin:127.0.0.1:{self.station.connect()}"
        words = ["run", str(self.boat._vehicle), "--state", str(self.boat.state), "--link", url]
        self.process = AutopilotProcess(words, self.boat.directory / "firmware.log")
        self.station.gone = lambda: "" if self.process.running() else f"ended: {self.process.last_output()}"
        found = self.found()
        fitting = [known for known in self.possible or (self.known,) if known.fits(found)]
        assert fitting, f"kill {self.kills}: came up with\n{found}\nand not with any of\n{self.possible}\n{self.orders}"
        # Both may fit; what they know beyond each other may not be relied on.
        self.known = fitting[0] if len(fitting) == 1 else common(*fitting)
        self.orders.clear()

    def found(self):
        self.station.ask([mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)], lambda _one: True)
        heartbeat = self.station.request(HEARTBEAT)
        home = None if self.known.home is None else self.station.request(HOME)
        gain = self.station.ask(
            [mavlink.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1)],
            lambda one: one.param_value if one.get_type() == "PARAM_VALUE" and one.param_id == "CTL_K1" else None,
        )
        steering = heartbeat.custom_mode in (GUIDED, STEERING)
        return Known(
            armed=bool(heartbeat.base_mode & 128),
            mode=heartbeat.custom_mode,
            goal_deg=yaw_deg(self.station.request(TARGET).q) % 360.0
            if steering and self.known.goal_deg is not None
            else None,
            current=self.station.request(CURRENT).seq,
            gain=gain,
            items=self.station.download(),
            home=None if home is None else (home.latitude, home.longitude),
        )

    def order(self, *, answer):
        """Give an order; without an answer it may have come or not."""
        order = self.numbers.choice(ORDERS)(self.numbers, self.known)
        if self.known.mode not in (GUIDED, STEERING) and order.name.startswith(("goal", "setpoint")):
            order = set_mode(self.numbers, self.known)
        after = order.known(self.known)
        steps = order.send(self.station)
        if not answer:
            for _ in range(self.numbers.randrange(4)):
                next(steps, None)
            self.orders.append(f"{order.name}, unanswered")
            self.possible = (self.known, after)
            return
        accepted = finish(steps)
        self.orders.append(f"{order.name}{'' if accepted else ', refused'}")
        if accepted is None:
            self.known = common(self.known, after)
        elif accepted:
            self.known = after
        self.possible = (self.known,)

    def kill(self):
        """Kill it at any moment, most of them soon after the last word."""
        time.sleep(self.numbers.choice((0.0, self.numbers.uniform(0.0, 0.01), self.numbers.uniform(0.0, 0.3))))
        self.end()
        self.kills += 1


def finish(steps):
    """Go on until it is answered; return whether it was accepted, None when that is not known."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def common(first, second):
    """Return the fields in which both agree."""
    same = {
        name: getattr(first, name)
        for name in Known.__dataclass_fields__
        if getattr(first, name) == getattr(second, name)
    }
    return Known(**same)


@pytest.fixture
def voyage(make_boat):
    boat = make_boat(speed=None, settings=SETTINGS, without=("link",))
    made = Voyage(boat, AskingStation(), random.Random(20180825))
    ended = threading.Event()

    def live():
        while not ended.is_set():
            boat.time.step(boat.board, boat.now_s + 0.05)

    boat.time.begin(boat.board, None)
    devices = threading.Thread(target=live)
    devices.start()
    try:
        yield made
    finally:
        made.end()
        ended.set()
        devices.join()


@pytest.mark.parametrize("kills", [pytest.param(FEW, id="few"), pytest.param(MANY, id="many", marks=pytest.mark.proof)])
def test_after_a_kill_at_any_moment_all_acknowledged_requests_are_in_force(voyage, kills):
    begun_s = time.monotonic()
    for _ in range(kills):
        voyage.start()
        for _ in range(voyage.numbers.randrange(1, 5)):
            voyage.order(answer=True)
        if voyage.numbers.random() < 0.5:
            voyage.order(answer=False)
        voyage.kill()
    voyage.start()
    print(f"{voyage.kills} kills in {time.monotonic() - begun_s:.0f} s")
