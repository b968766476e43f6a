"""Commands on home, mission and fence."""

from __future__ import annotations

from firmware_py.common.intents import Answer, EnableFence, PauseMission, SetHome, SetMissionItem, SetMode, Verdict
from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import PlanKind, first_item_number
from firmware_py.common.records import Severity
from firmware_py.link.commands.server import PARAM1_NOT_0_OR_1, CommandCall, CommandRow
from firmware_py.link.commands.steering import GLOBAL_FRAMES, home_request
from firmware_py.link.context import LinkContext, within
from firmware_py.link.telemetry.fields import UINT16_MAX
from firmware_py.plans.items import ROWS, Command

_CURRENT_ITEM = -1.0


def set_home(context: LinkContext, call: CommandCall) -> Answer:
    """Set home to the present position (param1 = 1) or to the position in param5 to param7 (0)."""
    use_present = call.parameters[0]
    if use_present not in (0.0, 1.0):
        return call.deny(PARAM1_NOT_0_OR_1)
    if use_present:
        return context.request(call.message, SetHome(), call.now_s)
    if call.frame is not None and call.frame not in GLOBAL_FRAMES:
        return call.deny(f"frame {call.frame} is not a global one")
    home = home_request(*call.position_deg, call.z)
    return call.deny(home) if isinstance(home, str) else context.request(call.message, home, call.now_s)


def pause_or_continue(context: LinkContext, call: CommandCall) -> Answer:
    """Pause the mission (param1 = 0) or continue it (1)."""
    action = call.parameters[0]
    if action not in (0.0, 1.0):
        return call.deny(PARAM1_NOT_0_OR_1)
    return context.request(call.message, PauseMission(paused=action == 0.0), call.now_s)


def start_mission(context: LinkContext, call: CommandCall) -> Answer:
    """Enter AUTO, at item param1 if that is not 0; param2 must be 0 or the last item."""
    first, last = call.parameters[:2]
    if not _item_count(context):
        return call.deny("there is no mission")
    index = _item_index(context, first)
    allowed_last = (0.0, float(_item_count(context) - 1 + first_item_number(context.autopilot, PlanKind.MISSION)))
    if index is None or last not in allowed_last:
        return call.deny(f"first item {first:g} or last item {last:g} is not valid")
    answer = context.request(call.message, SetMode(int(Mode.AUTO)), call.now_s)
    # 0 is the current item. After the mode change, an item in range is not refused.
    if answer.verdict is not Verdict.ACCEPTED or first == 0.0:
        return answer
    return context.request(call.message, SetMissionItem(index), call.now_s)


def set_mission_item(context: LinkContext, call: CommandCall) -> Answer:
    """Continue with another item of the mission; param2 = 1 also restarts it."""
    number, restart = call.parameters[:2]
    if restart not in (0.0, 1.0):
        return call.deny(f"param2 {restart:g} is neither 0 nor 1")
    index = _item_index(context, number)
    if index is None:
        return Answer(Verdict.FAILED, f"{call.name}: the mission has no such item")
    return context.request(call.message, SetMissionItem(index, restart=restart == 1.0), call.now_s)


def _item_count(context: LinkContext) -> int:
    """Return the number of items of the present mission; the snapshot may be older than an upload."""
    return len(context.request_handler.plans().mission.items)


def _item_index(context: LinkContext, number: float) -> int | None:
    """Convert the item number of a ground station to an index; return None if there is no such item."""
    if _item_count(context) == 0:
        return None
    if number == _CURRENT_ITEM:
        return 0 if context.snapshot is None else context.snapshot.mission.index or 0
    if not within(number, 0, UINT16_MAX) or number != int(number):
        return None
    # If item 0 is home, it means the first item.
    index = max(0, int(number) - first_item_number(context.autopilot, PlanKind.MISSION))
    return index if index < _item_count(context) else None


def enable_fence(context: LinkContext, call: CommandCall) -> Answer:
    """Enable (param1 = 1) or disable (0) the whole fence."""
    state, kinds = call.parameters[:2]
    if state not in (0.0, 1.0):
        return call.deny(PARAM1_NOT_0_OR_1)
    if not within(kinds, 0, UINT16_MAX) and kinds == kinds:  # noqa: PLR0124 - NaN means "not used"
        return call.deny("the kinds of fence are not a number")
    if kinds > 0:
        return Answer(Verdict.UNSUPPORTED, f"{call.name}: fence kinds cannot be chosen; use param2 = 0")
    return context.request(call.message, EnableFence(state == 1.0), call.now_s)


def change_speed(context: LinkContext, call: CommandCall) -> Answer:
    """Validate a speed as in a mission item, and ignore it with a notice."""
    for meaning in ROWS[Command.CHANGE_SPEED].meanings:
        value = call.parameters[meaning.number - 1]
        if not meaning.admits(value):
            return call.deny(f"param{meaning.number} is {value:g}; allowed: {meaning.allowed()}")
    context.send_text_limited(
        call.peer, Severity.NOTICE, "Speed command ignored: a wave glider cannot set its speed", call.now_s
    )
    return Answer(Verdict.ACCEPTED)


COMMANDS = (
    CommandRow(178, "DO_CHANGE_SPEED", change_speed, "no effect, with a notice: a wave glider cannot set its speed"),
    CommandRow(179, "DO_SET_HOME", set_home, "home is the present position (param1 = 1), or param5 to param7 (0)"),
    CommandRow(193, "DO_PAUSE_CONTINUE", pause_or_continue, "pause the mission (param1 = 0), continue it (1)"),
    CommandRow(207, "DO_FENCE_ENABLE", enable_fence, "enable (param1 = 1) or disable (0) the whole fence"),
    CommandRow(
        224,
        "DO_SET_MISSION_CURRENT",
        set_mission_item,
        "continue with item param1 (-1: the current one); param2 = 1 restarts the mission",
    ),
    CommandRow(
        300,
        "MISSION_START",
        start_mission,
        "enter AUTO and continue, at item param1 unless it is 0; a complete mission restarts",
    ),
)
