"""What the store's writer has to do, and how it does one piece of it."""

from __future__ import annotations

import contextlib
from pathlib import Path

import msgspec

from firmware_py.files.writing import set_aside
from firmware_py.system.directory_lock import StoreError
from firmware_py.system.slots import SlotWriter, is_secret
from firmware_py.system.state_export import (
    PENDING_IMPORT,
    BrokenExportError,
    end_import,
    pending_import,
    remove_leftovers,
)


class Job(msgspec.Struct, frozen=True):
    """A version to be written; None: the failed one is withdrawn. `once`: it is not tried again.

    `both_slots`: into both slots, one after the other. `aside`: a record whose slots of an earlier version are renamed,
    and nothing else.
    """

    content: bytes | None
    once: bool = False
    both_slots: bool = False
    aside: str = ""


class Failure(msgspec.Struct, frozen=True):
    """What went wrong with a name, and what is still to be done for it."""

    text: str
    job: Job


def write_job(writer: SlotWriter, name: str, job: Job, lock_problem: str) -> Failure | None:
    """Do a job, unless the directory is not held; return what went wrong, None when nothing did."""
    if lock_problem:
        return Failure(f"{name} cannot be stored: {lock_problem}", Job(None) if job.once else job)
    try:
        if job.aside:
            writer.set_aside(job.aside)
        elif job.content is None:
            writer.withdraw(name)
        else:
            for _ in range(1 + job.both_slots):
                writer.write(name, job.content)
    except OSError as error:
        text = f"{name} cannot be {'set aside' if job.aside else 'stored'}: {error.strerror or error}"
        if writer.is_unproven(name):
            text += "; the next start may find it all the same"
        return Failure(text, Job(None) if job.once else job)
    return None


def finish_import(directory: Path) -> str:
    """Bring what an import has begun into the slots of a directory that is held, before anything else is written there.

    One that cannot be used is set aside; returns what was wrong with it. StoreError when the disk does not take or give
    one that counts.
    """
    try:
        remove_leftovers(directory)
        awaited = pending_import(directory)
        if awaited is None:
            return ""
        writer = SlotWriter(directory, frozenset(filter(is_secret, awaited.files)))
        try:
            for name in awaited.files:
                content = awaited.content(name)
                if content is None:
                    writer.clear(name)
                for _ in range(0 if content is None else 1 + is_secret(name)):  # nothing is left of another secret
                    writer.write(name, content or b"")
                writer.set_aside(name)
        finally:
            writer.close()
        end_import(directory)
    except BrokenExportError as error:
        with contextlib.suppress(OSError):
            return f"Import not used: {error}; set aside as {set_aside(directory / PENDING_IMPORT).name}"
        return f"Import not used: {error}"
    except OSError as error:
        text = f"state directory {directory}: what was imported cannot be written: {error.strerror}"
        raise StoreError(f"{text}; make room and start again") from None
    return ""
