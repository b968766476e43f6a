"""A command that takes a while: its progress, its end, and how it is cancelled."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from firmware_py.common.intents import Answer, Verdict
from firmware_py.common.records import Severity

if TYPE_CHECKING:
    from firmware_py.link.commands.server import CommandCall
    from firmware_py.link.context import LinkContext

IN_PROGRESS, CANCELLED = 5, 6  # MAV_RESULT
_LATE = Answer(Verdict.FAILED, "not done in time")
UNKNOWN_PROGRESS = 255
FIRST_WORD_S = 0.3  # what is done by then needs no word in between
WORD_S = 1.0


def _unknown() -> int:
    return UNKNOWN_PROGRESS


class PendingCommand:
    """Returned by a command's action in place of an answer; whoever works on it calls `finish`, once."""

    def __init__(
        self,
        *,
        timeout_s: float,
        percent: Callable[[], int] = _unknown,
        cancel: Callable[[], None] | None = None,
        poll: Callable[[], Answer | None] | None = None,
        late: Answer = _LATE,
    ) -> None:
        """Take how long it may take, who knows the progress (0 to 100), who can call it off, who knows the end.

        `late` is the answer when it takes longer; its text goes behind the command's name.
        """
        self._timeout_s = timeout_s
        self._cancel = cancel
        self._poll = poll
        self._answer: Answer | None = None
        self._done: Callable[[Answer], None] | None = None
        self._begun_s = self._word_s = 0.0
        self.percent = percent
        self.late = late

    def begin(self, now_s: float, done: Callable[[Answer], None]) -> None:
        """Say who is to be told of the end, at once if it has come already."""
        self._begun_s, self._word_s = now_s, now_s + FIRST_WORD_S
        if self._answer is None:
            self._done = done
        else:
            done(self._answer)

    @property
    def ended(self) -> bool:
        """Whether it has its answer."""
        return self._answer is not None

    def finish(self, answer: Answer) -> None:
        """End it; only the first end counts."""
        if self._answer is None:
            self._answer = answer
            # Who is told knows this command: kept, the two would hold each other until the next collection, and a
            # flood of commands would fill the memory with them.
            done, self._done = self._done, None
            if done is not None:
                done(answer)

    def cancel(self) -> bool:
        """CommandCall it off; False when that cannot be done any more."""
        if self._cancel is None or self._answer is not None:
            return False
        self.give_up()
        return True

    def give_up(self) -> None:
        """CommandCall it off if that can be done, and take no notice of how it ends."""
        if self._cancel is not None:
            self._cancel()
        self._done = None

    def check_end(self) -> None:
        """End it when whoever knows the end says so."""
        if self._poll is not None and self._answer is None and (answer := self._poll()) is not None:
            self.finish(answer)

    def progress_due(self, now_s: float) -> bool:
        """Return whether it is time for a word on the progress, and count it as said."""
        if now_s < self._word_s:
            return False
        self._word_s = now_s + WORD_S
        return True

    def timed_out(self, now_s: float) -> bool:
        """Return whether it has taken too long."""
        return now_s - self._begun_s > self._timeout_s


def once_stored(context: LinkContext, call: CommandCall, text: str, failure: str) -> PendingCommand:
    """Be done once the disk has answered: until then nobody can say whether it will be stored."""
    pending = PendingCommand(timeout_s=math.inf)

    def stored(well: bool) -> None:  # noqa: FBT001 - the request handler's callback
        if well:
            context.send_text(call.peer, Severity.NOTICE, text)
        pending.finish(Answer(Verdict.ACCEPTED) if well else Answer(Verdict.FAILED, f"{call.name}: {failure}"))

    context.request_handler.when_stored(stored)
    return pending
