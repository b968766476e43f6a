"""Plans and home in a log: from its initial state, and from requests after it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, Final

from firmware_py.common.intents import ReplacePlan, SetHome
from firmware_py.common.plan import Plan, from_plain
from firmware_py.log.schema import REQUEST

PLANS: Final = ("mission", "fence", "rally")
_REQUESTS: Final = (ReplacePlan.__name__, SetHome.__name__)


class Orders:
    """The latest plans, and home in degrees; None until it is set: then home is the first fix."""

    def __init__(self) -> None:
        """Start without any."""
        self.plans: dict[str, Plan] = {}
        self.home: tuple[float, float] | None = None

    def add_state(self, text: str) -> None:
        """Read a checkpoint, as far as possible."""
        try:
            state = json.loads(text)
            plans, home = state.get("plans") or {}, state.get("home")
            self.plans = {name: from_plain(plans[name]) for name in PLANS if name in plans}
            if home:
                self._set_home(home["latitude_rad"], home["longitude_rad"])
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            return  # another version, or damaged

    def add_request(self, text: str, fix: Mapping[str, float]) -> None:
        """Read a request of an operator; `fix` is the latest, `lat` and `lng` in radians."""
        if not any(name in text for name in _REQUESTS):
            return
        try:
            intent = _intent(text)
        except (ValueError, TypeError, RecursionError):
            return
        if isinstance(intent, ReplacePlan):
            self.plans[intent.plan.kind.name.lower()] = intent.plan
        elif isinstance(intent, SetHome):
            here = intent.latitude_rad is None or intent.longitude_rad is None
            if here and fix:
                self._set_home(fix["lat"], fix["lng"])
            elif not here:
                self._set_home(intent.latitude_rad, intent.longitude_rad)

    def _set_home(self, latitude_rad: Any, longitude_rad: Any) -> None:
        if math.isfinite(latitude_rad) and math.isfinite(longitude_rad):
            self.home = (math.degrees(latitude_rad), math.degrees(longitude_rad))


def _intent(text: str) -> object:
    request, _ = REQUEST.make(text=text)
    return request.intent
