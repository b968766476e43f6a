"""Plans and home in a log, from its initial state and from later requests."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, Final

from firmware_py.common.intents import ReplacePlan, SetHome
from firmware_py.common.plan import Plan, from_plain
from firmware_py.log.schema import REQUEST

PLAN_KINDS: Final = ("mission", "fence", "rally")
_REQUESTS: Final = (ReplacePlan.__name__, SetHome.__name__)


class LoggedPlans:
    """The latest plans, and home in degrees; home is None until it is set and then the caller uses the first fix."""

    def __init__(self) -> None:
        """Start without plans and home."""
        self.plans: dict[str, Plan] = {}
        self.home: tuple[float, float] | None = None

    def add_state(self, text: str) -> None:
        """Read plans and home in a checkpoint; ignore one of another version or a damaged one."""
        try:
            state = json.loads(text)
            plans, home = state.get("plans") or {}, state.get("home")
            self.plans = {name: from_plain(plans[name]) for name in PLAN_KINDS if name in plans}
            if home:
                self._set_home(home["latitude_rad"], home["longitude_rad"])
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            return

    def add_request(self, text: str, fix: Mapping[str, float]) -> None:
        """Read a request of an operator; `fix` is the latest fix with `lat` and `lng` in radians, or empty."""
        if not any(name in text for name in _REQUESTS):
            return
        try:
            intent = _decode_intent(text)
        except (ValueError, TypeError, RecursionError):
            return
        if isinstance(intent, ReplacePlan):
            self.plans[intent.plan.kind.name.lower()] = intent.plan
        elif isinstance(intent, SetHome):
            is_at_fix = intent.latitude_rad is None or intent.longitude_rad is None
            if is_at_fix and fix:
                self._set_home(fix["lat"], fix["lng"])
            elif not is_at_fix:
                self._set_home(intent.latitude_rad, intent.longitude_rad)

    def _set_home(self, latitude_rad: Any, longitude_rad: Any) -> None:
        if math.isfinite(latitude_rad) and math.isfinite(longitude_rad):
            self.home = (math.degrees(latitude_rad), math.degrees(longitude_rad))


def _decode_intent(text: str) -> object:
    request, _ = REQUEST.make(text=text)
    return request.intent
