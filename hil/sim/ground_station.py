"""The operator: arms the boat, sets GUIDED and gives the goals of the run over MAVLink."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from firmware_py.common.angles import compass_degrees
from firmware_py.common.mode_table import Mode
from hil.sim.goals import Goal
from hil.sim.mavlink_tap import MavlinkTap

SYSTEM = 255
COMPONENT = dialect.MAV_COMP_ID_MISSIONPLANNER
GUIDED = Mode.GUIDED.value
MODE_NAMES = {mode.value: mode.name for mode in Mode}
CHANGE_HEADING = 43002  # MAV_CMD_GUIDED_CHANGE_HEADING, of the ardupilotmega dialect
HEADING_TYPE = 1.0
HEARTBEAT_S = 1.0
RETRY_S = 0.5
REACTION_S = 0.02  # a person's program answers soon, not at once
PATIENCE_S = 60.0
READY_PATIENCE_S = 10.0  # then the boat is armed all the same, so that its refusal is told
READY_S = 0.2  # between questions
TEXTS_KEPT = 4096
MAX_TEXT_LENGTH = 200


@dataclass(slots=True)
class Order:
    """One command of the operator and what became of it."""

    text: str
    due_s: float
    command: int
    parameters: tuple[float, ...]
    goal: Goal | None = None
    first_sent_s: float | None = None
    accepted_s: float | None = None
    confirmation: int = 0
    refusal: str = ""
    left: bool = False  # to somebody else who steers


def disarm(due_s: float) -> Order:
    """Return the order to disarm."""
    return Order("disarming", due_s, dialect.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,))


class GroundStation:
    """A ground station as a device on the far end of the link's serial line.

    Like a careful operator it asks whether the boat is ready before it arms it. Orders are given one after the
    other, each repeated every half second until it is acknowledged as accepted; a goal that is still open when the
    next one is due is left. Where others steer too (`shared`), a goal that is refused in a mode that they have set is
    left to them, and `gave_way` says so. One that `hails` speaks first, for links that serve only who has spoken.
    """

    def __init__(self, goals: Sequence[Goal], mode: int = GUIDED, *, shared: bool = False, hails: bool = False) -> None:
        """Take the goals in order of time, and the mode to set; without goals GUIDED is not set."""
        self._mode, self._shared = mode, shared
        self.gave_way = ""
        arm = Order("arming", 0.0, dialect.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,))
        enter = Order(f"mode {MODE_NAMES.get(mode, mode)}", 0.0, dialect.MAV_CMD_DO_SET_MODE, (1.0, float(mode)))
        steer = [
            Order(
                f"goal {goal.heading_deg:g} deg at {goal.t_s:g} s",
                goal.t_s,
                CHANGE_HEADING,
                (HEADING_TYPE, compass_degrees(goal.heading_rad)),
                goal,
            )
            for goal in goals
        ]
        self.orders: tuple[Order, ...] = (arm, enter, *steer) if goals or mode != GUIDED else ()
        self.heartbeat: Any | None = None
        self.silent = False
        self.texts: deque[tuple[float, int, str]] = deque(maxlen=TEXTS_KEPT)
        self.reached: deque[tuple[float, int]] = deque(maxlen=TEXTS_KEPT)  # items of the mission, and when
        self._open = deque(self.orders)
        self._tap = MavlinkTap(
            (
                dialect.MAVLINK_MSG_ID_HEARTBEAT,
                dialect.MAVLINK_MSG_ID_COMMAND_ACK,
                dialect.MAVLINK_MSG_ID_STATUSTEXT,
                dialect.MAVLINK_MSG_ID_SYS_STATUS,
                dialect.MAVLINK_MSG_ID_MISSION_ITEM_REACHED,
            )
        )
        self._sender = dialect.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        self._vehicle: int | None = None
        self._text_id = 0
        self._unsent: list[Any] = []
        self._heartbeat_s = 0.0 if hails else math.inf
        self._order_s = math.inf
        self._ready_by_s = math.inf  # no order before the boat is ready, or this

    # The Emulator that the board of lines sees.

    def receive(self, now_s: float, data: bytes) -> None:
        """Take what the autopilot says."""
        for message in self._tap.feed(data):
            self._RECEIVERS[message.get_type()](self, now_s, message)

    def next_output_s(self) -> float:
        """When the next heartbeat or command is due; infinity before the autopilot has been heard."""
        return min(self._heartbeat_s, self._order_s)

    def take_output(self, now_s: float) -> bytes:
        """Return the frames that are due."""
        frames = []
        if self._heartbeat_s <= now_s:
            self._heartbeat_s += HEARTBEAT_S
            frames.append(self._heartbeat())
            frames += [self._pack(message) for message in self._unsent]
            self._unsent.clear()
        if self._order_s <= now_s:
            self._leave_overtaken(now_s)
            frames.append(self._give(self._open[0], now_s) if now_s >= self._ready_by_s else self._ask_ready(now_s))
        return b"" if self.silent else b"".join(frames)

    # What the run and its display ask.

    def order(self, order: Order, now_s: float) -> None:
        """Give one more order, after those that are open, once there is somebody to give it to."""
        self._open.append(order)
        if self._vehicle is not None:
            self._plan(now_s)

    def tell(self, message: Any) -> None:
        """Send a message with the next heartbeat, once."""
        self._unsent.append(message)

    def named_value(self, name: str) -> float | None:
        """The last NAMED_VALUE_FLOAT of a name, or None."""
        message = self._tap.latest(name)
        return None if message is None else float(message.value)

    def mode(self) -> str:
        """The mode and whether the boat is armed, as the last heartbeat says."""
        if self.heartbeat is None:
            return "no heartbeat yet"
        armed = self.heartbeat.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED
        name = MODE_NAMES.get(self.heartbeat.custom_mode, str(self.heartbeat.custom_mode))
        return f"{name}, {'armed' if armed else 'disarmed'}"

    def failure(self, now_s: float) -> str | None:
        """Say why the run has failed, if it has: nobody there, or an order refused for a minute."""
        if self._vehicle is None:
            return f"no MAVLink heartbeat within {PATIENCE_S:g} s" if now_s > PATIENCE_S and self.orders else None
        for order in self._open:
            if order.first_sent_s is not None and now_s - order.first_sent_s > PATIENCE_S:
                return _complaint(order)
        return None

    def verdict(self) -> str | None:
        """At the end of the run: say which goal was never accepted, or None."""
        if self.orders and self._vehicle is None:
            return "the autopilot sent no MAVLink heartbeat"
        if self.orders and self.orders[0].first_sent_s is None:
            return f"{self.orders[0].text} was never given: she was not ready before the end"
        for order in self.orders:
            if order.accepted_s is None and order.first_sent_s is not None and not order.left:
                return _complaint(order)
        return None

    def _hear_heartbeat(self, now_s: float, message: Any) -> None:
        if message.autopilot == dialect.MAV_AUTOPILOT_INVALID or message.get_srcComponent() != 1:
            return
        self.heartbeat = message
        if self._vehicle is None:
            self._vehicle = message.get_srcSystem()
            self._heartbeat_s = now_s + REACTION_S
            self._ready_by_s = now_s + READY_PATIENCE_S
            self._plan(now_s)

    def _hear_status(self, now_s: float, message: Any) -> None:
        ready = message.onboard_control_sensors_health & dialect.MAV_SYS_STATUS_PREARM_CHECK
        if ready and message.get_srcComponent() == 1 and now_s < self._ready_by_s < math.inf:
            self._ready_by_s = now_s
            self._plan(now_s)

    def _hear_reached(self, now_s: float, message: Any) -> None:
        self.reached.append((now_s, message.seq))

    def _hear_acknowledgement(self, now_s: float, message: Any) -> None:
        if not self._open or message.command != self._open[0].command or self._open[0].first_sent_s is None:
            return
        order = self._open[0]
        if message.result == dialect.MAV_RESULT_ACCEPTED:
            order.accepted_s = now_s
            self._open.popleft()
            self._plan(now_s)
        elif message.result != dialect.MAV_RESULT_IN_PROGRESS:
            name = dialect.enums["MAV_RESULT"].get(message.result)
            order.refusal = name.name.removeprefix("MAV_RESULT_") if name else f"result {message.result}"
            if self._shared and order.goal is not None and self._mode_now() != self._mode:
                self._give_way(order, now_s)
            order.confirmation = 0  # the next one is a new order, not a repetition of this one

    def _mode_now(self) -> int | None:
        return None if self.heartbeat is None else self.heartbeat.custom_mode

    def _give_way(self, order: Order, now_s: float) -> None:
        order.left = True
        self._open.popleft()
        self._plan(now_s)
        if not self.gave_way:
            self.gave_way = f"{order.text} was left to whoever steers: she is in {self.mode()}"

    def _hear_text(self, now_s: float, message: Any) -> None:
        text = message.text
        if message.chunk_seq and message.id == self._text_id and self.texts:
            # The rest of a long text: the protocol cuts it after every 50 characters.
            text = (self.texts.pop()[2] + text)[:MAX_TEXT_LENGTH]
        self._text_id = message.id
        self.texts.append((now_s, message.severity, text))

    def _plan(self, now_s: float) -> None:
        self._order_s = max(now_s + REACTION_S, self._open[0].due_s) if self._open else math.inf

    def _leave_overtaken(self, now_s: float) -> None:
        while len(self._open) > 1 and self._open[0].goal and self._open[1].due_s <= now_s:
            self._open.popleft()

    def _ask_ready(self, now_s: float) -> bytes:
        self._order_s = min(now_s + READY_S, self._ready_by_s)
        return self._command(dialect.MAV_CMD_REQUEST_MESSAGE, (float(dialect.MAVLINK_MSG_ID_SYS_STATUS),), 0)

    def _give(self, order: Order, now_s: float) -> bytes:
        if order.first_sent_s is None:
            order.first_sent_s = now_s
        frame = self._command(order.command, order.parameters, order.confirmation)
        order.confirmation = min(order.confirmation + 1, 255)
        self._order_s = now_s + RETRY_S
        return frame

    def _command(self, command: int, parameters: tuple[float, ...], confirmation: int) -> bytes:
        values = (*parameters, *(0.0,) * (7 - len(parameters)))
        return self._pack(dialect.MAVLink_command_long_message(self._vehicle, 1, command, confirmation, *values))

    def _heartbeat(self) -> bytes:
        return self._pack(
            dialect.MAVLink_heartbeat_message(
                dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
            )
        )

    def _pack(self, message: Any) -> bytes:
        frame = bytes(message.pack(self._sender))
        self._sender.seq = (self._sender.seq + 1) % 256
        return frame

    _RECEIVERS = {  # noqa: RUF012 - a table of methods, never changed
        "HEARTBEAT": _hear_heartbeat,
        "COMMAND_ACK": _hear_acknowledgement,
        "STATUSTEXT": _hear_text,
        "SYS_STATUS": _hear_status,
        "MISSION_ITEM_REACHED": _hear_reached,
    }


def _complaint(order: Order) -> str:
    answer = f"the autopilot answers {order.refusal}" if order.refusal else "the autopilot does not answer"
    return f"{order.text} was never accepted: {answer}"
