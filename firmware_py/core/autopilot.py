"""Autopilot between ticks: answers requests at once and passes them to the next step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from firmware_py.common.intents import Answer, ForgetParameters, ReplacePlan, Request, Restart, SetParameter, Verdict
from firmware_py.common.interfaces import StateWriter
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.common.records import Inputs
from firmware_py.common.reports import Output
from firmware_py.core.accept import accept
from firmware_py.core.compass_swing import CompassSwing
from firmware_py.core.parameter_writer import ParameterWriter
from firmware_py.core.resume import Moment
from firmware_py.core.resume_writer import ResumeWriter
from firmware_py.core.state import State
from firmware_py.core.step import step

MAX_PENDING: Final = 256  # requests between two ticks; further ones are refused
MAX_AWAITED: Final = 256  # callbacks that wait for the disk; further ones fail, so that memory stays limited
_ACCEPTED: Final = Answer(Verdict.ACCEPTED)


class Autopilot:
    """State between ticks, and the pending requests.

    `decide` applies a request to a copy of the state with the function that the next step uses. So the answer is given
    before the tick and agrees with its result.
    """

    def __init__(self, state: State, writer: StateWriter, begun: Moment | None = None) -> None:
        """Start from a state; `writer` stores data for a restart, `begun` is the moment at which `now_s` was 0."""
        self._state = state
        self._ahead = state  # after all accepted requests
        self._pending: list[Request] = []
        self._writer = writer
        self._parameters = ParameterWriter(writer)
        self._resume = ResumeWriter(begun or Moment(0.0))
        self._callbacks: list[Callable[[bool], None]] = []  # for a record that is not yet passed to the store
        self._awaited = 0  # number of all callbacks that wait for a record
        self._now_s = 0.0
        self._utc_offset_s: float | None = None  # None before the first tick
        self.compass_swing = CompassSwing()  # updated by the loop after each tick
        self.restart: Restart | None = None  # if set, the loop ends after this tick

    @property
    def state(self) -> State:
        """The state after the last step."""
        return self._state

    def decide(self, request: Request) -> Answer:
        """Answer a request at once; if accepted, it is an input of the next tick."""
        return self.decide_together((request,))

    def decide_together(self, requests: Sequence[Request]) -> Answer:
        """Answer requests in order: accept all, or none, with the answer of the first refused one."""
        if len(self._pending) + len(requests) > MAX_PENDING:
            return Answer(Verdict.TEMPORARILY_REJECTED, "Too many requests: try again")
        ahead, answer = self._ahead, _ACCEPTED
        for request in requests:
            ahead, answer = accept(ahead, request)
            if answer.verdict is not Verdict.ACCEPTED:
                return answer
        self._ahead = ahead
        for request in requests:
            self._queue(request)
        return answer

    def _queue(self, request: Request) -> None:
        """Pass an accepted request to the next tick, and its parameters to the store."""
        self._now_s = max(self._now_s, request.t_s)
        self._pending.append(request)
        if isinstance(request.intent, SetParameter):
            name = request.intent.name
            self._parameters.change(name, self._ahead.parameters[name])
        elif isinstance(request.intent, ForgetParameters):
            self._parameters.forget()

    def replace_plan(self, request: Request, done: Callable[[Answer], None]) -> None:
        """Activate a plan after it is on disk; call `done` with the answer. Raise TypeError for another request."""
        intent = request.intent
        if not isinstance(intent, ReplacePlan):
            raise TypeError(f"{type(intent).__name__} is not a plan")
        _, answer = accept(self._ahead, request)
        if answer.verdict is not Verdict.ACCEPTED:
            done(answer)
            return

        def finish(stored: bool) -> None:  # noqa: FBT001 - the store's callback
            if not stored:
                done(Answer(Verdict.FAILED, "plan not stored; the old one stays active"))
                return
            # It is on disk, so it must be accepted now, also if MAX_PENDING is exceeded.
            self._ahead, answer = accept(self._ahead, request)
            self._pending.append(request)
            # Also wait for the resume record: the item number of the old mission is not valid in the new one.
            self.when_orders_stored(lambda _stored: done(answer))

        self._writer.save_plan(intent.plan, finish)

    def parameters(self) -> ParameterSet:
        """Return the parameter values after all accepted requests."""
        return self._ahead.parameters

    def plans(self) -> Plans:
        """Return the plans after all accepted requests."""
        return self._ahead.plans

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Call back when all accepted parameters are on disk (True), or cannot be stored (False)."""
        self._save()  # FENCE_ENABLE and BOOT_RESUME change the resume record
        self._parameters.when_stored(call, self._now_s)

    def when_orders_stored(self, call: Callable[[bool], None]) -> None:
        """Call back when the resume record of all accepted commands is on disk (True), or cannot be stored (False)."""
        if not self._ahead.parameters["BOOT_RESUME"]:
            call(True)
            return
        if self._awaited >= MAX_AWAITED:
            call(False)
            return

        def finish(stored: bool) -> None:  # noqa: FBT001 - the store's callback
            self._awaited -= 1
            call(stored)

        self._awaited += 1
        self._callbacks.append(finish)
        self._save()

    def take_requests(self) -> tuple[Request, ...]:
        """Return and remove the requests since the last tick."""
        requests = tuple(self._pending)
        self._pending.clear()
        return requests

    def step(self, inputs: Inputs) -> Output:
        """Compute a tick; return its output."""
        self._state, output = step(self._state, inputs)
        self._ahead = self._state
        for request in inputs.requests:
            if isinstance(request.intent, Restart):
                self.restart = request.intent
        return output

    def save_resume(self, now_s: float, utc_s: float, *, last: bool = False) -> None:
        """Store changed parameters and the resume record; `last`: the process ends, so all changes are stored."""
        self._now_s, self._utc_offset_s = now_s, utc_s - now_s
        self._parameters.update(now_s, last=last)
        self._save(last=last)

    def _save(self, *, last: bool = False) -> None:
        if self._utc_offset_s is None:
            return
        utc_s = self._now_s + self._utc_offset_s
        record = self._resume.update(self._ahead, self._now_s, utc_s, is_awaited=bool(self._callbacks), last=last)
        if record is not None:
            self._writer.save_resume(record)
        if self._resume.is_current:
            callbacks, self._callbacks = self._callbacks, []
            for call in callbacks:
                self._writer.when_resume_stored(call)
