"""Two drills at once: what one takes away that the other would be told by, or would steer by."""

from __future__ import annotations

from collections.abc import Sequence

from hil.lab.drill.book import Drill

# What is taken from the rest of the boat while it stands.
TAKES = {
    "compass silent": {"compass", "its number"},
    "compass frozen": {"its number"},
    "compass loses and flips bytes": {"its number"},
    "compasses disagree": {"other compass"},
    "position lost": {"receiver"},
    "position jumps": {"receiver"},
    "servo's cable out": {"servo", "torque"},
    "servo's hardware error": {"torque"},
    "servo's power cut": {"torque"},
    "power monitor silent": {"monitor"},
}
# What a fault is told by, besides what the drill itself breaks.
NEEDS = {
    "compass frozen": {"compass"},
    "compasses disagree": {"compass", "its number"},
    "position jumps": {"receiver"},
    "servo's hardware error": {"servo"},
    "servo overloaded": {"torque"},
    "servo's power cut": {"torque"},
    "battery low": {"monitor"},
}
NO_HEADING = ("Heading lost", "No valid heading", "Compass heading jumped")


def taken(drills: Sequence[Drill]) -> set[str]:
    """Return what drills that stand at once take away."""
    return {one for drill in drills for one in TAKES.get(drill.name, ())}


def is_hidden(drill: Drill, drills: Sequence[Drill]) -> bool:
    """Whether a drill need not be told while the others stand."""
    others = [other for other in drills if other is not drill]
    return bool(NEEDS.get(drill.name, set()) & taken(others))


def is_blind(drills: Sequence[Drill]) -> bool:
    """Whether two drills together leave her no heading, or one of a compass that is off and nothing contradicts."""
    return bool(explained(drills))


def explained(drills: Sequence[Drill]) -> tuple[str, ...]:
    """Return what may be said besides of two: while the first compass is away, that there is no heading, or another."""
    lost = "its number" in taken(drills) and bool({"receiver", "other compass"} & taken(drills))
    return NO_HEADING if len(drills) > 1 and lost else ()


def stops_her(drill: Drill, drills: Sequence[Drill]) -> bool:
    """Whether she cannot steer at all while a drill stands with others that ask for her course."""
    return len(drills) > 1 and "servo" in taken([drill])
