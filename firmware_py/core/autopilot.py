"""The autopilot between the ticks: it answers requests at once and hands them to the next step."""

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
from firmware_py.core.parameter_keeper import ParameterKeeper
from firmware_py.core.resume import Moment
from firmware_py.core.resume_keeper import ResumeKeeper
from firmware_py.core.state import State
from firmware_py.core.step import step

# More requests than this between two ticks are turned away.
PENDING_LIMIT: Final = 256
# More acknowledgements than this do not wait for the disk: one that hangs must not fill the memory.
AWAITED_LIMIT: Final = 256
_ACCEPTED: Final = Answer(Verdict.ACCEPTED)


class Autopilot:
    """Holds the state between ticks, judges requests at once and hands them to the next step.

    `decide` computes ahead with the same pure function that the next step will use, so
    that an answer need not wait for the tick and still cannot differ from what is done.
    """

    def __init__(self, state: State, keeper: StateWriter, begun: Moment | None = None) -> None:
        """Start from a state; `keeper` takes what must outlive a restart, `begun` is when the time was 0."""
        self._state = state
        self._ahead = state
        self._pending: list[Request] = []
        self._keeper = keeper
        self._parameters = ParameterKeeper(keeper)
        self._resume = ResumeKeeper(begun or Moment(0.0))
        self._unkept: list[Callable[[bool], None]] = []  # who waits for a record that has not been handed over
        self._awaited = 0  # calls that wait for a record, handed over or not
        self._now_s = 0.0
        self._utc_offset_s: float | None = None  # None until the loop has told the time
        self.compass_swing = CompassSwing()  # is given the ticks by the loop, once they are done
        self.restart: Restart | None = None  # accepted in a tick: the loop ends behind it

    @property
    def state(self) -> State:
        """The state after the last step."""
        return self._state

    def decide(self, request: Request) -> Answer:
        """Judge a request at once; when accepted it is an input of the next tick."""
        return self.decide_together((request,))

    def decide_together(self, requests: Sequence[Request]) -> Answer:
        """Judge requests one after the other; all are accepted, or none and the answer is that to the first refused."""
        if len(self._pending) + len(requests) > PENDING_LIMIT:
            return Answer(Verdict.TEMPORARILY_REJECTED, "Too many requests")
        ahead, answer = self._ahead, _ACCEPTED
        for request in requests:
            ahead, answer = accept(ahead, request)
            if answer.verdict is not Verdict.ACCEPTED:
                return answer
        self._ahead = ahead
        for request in requests:
            self._take(request)
        return answer

    def _take(self, request: Request) -> None:
        """Hand an accepted request to the next tick, and to the disk what must outlive a restart."""
        self._now_s = max(self._now_s, request.t_s)
        self._pending.append(request)
        if isinstance(request.intent, SetParameter):
            name = request.intent.name
            self._parameters.change(name, self._ahead.parameters[name])
        elif isinstance(request.intent, ForgetParameters):
            self._parameters.forget()

    def replace_plan(self, request: Request, done: Callable[[Answer], None]) -> None:
        """Put a plan in force once it is on disk; the old one stands until then."""
        intent = request.intent
        if not isinstance(intent, ReplacePlan):
            raise TypeError(f"{type(intent).__name__} is not a plan")
        _, answer = accept(self._ahead, request)
        if answer.verdict is not Verdict.ACCEPTED:
            done(answer)
            return

        def finish(stored: bool) -> None:  # noqa: FBT001 - the store's callback
            if not stored:
                done(Answer(Verdict.FAILED, "the plan could not be stored; the old one stands"))
                return
            # On disk, so nothing may turn it away any more, not even a full queue.
            self._ahead, answer = accept(self._ahead, request)
            self._pending.append(request)
            # The place in the old mission is none in the new one.
            self.when_orders_stored(lambda _stored: done(answer))

        self._keeper.save_plan(intent.plan, finish)

    def parameters(self) -> ParameterSet:
        """Return the values in force, accepted requests included."""
        return self._ahead.parameters

    def plans(self) -> Plans:
        """Return the plans in force, accepted requests included."""
        return self._ahead.plans

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Call back once the parameters accepted so far are on disk, or cannot be."""
        self._keep()  # the fence may be heeded otherwise, or the record kept from now on
        self._parameters.when_stored(call, self._now_s)

    def when_orders_stored(self, call: Callable[[bool], None]) -> None:
        """Call back once the next start would go on with what was accepted so far, or could not; at once if not to."""
        if not self._ahead.parameters["BOOT_RESUME"]:
            call(True)
            return
        if self._awaited >= AWAITED_LIMIT:
            call(False)
            return

        def told(stored: bool) -> None:  # noqa: FBT001 - the store's callback
            self._awaited -= 1
            call(stored)

        self._awaited += 1
        self._unkept.append(told)
        self._keep()

    def take_requests(self) -> tuple[Request, ...]:
        """Hand over the requests since the last tick."""
        requests = tuple(self._pending)
        self._pending.clear()
        return requests

    def step(self, inputs: Inputs) -> Output:
        """Compute a tick."""
        self._state, output = step(self._state, inputs)
        self._ahead = self._state
        for request in inputs.requests:
            if isinstance(request.intent, Restart):
                self.restart = request.intent
        return output

    def save_resume(self, now_s: float, utc_s: float, *, last: bool = False) -> None:
        """Keep parameters and what the boat is doing for the next start, when changed; `last`: however little."""
        self._now_s, self._utc_offset_s = now_s, utc_s - now_s
        self._parameters.update(now_s, last=last)
        self._keep(last=last)

    def _keep(self, *, last: bool = False) -> None:
        if self._utc_offset_s is None:
            return
        utc_s = self._now_s + self._utc_offset_s
        record = self._resume.update(self._ahead, self._now_s, utc_s, awaited=bool(self._unkept), last=last)
        if record is not None:
            self._keeper.save_resume(record)
        if self._resume.is_current:
            unkept, self._unkept = self._unkept, []
            for call in unkept:
                self._keeper.when_resume_stored(call)
