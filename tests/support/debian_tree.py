"""A Debian tree that is booted with its own systemd in namespaces of its own, and changed in a layer over it.

No container program is needed: overlayfs, a cgroup of version 2 and unshare(1). The network is that of the machine.
"""

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

from support.paths import ROOT

TREE = Path(os.environ.get("DEBIAN_TREE", ROOT / "build/debian-trixie"))
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"  # root's, in Debian
BOOT_S, COMMAND_S = 120.0, 600.0
# How programs in the tree reach the network from here.
PASSED_ON = (
    "PIP_CERT",
    "PIP_INDEX_URL",
    "SSL_CERT_",
    "HTTP_PROXY",
    "HTTPS_PROXY",
    "http_proxy",
    "https_proxy",
    "no_proxy",
)
BOOT = """
set -e
mount -t overlay overlay -o "lowerdir=$TREE,upperdir=$LAYER/upper,workdir=$LAYER/work" "$LAYER/root"
cd "$LAYER/root"
mount -t proc proc proc
mount -t sysfs -o ro sysfs sys
mount -t cgroup2 cgroup2 sys/fs/cgroup
mount -t tmpfs -o mode=755 tmpfs run
mount -t tmpfs -o mode=1777 tmpfs tmp
mount -t tmpfs -o mode=755 tmpfs dev
for node in null zero full random urandom tty; do touch dev/$node; mount --bind /dev/$node dev/$node; done
mkdir dev/pts dev/shm
mount --bind /dev/pts dev/pts
mount -t tmpfs -o mode=1777 tmpfs dev/shm
ln -s pts/ptmx dev/ptmx
mkdir -p srv/boat
mount --bind "$SHARED" srv/boat
if [ -d /etc/ssl/certs ]; then mkdir -p etc/ssl/certs; mount --bind /etc/ssl/certs etc/ssl/certs; fi
cat /etc/resolv.conf >etc/resolv.conf
: >etc/fstab
mkdir -p .before
pivot_root . .before
umount -l /.before
hostname float
exec env -i container=other PATH=/usr/sbin:/usr/bin:/sbin:/bin /lib/systemd/systemd --system \
  --unit=multi-user.target --log-target=console --show-status=0 </dev/null >/var/log/boot.log 2>&1
"""


def why_not():
    """Why no tree can be booted here; empty when one can."""
    if os.geteuid() != 0:
        return "booting a Debian tree takes root"
    for program in ("unshare", "nsenter", "pivot_root"):
        if shutil.which(program) is None:
            return f"{program} is not there (util-linux)"
    if _cgroup() is None:
        return "there is no cgroup of version 2 to boot a tree in"
    if "overlay" not in Path("/proc/filesystems").read_text():
        return "the kernel has no overlayfs"
    if not (TREE / "etc/debian_version").exists():
        return f"there is no Debian tree at {TREE}; .ci/debian_tree makes it"
    return ""


def _cgroup():
    for line in Path("/proc/mounts").read_text().splitlines():
        _, place, kind, options, *_ = line.split()
        if kind == "cgroup2" and "rw" in options.split(","):
            return Path(place)
    return None


class BootedTree:
    """A tree under way; `shared` is its /srv/boat, `layer` keeps what was changed over a reboot. A context."""

    def __init__(self, layer, shared):
        self.layer, self.shared = layer, shared
        for name in ("upper", "work", "root"):
            (layer / name).mkdir(parents=True, exist_ok=True)
        self._cgroup = _cgroup() / f"rambler-tree-{os.getpid()}"

    def __enter__(self):
        self.boot()
        return self

    def __exit__(self, *_error):
        self.cut_power()

    def boot(self):
        self._cgroup.mkdir(exist_ok=True)
        words = ["unshare", "--mount", "--pid", "--uts", "--ipc", "--cgroup", "--fork", "--kill-child=SIGKILL"]
        more = {"TREE": str(TREE), "LAYER": str(self.layer), "SHARED": str(self.shared)}
        self._outer = subprocess.Popen(
            ["sh", "-c", f'echo $$ >{self._cgroup}/cgroup.procs; exec "$@"', "sh", *words, "sh", "-c", BOOT],
            env={**os.environ, **more},
        )
        self.pid = self._until(self._child, "a process")
        self._until(lambda: self._command("test -S /run/systemd/private").returncode == 0, "systemd")
        self._until(lambda: self.state() in ("running", "degraded"), "the end of booting")

    def state(self):
        return self._command("systemctl is-system-running").stdout.strip()

    def cut_power(self):
        """End everything in the tree at once."""
        self._outer.send_signal(signal.SIGKILL)
        self._outer.wait()
        self._until(self._cgroup_removed, "its end")

    def _cgroup_removed(self):
        try:
            for folder in sorted((path for path in self._cgroup.rglob("*") if path.is_dir()), reverse=True):
                folder.rmdir()
            self._cgroup.rmdir()
        except OSError:  # the last of its processes are still ending
            return False
        return True

    def run(self, command):
        """Run a command line as its root and return what it prints; it must succeed."""
        done = self._command(command)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        return done.stdout

    def _command(self, command):
        passed_on = {name: value for name, value in os.environ.items() if name.startswith(PASSED_ON)}
        path = {"PATH": PATH, "HOME": "/root", "DEBIAN_FRONTEND": "noninteractive"}
        return subprocess.run(
            ["nsenter", f"--target={self.pid}", "--mount", "--pid", "--uts", "--ipc", "--cgroup", "sh", "-ec", command],
            env={**passed_on, **path}, capture_output=True, text=True, timeout=COMMAND_S, check=False,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip

    def _child(self):
        pid = self._outer.pid
        return int((Path(f"/proc/{pid}/task/{pid}/children").read_text().split() or ["0"])[0])

    def _until(self, found, what):
        give_up_s = time.monotonic() + BOOT_S
        while not (value := found()):
            assert time.monotonic() < give_up_s, f"no {what} within {BOOT_S:g} s: {self._last_words()}"
            assert self._outer.poll() is None or what == "its end", self._last_words()
            time.sleep(0.1)
        return value

    def _last_words(self):
        log = self.layer / "upper/var/log/boot.log"
        return log.read_text(errors="replace")[-2000:] if log.exists() else ""
