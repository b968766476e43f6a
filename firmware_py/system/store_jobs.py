"""What the store's writer has to do, and how it does one piece of it."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_py.system.slots import SlotWriter


@dataclass(frozen=True, slots=True)
class Job:
    """A version to be written; None: the failed one is withdrawn. `once`: it is not tried again.

    `both`: into both slots, one after the other.
    """

    content: bytes | None
    once: bool = False
    both: bool = False


@dataclass(frozen=True, slots=True)
class Failure:
    """What went wrong with a name, and what is still to be done for it."""

    text: str
    job: Job


def write_job(writer: SlotWriter, name: str, job: Job, unheld: str) -> Failure | None:
    """Do a job, unless the directory is not held; return what went wrong, None when nothing did."""
    if unheld:
        return Failure(f"{name} cannot be stored: {unheld}", Job(None) if job.once else job)
    try:
        if job.content is None:
            writer.withdraw(name)
        else:
            for _ in range(1 + job.both):
                writer.write(name, job.content)
    except OSError as error:
        text = f"{name} cannot be stored: {error.strerror or error}"
        if writer.is_unproven(name):
            text += "; the next start may find it all the same"
        return Failure(text, Job(None) if job.once else job)
    return None
