"""Fixtures: links in memory, with and without files on disk, and selection of sent messages."""

import pytest

from firmware_py.link.files.tree import FileRoot
from firmware_py.log.disk import log_files
from support.ftp import FtpStation
from support.link import SNAPSHOT, Rig, of_type


@pytest.fixture
def stored(tmp_path):
    """A rig with logs and a place for uploads, and a client of its files; `stored(...)` makes more."""

    def make(*, background=False, **more):
        for name in ("logs", "uploads"):
            (tmp_path / name).mkdir(exist_ok=True)
        storage = FileRoot(
            lambda: log_files(tmp_path / "logs"),
            tmp_path / "logs",
            tmp_path / "uploads",
            logging=True,
            background=background,
        )
        made = Rig(storage=storage, **more)
        made.tick()
        return made, FtpStation(made)

    return make


@pytest.fixture
def ftp_station():
    return FtpStation


@pytest.fixture
def rig():
    """A rig that has sent the first messages to its peer."""
    made = Rig()
    made.endpoint.service(0.0, [])
    made.tick()
    return made


@pytest.fixture
def make_rig():
    return Rig


@pytest.fixture
def of():
    return of_type


@pytest.fixture
def texts():
    """Return the STATUSTEXTs of messages, chunks put together."""

    def join(messages):
        whole = []
        for message in of_type(messages, "STATUSTEXT"):
            if message.chunk_seq:
                whole[-1] += message.text
            else:
                whole.append(message.text)
        return whole

    return join


@pytest.fixture
def snapshot():
    return SNAPSHOT
