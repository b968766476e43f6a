"""Who gets a place on a link: places are few, shared by address, and those of strangers are taken first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from typing import NamedTuple

PLACES = 8  # on one link, beside those whom the vehicle file names
STRANGERS_PLACES = 4  # of them, once there is a key to tell strangers by
QUIET_S = 10.0  # one who is silent for this long makes room for a new one
WAITING = 16  # who have not shown yet that they are there; not counted among the places


class Guest(NamedTuple):
    """One who has, or wants, a place."""

    key: tuple[int, Hashable]  # index of the transport, and who
    host: Hashable  # the computer it comes from
    known: bool  # the owner's, as far as can be told
    heard_s: float


def who_leaves(newcomer: Guest, guests: Sequence[Guest], now_s: float) -> Sequence[Guest] | None:
    """Return who has to leave for a newcomer: nobody while there is room; None when there is none for him.

    One of the owner's takes a stranger's place, a stranger never one of the owner's. Among equals the silent one
    leaves, or one of the address that has more places than the newcomer's would.
    """
    strangers = [guest for guest in guests if not guest.known]
    if len(guests) < PLACES and (newcomer.known or len(strangers) < STRANGERS_PLACES):
        return ()
    if newcomer.known and strangers:
        return (_longest_silent_of_most(strangers),)
    rivals = guests if newcomer.known else strangers
    if not rivals:
        return None
    silent = min(rivals, key=lambda guest: guest.heard_s)
    if now_s - silent.heard_s > QUIET_S:
        return (silent,)
    places = Counter(guest.host for guest in rivals)
    candidate = _longest_silent_of_most(rivals)
    return (candidate,) if places[candidate.host] > places[newcomer.host] + 1 else None


def who_waits_no_more(waiting: Sequence[Guest]) -> Sequence[Guest]:
    """Return who has to leave when too many wait: of the address with the most, who has waited longest."""
    return (_longest_silent_of_most(waiting),) if len(waiting) > WAITING else ()


def _longest_silent_of_most(guests: Sequence[Guest]) -> Guest:
    places = Counter(guest.host for guest in guests)
    return min(guests, key=lambda guest: (-places[guest.host], guest.heard_s))
