"""Warns of what the fence would end, once after each change of the plans, with a few looks at the fence a tick."""

from __future__ import annotations

from collections.abc import Iterator

from firmware_py.common.plan import Plans, homes
from firmware_py.common.records import Severity
from firmware_py.link.context import LinkContext
from firmware_py.plans.fence import Breach, breaches

CORNERS_PER_TICK = 500  # of the fence, for all looks: about half a millisecond


class FenceWarning:
    """Looks at the plans in force."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask for the plans and to warn through."""
        self._context = context
        self._plans: Plans | None = None
        self._looks: Iterator[Breach | None] = iter(())
        self._found: list[Breach] = []

    def update(self) -> None:
        """Go on with the plans in force, once a tick."""
        plans = self._context.request_handler.plans()
        if plans is not self._plans:
            self._plans, self._looks, self._found = plans, breaches(plans), []
        for _ in range(1 + CORNERS_PER_TICK // (len(plans.fence.items) + 1)):
            try:
                breach = next(self._looks)
            except StopIteration:
                self._warn()
                return
            if breach is not None:
                self._found.append(breach)

    def _warn(self) -> None:
        if not self._found:
            return
        first, *others = self._found
        self._found = []
        text = first.shown(homes(self._context.autopilot, first.kind))
        more = f", and {len(others)} more" if others else ""
        self._context.send_text_all(Severity.WARNING, f"{text}{more}")
