"""A Debian tree that is booted with its systemd in separate namespaces; changes are written to an overlay.

It needs overlayfs, a cgroup of version 2 and unshare(1), but no container program. The network is that of the machine.
"""

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

from support.paths import ROOT

TREE = Path(os.environ.get("DEBIAN_TREE", ROOT / "build/debian-trixie"))
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"  # of root in Debian
BOOT_S, COMMAND_S = 120.0, 600.0
# Environment variables that programs in the tree need for the network.
NETWORK_VARIABLES = (
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


def reason_to_skip():
    """Return the reason why no tree can be booted here; empty if one can."""
    if os.geteuid() != 0:
        return "booting a Debian tree needs root"
    for program in ("unshare", "nsenter", "pivot_root"):
        if shutil.which(program) is None:
            return f"{program} is missing (util-linux)"
    if _cgroup() is None:
        return "there is no cgroup of version 2 for a tree"
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
    """A context with a booted tree; `shared` is its /srv/boat, `layer` stores its changes, also over a reboot."""

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
        command = ["unshare", "--mount", "--pid", "--uts", "--ipc", "--cgroup", "--fork", "--kill-child=SIGKILL"]
        variables = {"TREE": str(TREE), "LAYER": str(self.layer), "SHARED": str(self.shared)}
        self._outer = subprocess.Popen(
            ["sh", "-c", f'echo $$ >{self._cgroup}/cgroup.procs; exec "$@"', "sh", *command, "sh", "-c", BOOT],
            env={**os.environ, **variables},
        )
        self.pid = self._until(self._child, "a process")
        self._until(lambda: self._command("test -S /run/systemd/private").returncode == 0, "systemd")
        self._until(lambda: self.state() in ("running", "degraded"), "the end of booting")

    def state(self):
        return self._command("systemctl is-system-running").stdout.strip()

    def cut_power(self):
        """Kill all processes of the tree."""
        self._outer.send_signal(signal.SIGKILL)
        self._outer.wait()
        self._until(self._cgroup_removed, "its end")

    def _cgroup_removed(self):
        try:
            for folder in sorted((path for path in self._cgroup.rglob("*") if path.is_dir()), reverse=True):
                folder.rmdir()
            self._cgroup.rmdir()
        except OSError:  # its last processes are still ending
            return False
        return True

    def run(self, command):
        """Run a command line as root in the tree, which must succeed; return its output."""
        result = self._command(command)
        assert result.returncode == 0, f"{command}\n{result.stdout}{result.stderr}"
        return result.stdout

    def _command(self, command):
        network_variables = {name: value for name, value in os.environ.items() if name.startswith(NETWORK_VARIABLES)}
        path = {"PATH": PATH, "HOME": "/root", "DEBIAN_FRONTEND": "noninteractive"}
        return subprocess.run(
            ["nsenter", f"--target={self.pid}", "--mount", "--pid", "--uts", "--ipc", "--cgroup", "sh", "-ec", command],
            env={**network_variables, **path}, capture_output=True, text=True, timeout=COMMAND_S, check=False,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip

    def _child(self):
        pid = self._outer.pid
        return int((Path(f"/proc/{pid}/task/{pid}/children").read_text().split() or ["0"])[0])

    def _until(self, condition, description):
        deadline_s = time.monotonic() + BOOT_S
        while not (value := condition()):
            assert time.monotonic() < deadline_s, f"no {description} within {BOOT_S:g} s: {self._last_output()}"
            assert self._outer.poll() is None or description == "its end", self._last_output()
            time.sleep(0.1)
        return value

    def _last_output(self):
        log = self.layer / "upper/var/log/boot.log"
        return log.read_text(errors="replace")[-2000:] if log.exists() else ""
