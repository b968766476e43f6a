"""Connection to a flight controller that serves as sensor board: its selection, and the requests of its messages.

Compass, position and power monitor each have a connection, also on a shared port. Each is a component of its own
(onboard computer 1 to 3), with the system id of the board, as mavlink.io recommends for a companion computer.

The heartbeats decide which system is the board. Messages of other systems and components are ignored, because a board
may forward those of its radio and of its peripherals. Received messages become samples only: nothing is forwarded.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceRole
from firmware_py.sensors.device_monitor import SILENT_AFTER_S, DeviceMonitor
from firmware_py.sensors.mavlink_frames import (
    MAV_AUTOPILOT_INVALID,
    MAV_CMD_SET_MESSAGE_INTERVAL,
    MAV_TYPE_GCS,
    Encoder,
    Frame,
    Message,
    Stream,
    create_framer,
    decode_frame,
)
from firmware_py.sensors.message_error import CHECKSUM, MessageError
from firmware_py.sensors.sensor_driver import SampleT, SensorDriver

HEARTBEAT_INTERVAL_S = 1.0
REQUEST_INTERVAL_S, LATER_REQUEST_INTERVAL_S = 1.0, 5.0
COMPLETE_ROUNDS = 2  # rounds of requests for all messages; later ones are for missing messages only
STREAM_ROUND = 4  # from this round on, missing messages are also requested as a group
FAST_ROUNDS = 5  # rounds at the short interval
MIN_MISSING_S, MISSING_INTERVALS = 2.0, 3.0  # a message is missing after the longer of both
MAX_HEARTBEAT_GAP_S = 2.5  # after a longer gap all messages are requested again
MAX_CANDIDATES = 8
MIN_RUN_BACK_MS = 1000  # if the time since boot decreases by more than this, the board has restarted

_ONBOARD_COMPUTER = 191  # component id of onboard computer 1; the others follow
COMPASS_COMPONENT, POSITION_COMPONENT, POWER_COMPONENT = _ONBOARD_COMPUTER, _ONBOARD_COMPUTER + 1, _ONBOARD_COMPUTER + 2
# Field with the time since boot [ms]. That of GLOBAL_POSITION_INT is the time of the last fix in older ArduPilots.
_BOOT_TIME_FIELDS = {Message.SYSTEM_TIME: 1, Message.ATTITUDE: 0}
_REFUSALS = (2, 3, 4)  # MAV_RESULT: denied, unsupported, failed
_DEFAULT_SYSTEM = 1  # of the own heartbeats before the board is known

Address = tuple[int, int]  # system and component


@dataclass(frozen=True, slots=True)
class MavlinkOptions:
    """Options of the vehicle file that select the flight controller; raises ValueError."""

    system: int = option(
        "MAVLink system id of the flight controller; 0: the first that sends two heartbeats",
        default=0,
        minimum=0,
        maximum=255,
    )
    component: int = option("MAVLink component id of the flight controller", default=1, minimum=1, maximum=255)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)


class Wanted(NamedTuple):
    """A message to request, its rate, the group that contains it, and the only autopilot that has it (None: all)."""

    message: Message
    rate_hz: float
    stream: Stream
    autopilot: int | None = None


class _Requests:
    """Decides which messages are requested when.

    All are requested twice, because a request may be lost. Then missing messages are requested again, at first each
    second, later each five seconds.
    """

    def __init__(self, wanted: Sequence[Wanted]) -> None:
        self._wanted = wanted
        self._arrivals_s: dict[Message, float] = {}
        self._is_refused = False
        self.restart(0.0)

    def restart(self, now_s: float) -> None:
        """Request all messages again, from now_s on."""
        self._arrivals_s.clear()
        self._is_refused = False
        self._round = 0
        self._due_s = now_s

    def note_arrival(self, message: Message, now_s: float) -> None:
        self._arrivals_s[message] = now_s

    def note_refusal(self) -> None:
        self._is_refused = True

    def take_due(self, autopilot: int, now_s: float) -> tuple[Sequence[Wanted], Sequence[Wanted]]:
        """Return the messages to request now, and those whose groups are to be requested."""
        if now_s < self._due_s:
            return (), ()
        available = [row for row in self._wanted if row.autopilot in (None, autopilot)]
        missing = [row for row in available if self._is_missing(row, now_s)]
        is_complete = self._round < COMPLETE_ROUNDS
        if missing or is_complete:
            self._round += 1
        else:
            self._round = COMPLETE_ROUNDS  # the next missing message is requested at the short interval
        self._due_s = now_s + (REQUEST_INTERVAL_S if self._round < FAST_ROUNDS else LATER_REQUEST_INTERVAL_S)
        requested = available if is_complete else missing
        needs_groups = self._round >= STREAM_ROUND or (self._is_refused and self._round > 1)
        return requested, missing if needs_groups else ()

    def _is_missing(self, row: Wanted, now_s: float) -> bool:
        arrival_s = self._arrivals_s.get(row.message)
        return arrival_s is None or now_s - arrival_s > max(MIN_MISSING_S, MISSING_INTERVALS / row.rate_hz)


class FlightController:
    """Returns the messages of the selected flight controller, and requests them again when they are missing."""

    def __init__(
        self,
        line: ByteLine,
        monitor: DeviceMonitor,
        address: Address,
        component: int,
        wanted: Sequence[Wanted],
    ) -> None:
        """Store the line; `address` is that of the board, with system 0 for any; `component` is the own id."""
        self._line = line
        self._monitor = monitor
        self._wanted_address = address
        self._encoder = Encoder(component)
        self._framer = create_framer()
        self._requests = _Requests(wanted)
        self._address: Address | None = None
        self._candidates: set[Address] = set()  # systems with one heartbeat
        self._heartbeat_s = 0.0
        self._autopilot = MAV_AUTOPILOT_INVALID
        self._boot_ms = 0
        self._heartbeat_due_s = 0.0
        self.restarts = 0  # number of restarts and selections of the board, and of openings of the line
        self.other_text = ""  # about another autopilot on the line, empty if there is none

    def receive(self, now_s: float) -> Iterator[Frame]:
        """Yield the messages of the board that have arrived; afterwards send what is due.

        The result must be consumed.
        """
        if self._monitor.notice_reopening():
            self._framer = create_framer()
            self._address = None
            self._candidates.clear()
            self.other_text = ""
            self.restarts += 1
        if data := self._line.read():
            self._monitor.note_bytes(now_s)
            for packet in self._framer.feed(data):
                if packet.fault == CHECKSUM:
                    self._monitor.reject(now_s, CHECKSUM)
                elif not packet.fault:
                    frame = decode_frame(packet.data)
                    if self._is_of_board(frame, now_s):
                        yield frame
        self._send_due(now_s)

    def _is_of_board(self, frame: Frame, now_s: float) -> bool:
        """Process a message for the connection; return whether it is of the board."""
        address = (frame.system, frame.component)
        if frame.message is Message.HEARTBEAT:
            self._handle_heartbeat(address, frame.fields[1], frame.fields[2], now_s)
        if address != self._address:
            return False
        self._requests.note_arrival(frame.message, now_s)
        if (field := _BOOT_TIME_FIELDS.get(frame.message)) is not None:
            boot_ms = frame.fields[field]
            if boot_ms < self._boot_ms - MIN_RUN_BACK_MS:
                self._restart(now_s)
            self._boot_ms = boot_ms
        elif frame.message is Message.COMMAND_ACK:
            command, result = frame.fields[:2]
            if command == MAV_CMD_SET_MESSAGE_INTERVAL and result in _REFUSALS:
                self._requests.note_refusal()
        return True

    def _handle_heartbeat(self, address: Address, kind: int, autopilot: int, now_s: float) -> None:
        """Select the board at its second heartbeat, because noise may look like one; report other autopilots."""
        if autopilot == MAV_AUTOPILOT_INVALID or kind == MAV_TYPE_GCS:
            return  # a ground station, a gimbal or another component without an autopilot
        if address == self._address:
            if now_s - self._heartbeat_s > MAX_HEARTBEAT_GAP_S:
                self._requests.restart(now_s)  # it may have restarted
            self._autopilot, self._heartbeat_s = autopilot, now_s
        elif self._address is None and self._matches(address):
            if address in self._candidates:
                self._address, self._autopilot, self._heartbeat_s = address, autopilot, now_s
                self._restart(now_s)
            if len(self._candidates) >= MAX_CANDIDATES:
                self._candidates.clear()
            self._candidates.add(address)
            self._monitor.note_unused("one heartbeat: waiting for the next")
        else:
            system, component = address
            self.other_text = f"autopilot {system}/{component} ignored: set system and component"
            self._monitor.note_unused(self.other_text)

    def _matches(self, address: Address) -> bool:
        system, component = self._wanted_address
        return system in (0, address[0]) and component == address[1]

    def _restart(self, now_s: float) -> None:
        self.restarts += 1
        self._boot_ms = 0
        self._requests.restart(now_s)

    def _send_due(self, now_s: float) -> None:
        if not self._line.connected:
            return
        if now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s = now_s + HEARTBEAT_INTERVAL_S
            system = self._wanted_address[0] or _DEFAULT_SYSTEM
            self._line.write(self._encoder.heartbeat(system if self._address is None else self._address[0]))
        if self._address is None:
            return
        messages, groups = self._requests.take_due(self._autopilot, now_s)
        for row in messages:
            self._line.write(self._encoder.message_interval(*self._address, row.message, row.rate_hz))
        for stream, rate_hz in {row.stream: row.rate_hz for row in groups}.items():
            self._line.write(self._encoder.data_stream(*self._address, stream, rate_hz))


class MavlinkDevice(SensorDriver[SampleT]):
    """Common part of the drivers: a subclass makes samples of the messages of the board."""

    def __init__(
        self,
        line: ByteLine,
        options: MavlinkOptions,
        role: DeviceRole,
        component: int,
        wanted: Sequence[Wanted],
        silent_after_s: float = SILENT_AFTER_S,
    ) -> None:
        """Store the line; `component` is the own component id, `wanted` are the messages to request."""
        super().__init__(line, role, silent_after_s)
        address = (options.system, options.component)
        self._board = FlightController(line, self._monitor, address, component, wanted)
        self._restarts = 0

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s; send heartbeats and requests."""
        for frame in self._board.receive(now_s):
            self._notice_restart()
            try:
                self._handle(frame, now_s)
            except MessageError as error:
                self._monitor.reject(now_s, str(error))
        self._notice_restart()

    def _notice_restart(self) -> None:
        if self._board.restarts != self._restarts:
            self._restarts = self._board.restarts
            self._forget()

    def _handle(self, frame: Frame, now_s: float) -> None:
        """Process a message of the board; may raise MessageError."""
        raise NotImplementedError

    def _forget(self) -> None:
        """Discard the values from before a restart of the board."""
