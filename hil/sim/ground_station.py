"""Simulated ground station that arms the boat, sets GUIDED and sends the goals of the run over MAVLink."""

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
HEADING_TYPE = 1.0  # HEADING_TYPE_HEADING: true heading, not course over ground
HEARTBEAT_S = 1.0
RETRY_S = 0.5
REACTION_S = 0.02  # response time of the program of a ground station
TIMEOUT_S = 60.0
READY_TIMEOUT_S = 10.0  # then the station arms the boat anyway, so that the autopilot reports why it is not ready
STATUS_REQUEST_S = 0.2  # interval of requests for the status
MAX_TEXTS = 4096
MAX_TEXT_LENGTH = 200


@dataclass(slots=True)
class Order:
    """One command of the operator, its times and its result."""

    text: str
    due_s: float
    command: int
    parameters: tuple[float, ...]
    goal: Goal | None = None
    first_sent_s: float | None = None
    accepted_s: float | None = None
    confirmation: int = 0  # number of transmissions before, as in COMMAND_LONG
    refusal: str = ""  # MAV_RESULT of the last rejection
    is_skipped: bool = False  # because another station steers


def disarm(due_s: float) -> Order:
    """Return the order to disarm."""
    return Order("disarming", due_s, dialect.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,))


class GroundStation:
    """A ground station as a device at the far end of the serial line of the link.

    It requests the status until the boat is ready, then arms it. It sends orders one after the other, each every half
    second until it is accepted; a goal that is still open when the next one is due is skipped. If other stations steer
    too (`shared`), a goal that is refused in a mode set by one of them is skipped, and `skip_text` states it. With
    `sends_first` it sends a heartbeat at the start, for links that serve only stations that have sent one.
    """

    def __init__(
        self, goals: Sequence[Goal], mode: int = GUIDED, *, shared: bool = False, sends_first: bool = False
    ) -> None:
        """Create the orders: arming, mode, goals in order of time; without goals there are none in GUIDED."""
        self._mode, self._shared = mode, shared
        self.skip_text = ""
        arm_order = Order("arming", 0.0, dialect.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,))
        mode_order = Order(f"mode {MODE_NAMES.get(mode, mode)}", 0.0, dialect.MAV_CMD_DO_SET_MODE, (1.0, float(mode)))
        goal_orders = [
            Order(
                f"goal {goal.heading_deg:g} deg at {goal.t_s:g} s",
                goal.t_s,
                CHANGE_HEADING,
                (HEADING_TYPE, compass_degrees(goal.heading_rad)),
                goal,
            )
            for goal in goals
        ]
        self.orders: tuple[Order, ...] = (arm_order, mode_order, *goal_orders) if goals or mode != GUIDED else ()
        self.heartbeat: Any | None = None  # the latest of the autopilot
        self.is_silent = False  # receives only
        self.texts: deque[tuple[float, int, str]] = deque(maxlen=MAX_TEXTS)  # time, severity, text
        self.reached: deque[tuple[float, int]] = deque(maxlen=MAX_TEXTS)  # time and number of each mission item
        self._open_orders = deque(self.orders)
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
        self._queued_messages: list[Any] = []
        self._next_heartbeat_s = 0.0 if sends_first else math.inf
        self._next_order_s = math.inf
        self._ready_by_s = math.inf  # orders start when the boat is ready, at this time at the latest

    # The Emulator interface for the board.

    def receive(self, now_s: float, data: bytes) -> None:
        """Process bytes from the autopilot."""
        for message in self._tap.feed(data):
            self._RECEIVERS[message.get_type()](self, now_s, message)

    def next_output_s(self) -> float:
        """Return the time of the next heartbeat or command; infinity before the autopilot's first heartbeat."""
        return min(self._next_heartbeat_s, self._next_order_s)

    def take_output(self, now_s: float) -> bytes:
        """Return the frames that are due."""
        frames = []
        if self._next_heartbeat_s <= now_s:
            self._next_heartbeat_s += HEARTBEAT_S
            frames.append(self._heartbeat())
            frames += [self._pack(message) for message in self._queued_messages]
            self._queued_messages.clear()
        if self._next_order_s <= now_s:
            self._skip_overdue(now_s)
            frames.append(
                self._send_order(self._open_orders[0], now_s)
                if now_s >= self._ready_by_s
                else self._request_status(now_s)
            )
        return b"" if self.is_silent else b"".join(frames)

    # For the run and its display.

    def order(self, order: Order, now_s: float) -> None:
        """Append an order to the open ones; it is sent once the autopilot is connected."""
        self._open_orders.append(order)
        if self._vehicle is not None:
            self._schedule_order(now_s)

    def queue(self, message: Any) -> None:
        """Send a message once, with the next heartbeat."""
        self._queued_messages.append(message)

    def named_value(self, name: str) -> float | None:
        """Return the last NAMED_VALUE_FLOAT of a name, or None."""
        message = self._tap.latest(name)
        return None if message is None else float(message.value)

    def mode(self) -> str:
        """Return the mode and the armed state in the last heartbeat, as text."""
        if self.heartbeat is None:
            return "no heartbeat yet"
        armed = self.heartbeat.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED
        name = MODE_NAMES.get(self.heartbeat.custom_mode, str(self.heartbeat.custom_mode))
        return f"{name}, {'armed' if armed else 'disarmed'}"

    def failure(self, now_s: float) -> str | None:
        """Return the reason for a failure: no heartbeat, or an order not accepted for a minute; otherwise None."""
        if self._vehicle is None:
            return f"no MAVLink heartbeat within {TIMEOUT_S:g} s" if now_s > TIMEOUT_S and self.orders else None
        for order in self._open_orders:
            if order.first_sent_s is not None and now_s - order.first_sent_s > TIMEOUT_S:
                return _failure_text(order)
        return None

    def final_failure(self) -> str | None:
        """At the end of the run, return the reason if an order was never accepted, otherwise None."""
        if self.orders and self._vehicle is None:
            return "the autopilot sent no MAVLink heartbeat"
        if self.orders and self.orders[0].first_sent_s is None:
            return f"{self.orders[0].text} was never sent: the boat was not ready before the end of the run"
        for order in self.orders:
            if order.accepted_s is None and order.first_sent_s is not None and not order.is_skipped:
                return _failure_text(order)
        return None

    def _on_heartbeat(self, now_s: float, message: Any) -> None:
        if message.autopilot == dialect.MAV_AUTOPILOT_INVALID or message.get_srcComponent() != 1:
            return
        self.heartbeat = message
        if self._vehicle is None:
            self._vehicle = message.get_srcSystem()
            self._next_heartbeat_s = now_s + REACTION_S
            self._ready_by_s = now_s + READY_TIMEOUT_S
            self._schedule_order(now_s)

    def _on_status(self, now_s: float, message: Any) -> None:
        ready = message.onboard_control_sensors_health & dialect.MAV_SYS_STATUS_PREARM_CHECK
        if ready and message.get_srcComponent() == 1 and now_s < self._ready_by_s < math.inf:
            self._ready_by_s = now_s
            self._schedule_order(now_s)

    def _on_reached(self, now_s: float, message: Any) -> None:
        self.reached.append((now_s, message.seq))

    def _on_acknowledgement(self, now_s: float, message: Any) -> None:
        if (
            not self._open_orders
            or message.command != self._open_orders[0].command
            or self._open_orders[0].first_sent_s is None
        ):
            return
        order = self._open_orders[0]
        if message.result == dialect.MAV_RESULT_ACCEPTED:
            order.accepted_s = now_s
            self._open_orders.popleft()
            self._schedule_order(now_s)
        elif message.result != dialect.MAV_RESULT_IN_PROGRESS:
            name = dialect.enums["MAV_RESULT"].get(message.result)
            order.refusal = name.name.removeprefix("MAV_RESULT_") if name else f"result {message.result}"
            if self._shared and order.goal is not None and self._mode_now() != self._mode:
                self._skip(order, now_s)
            order.confirmation = 0  # the next command is a new one, not a repetition

    def _mode_now(self) -> int | None:
        return None if self.heartbeat is None else self.heartbeat.custom_mode

    def _skip(self, order: Order, now_s: float) -> None:
        order.is_skipped = True
        self._open_orders.popleft()
        self._schedule_order(now_s)
        if not self.skip_text:
            self.skip_text = f"{order.text} skipped: another station has set mode {self.mode()}"

    def _on_text(self, now_s: float, message: Any) -> None:
        text = message.text
        if message.chunk_seq and message.id == self._text_id and self.texts:
            # The protocol splits a long text after every 50 characters.
            text = (self.texts.pop()[2] + text)[:MAX_TEXT_LENGTH]
        self._text_id = message.id
        self.texts.append((now_s, message.severity, text))

    def _schedule_order(self, now_s: float) -> None:
        self._next_order_s = max(now_s + REACTION_S, self._open_orders[0].due_s) if self._open_orders else math.inf

    def _skip_overdue(self, now_s: float) -> None:
        while len(self._open_orders) > 1 and self._open_orders[0].goal and self._open_orders[1].due_s <= now_s:
            self._open_orders.popleft()

    def _request_status(self, now_s: float) -> bytes:
        self._next_order_s = min(now_s + STATUS_REQUEST_S, self._ready_by_s)
        return self._command(dialect.MAV_CMD_REQUEST_MESSAGE, (float(dialect.MAVLINK_MSG_ID_SYS_STATUS),), 0)

    def _send_order(self, order: Order, now_s: float) -> bytes:
        if order.first_sent_s is None:
            order.first_sent_s = now_s
        frame = self._command(order.command, order.parameters, order.confirmation)
        order.confirmation = min(order.confirmation + 1, 255)
        self._next_order_s = now_s + RETRY_S
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
        "HEARTBEAT": _on_heartbeat,
        "COMMAND_ACK": _on_acknowledgement,
        "STATUSTEXT": _on_text,
        "SYS_STATUS": _on_status,
        "MISSION_ITEM_REACHED": _on_reached,
    }


def _failure_text(order: Order) -> str:
    result = f"the autopilot replied {order.refusal}" if order.refusal else "the autopilot did not reply"
    return f"{order.text} was never accepted: {result}"
