"""A disk whose calls fail at a chosen number, before or after their effect, once or from then on; power cuts."""

import errno
import os
import random
import threading
from pathlib import Path

SECTOR = 512
CALLS = (
    "open",
    "close",
    "read",
    "write",
    "pwrite",
    "fdatasync",
    "fsync",
    "chmod",
    "ftruncate",
    "rename",
    "replace",
    "unlink",
)
KINDS = ("refused", "late", "torn", "short")  # no effect; full effect; partial effect; fewer bytes without an error
CUTS = ("nothing", "everything", "first sector", "all but the first sector")  # of the data that was not synced


def sample_calls(calls, number, seed):
    """Return a sorted sample of call numbers; the tests of all calls are marked `proof`."""
    return sorted(random.Random(seed).sample(range(calls), min(number, calls)))


class FaultyDisk:
    """Replacement of the calls of `os` for files in a directory; it stores the synced data in memory."""

    def __init__(self, directory, monkeypatch):
        self.directory = Path(directory)
        self.durable = {}  # synced bytes of each file, by its name
        self.names = {}  # synced names of the directory
        self.lock = threading.Lock()  # held during each call
        self._paths = {}
        self._real = {name: getattr(os, name) for name in CALLS}
        self.arm(None)
        for name in CALLS:
            monkeypatch.setattr(os, name, lambda *args, name=name, **kwargs: self._call(name, args, kwargs))

    def arm(self, at, kind="refused", *, lasting=False):
        """Let the call number `at` from now on fail, and with `lasting` all later ones; None: no call fails."""
        self.at, self.kind, self.lasting = at, kind, lasting
        self.count = 0
        self.failed = []

    def cut(self, target, pattern):
        """Write the files as after a power cut; the pattern decides on the data that was not synced."""
        target.mkdir()
        for name in self.names:
            path = self.directory / name
            durable = self.durable.get(name, b"")
            content = path.read_bytes() if path.exists() else durable
            if pattern == "nothing":
                content = durable
            elif pattern == "first sector":
                content = content[:SECTOR] + durable[SECTOR:]
            elif pattern == "all but the first sector":
                content = durable[:SECTOR].ljust(min(SECTOR, len(content)), b"\0") + content[SECTOR:]
            (target / name).write_bytes(content)

    def _path_of(self, argument):
        if isinstance(argument, int):
            return self._paths.get(argument)
        path = Path(os.fspath(argument))
        return path if self.directory in (path, path.parent) else None

    def _call(self, name, args, kwargs):
        path, real = self._path_of(args[0]), self._real[name]
        if path is None:
            return real(*args, **kwargs)
        with self.lock:
            number, self.count = self.count, self.count + 1
            fails = self.at is not None and (number == self.at or (self.lasting and number > self.at))
            if fails:
                self.failed.append(name)
                return self._fail(name, path, args, kwargs)
            return self._act(name, path, args, kwargs)

    def _fail(self, name, path, args, kwargs):
        real = self._real[name]
        if name == "close":  # it closes the descriptor also if it fails
            self._act(name, path, args, kwargs)
        elif name in ("write", "pwrite") and self.kind in ("torn", "short"):
            written = real(args[0], args[1][: min(SECTOR, len(args[1]) // 2)], *args[2:], **kwargs)
            if self.kind == "short":
                return written
        elif self.kind == "late":
            result = self._act(name, path, args, kwargs)
            if name == "open":
                self._act("close", path, (result,), {})
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    def _act(self, name, path, args, kwargs):
        if name == "fdatasync" or (name == "fsync" and path != self.directory):
            self.durable[path.name] = path.read_bytes() if path.exists() else b""
            return None
        if name == "fsync":
            self.names = dict.fromkeys(entry.name for entry in path.iterdir() if entry.is_file())
            return None
        result = self._real[name](*args, **kwargs)
        if name == "open":
            self._paths[result] = path
        elif name == "close":
            self._paths.pop(args[0], None)
        elif name in ("rename", "replace"):  # the synced file gets another name
            self.durable[Path(args[1]).name] = self.durable.get(path.name, b"")
        return result
