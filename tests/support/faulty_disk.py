"""A disk that fails by plan: each call in turn, before or after its effect, once or from then on; and power cuts."""

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
KINDS = ("refused", "late", "torn", "short")  # without effect; after it; in the middle of it; fewer bytes than asked
CUTS = ("nothing", "everything", "first sector", "all but the first sector")  # of what was not forced to disk


def sampled(calls, number, seed):
    """Return so many of the calls, in order, for tests that let each of them fail only as a proof."""
    return sorted(random.Random(seed).sample(range(calls), min(number, calls)))


class FaultyDisk:
    """Stands before the calls of `os` that touch files in a directory; syncs reach its own memory, not the platters."""

    def __init__(self, directory, monkeypatch):
        self.directory = Path(directory)
        self.durable = {}  # bytes of each file on the platters, by its name
        self.named = {}  # names on the platters, and the file that each leads to
        self.still = threading.Lock()  # its holder sees the disk between two calls
        self._paths = {}
        self._real = {name: getattr(os, name) for name in CALLS}
        self.arm(None)
        for name in CALLS:
            monkeypatch.setattr(os, name, lambda *words, name=name, **more: self._call(name, words, more))

    def arm(self, at, kind="refused", *, lasting=False):
        """Let the call number `at` from now on fail, and all later ones too when lasting; None: all is well."""
        self.at, self.kind, self.lasting = at, kind, lasting
        self.count = 0
        self.failed = []

    def cut(self, target, pattern):
        """Write what the next start finds after a power cut; of what was not forced to disk, by the pattern."""
        target.mkdir()
        for name in self.named:
            path = self.directory / name
            durable = self.durable.get(name, b"")
            now = path.read_bytes() if path.exists() else durable
            if pattern == "nothing":
                now = durable
            elif pattern == "first sector":
                now = now[:SECTOR] + durable[SECTOR:]
            elif pattern == "all but the first sector":
                now = durable[:SECTOR].ljust(min(SECTOR, len(now)), b"\0") + now[SECTOR:]
            (target / name).write_bytes(now)

    def _path_of(self, word):
        if isinstance(word, int):
            return self._paths.get(word)
        path = Path(os.fspath(word))
        return path if self.directory in (path, path.parent) else None

    def _call(self, name, words, more):
        path, real = self._path_of(words[0]), self._real[name]
        if path is None:
            return real(*words, **more)
        with self.still:
            number, self.count = self.count, self.count + 1
            fails = self.at is not None and (number == self.at or (self.lasting and number > self.at))
            if fails:
                self.failed.append(name)
                return self._fail(name, path, words, more)
            return self._act(name, path, words, more)

    def _fail(self, name, path, words, more):
        real = self._real[name]
        if name == "close":  # the descriptor is gone in any case
            self._act(name, path, words, more)
        elif name in ("write", "pwrite") and self.kind in ("torn", "short"):
            written = real(words[0], words[1][: min(SECTOR, len(words[1]) // 2)], *words[2:], **more)
            if self.kind == "short":
                return written
        elif self.kind == "late":
            result = self._act(name, path, words, more)
            if name == "open":
                self._act("close", path, (result,), {})
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    def _act(self, name, path, words, more):
        if name == "fdatasync" or (name == "fsync" and path != self.directory):
            self.durable[path.name] = path.read_bytes() if path.exists() else b""
            return None
        if name == "fsync":
            self.named = dict.fromkeys(entry.name for entry in path.iterdir() if entry.is_file())
            return None
        result = self._real[name](*words, **more)
        if name == "open":
            self._paths[result] = path
        elif name == "close":
            self._paths.pop(words[0], None)
        elif name in ("rename", "replace"):  # the file on the platters is the same, by another name
            self.durable[Path(words[1]).name] = self.durable.get(path.name, b"")
        return result
