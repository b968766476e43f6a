"""The command line `rambler-hil`."""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from firmware_py import ROOT, commit_of, version_text
from firmware_py.common.system_errors import system_error_text
from firmware_py.files.standard_streams import keep_standard_streams
from hil.errors import HilError, UsageError

# command -> (module, one line of help). A module has add_arguments(parser) and run(arguments) -> exit code,
# and is imported only when its command is asked for.
COMMANDS = {
    "run": ("hil.cli.run", "sail the autopilot in a simulated sea and measure how well it steers"),
    "board": ("hil.cli.board", "the devices of a boat on ports of their own, for whatever is to steer them"),
    "drill": ("hil.cli.drill", "break everything that can break, at sea, and see that each is told and mended"),
    "campaign": ("hil.cli.campaign", "many runs drawn from a specification, by the autopilot or in the compiled loop"),
    "serve-json": ("hil.cli.serve_json", "ArduPilot's autopilots on our ship, in our seas, scored as ours is"),
    "report": ("hil.cli.report", "a page with the pictures and figures of logs from a boat, or of a state directory"),
    "identify": ("hil.cli.identify", "identify K, T, alpha and the rudder offset from manoeuvres and onboard logs"),
    "estimate": ("hil.cli.estimate", "run the autopilot's estimator and monitors over a recording"),
    "compare": ("hil.cli.compare", "controllers side by side in the same seas: the paper's, a tuned PID, ours"),
    "bench": ("hil.cli.bench", "measure the autopilot and the tools on this machine"),
    "sbd-gateway": (
        "hil.cli.sbd_gateway",
        "the shore's side of an Iridium link: messages in, ground station, orders out",
    ),
    "scenarios": ("hil.cli.scenarios", "list the seas that a run can be made in"),
    "similarity": ("hil.cli.similarity", "the model of the ship at other speeds"),
    "tune": ("hil.cli.tune", "tune the delivered controller, or fixed gains, by artificial fish swarm"),
    "reproduce": ("hil.cli.reproduce", "the paper's chain from manoeuvre to closed loop, and its figures against ours"),
    "swarm-table": ("hil.cli.swarm_table", "the fish swarm beside other searches on the standard functions"),
}
INTERRUPTED = 130
_INSTALL = "pip install 'rambler-autopilot[hil]', or in a checkout .venv/bin/pip install -e '.[hil]'"


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line that names the remedy."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} -h")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand; 0 success, 1 a finding, 2 bad usage or configuration."""
    keep_standard_streams()
    words = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):  # a path may hold what the terminal's alphabet has not
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")
    parser = _Parser(prog="rambler-hil", description="The sea in a box for the Rambler autopilot.")
    commit = commit_of(ROOT) if "--version" in words else ""  # git is asked only then
    parser.add_argument("--version", action="version", version=version_text("rambler-hil", commit))
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    wanted = next((word for word in words if word in COMMANDS), None)
    try:
        for name, (module_name, text) in COMMANDS.items():
            command = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
            if name == wanted:
                module = importlib.import_module(module_name)
                module.add_arguments(command)
                command.set_defaults(run=module.run)
        if any("\0" in word for word in words):
            parser.error("a word of the command line holds a NUL, which no path and no name does")
        parsed = parser.parse_args(words)
        code = int(parsed.run(parsed))
        sys.stdout.flush()
    except HilError as error:
        for line in str(error).splitlines() or [""]:
            print(f"rambler-hil: {line}", file=sys.stderr)
        return error.exit_code
    except BrokenPipeError:
        # The reader (head, less) has seen enough.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] in ("hil", "firmware_py"):
            raise
        print(f"rambler-hil: {error.name} is not installed; {_INSTALL}", file=sys.stderr)
        return 2
    except Exception as error:
        text = system_error_text(error)
        if not text:
            raise
        print(f"rambler-hil: {text}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return INTERRUPTED
    return code


if __name__ == "__main__":
    sys.exit(main())
