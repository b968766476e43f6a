"""The services of the link: which there are, who handles which message, and whose turn it is to go on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol

from firmware_py.common.reports import Snapshot
from firmware_py.link import radio_status
from firmware_py.link.commands.requests import request_data_stream
from firmware_py.link.commands.server import CommandServer
from firmware_py.link.commands.table import TABLE as COMMANDS
from firmware_py.link.companion import Companion
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.files.root import PACKED_PARAMETERS, FileRoot, tree_of
from firmware_py.link.files.server import FileServer
from firmware_py.link.logs import LogServer
from firmware_py.link.manual_control import ManualControl
from firmware_py.link.mission.plan_file import PlanFiles
from firmware_py.link.mission.server import MissionServer
from firmware_py.link.parameters.extended import ExtendedParameters
from firmware_py.link.parameters.server import ParameterServer
from firmware_py.link.peer import Peer
from firmware_py.link.satellite.reports import SatelliteReports
from firmware_py.link.security.key_setup import KeySetup
from firmware_py.link.setpoints import Setpoints
from firmware_py.link.shell import Shell
from firmware_py.link.timesync import Timesync
from firmware_py.link.wire.outbox import Priority
from firmware_py.link.wire.worker import Worker

_DATA_STREAM = 66


class Service(Protocol):
    """What every service has."""

    def handlers(self) -> Mapping[int, Handler]:
        """Return who handles a message, by its number."""


class TickedService(Service, Protocol):
    """A service that does something by itself."""

    def update(self, now_s: float) -> None:
        """Do what is due after a tick."""


class PumpedService(Service, Protocol):
    """A service whose answers may be long."""

    def pump(self, peer: Peer, now_s: float) -> None:
        """Send a peer some more of what it is owed, as far as its line keeps up."""


class Services:
    """All services of one link; a new one is a line here."""

    def __init__(self, context: LinkContext, key_setup: KeySetup, root: FileRoot, worker: Worker) -> None:
        """Take what they answer through, what sets the key, what they show of the disk, and who waits for the disk."""
        commands = CommandServer(context, COMMANDS)
        parameters = ParameterServer(context)
        extended = ExtendedParameters(context, parameters)
        plan_files = PlanFiles(context, worker)
        sinks = {PACKED_PARAMETERS: parameters.apply_file, **plan_files.sinks()}
        self.tree = tree_of(root, context.metadata, context.request_handler, plan_files.generated(), sinks)
        files = FileServer(context, self.tree, worker)
        logs = LogServer(context, root.catalogue, worker, logging=root.logging)
        self._mission = MissionServer(context)
        self._all: tuple[Service, ...] = (
            *(commands, parameters, extended, self._mission, files, logs),
            *(
                Setpoints(context),
                ManualControl(context),
                Timesync(context),
                Companion(context),
                Shell(context),
                key_setup,
            ),
        )
        self._ticked: tuple[TickedService, ...] = (self._mission, commands, logs, SatelliteReports(context))
        self._pumped: tuple[PumpedService, ...] = (parameters, extended, files, logs)
        self._next_peer = 0  # whose long answer goes on next
        self.pumping = False  # whether one did in the last call

    def handlers(self) -> dict[int, Handler]:
        """Return who handles which message, by its number."""
        handlers: dict[int, Handler] = {_DATA_STREAM: request_data_stream, **radio_status.handlers()}
        for service in self._all:
            handlers.update(service.handlers())
        return handlers

    def report_changes(self, before: Snapshot | None, snapshot: Snapshot, now_s: float) -> None:
        """Report what a tick has changed and no table of telemetry has."""
        self._mission.report_progress(before, snapshot, now_s)

    def update(self, now_s: float) -> None:
        """Have each service do what is due after a tick."""
        for service in self._ticked:
            service.update(now_s)

    def pump(self, peers: Iterable[Peer], now_s: float) -> None:
        """Go on with a long answer to one peer; the others have their turns in the next calls."""
        present = tuple(peers)
        self.pumping = False
        for number in range(len(present)):
            peer = present[(self._next_peer + number) % len(present)]
            before = peer.outbox.waiting(Priority.REPLY)
            peer.bulk.can_continue = False
            for service in self._pumped:
                service.pump(peer, now_s)
            if peer.outbox.waiting(Priority.REPLY) > before:
                self._next_peer = (self._next_peer + number + 1) % len(present)
                self.pumping = True
                return
