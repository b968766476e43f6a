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
from firmware_py.files.standard_streams import open_closed_streams
from hil.errors import HilError, UsageError

# Command: module and one line of help. A module has add_arguments(parser) and run(arguments) -> exit code. It is
# imported only for its own command.
COMMANDS = {
    "run": ("hil.cli.run", "run the autopilot in a simulated sea and measure its steering"),
    "board": ("hil.cli.board", "emulate the devices of a boat on ports of their own, for any autopilot"),
    "drill": ("hil.cli.drill", "inject each fault under way and check that it is reported and cleared"),
    "campaign": ("hil.cli.campaign", "many runs drawn from a specification, by the autopilot or in the compiled loop"),
    "serve-json": ("hil.cli.serve_json", "ArduPilot's simulated autopilots on our ship, in our seas, with our scores"),
    "report": ("hil.cli.report", "write a page with plots and figures of a boat's logs, or of a state directory"),
    "identify": ("hil.cli.identify", "identify K, T, alpha and the rudder offset from manoeuvres and onboard logs"),
    "estimate": ("hil.cli.estimate", "run the autopilot's estimator and monitors over a recording"),
    "compare": ("hil.cli.compare", "compare controllers in the same seas: the paper's, a tuned PID, ours"),
    "bench": ("hil.cli.bench", "measure the autopilot and the tools on this machine"),
    "sbd-gateway": (
        "hil.cli.sbd_gateway",
        "shore side of an Iridium link: messages from and to the boat, as MAVLink for a ground station",
    ),
    "scenarios": ("hil.cli.scenarios", "list the scenarios and the disturbance options"),
    "similarity": ("hil.cli.similarity", "the model of the ship at other speeds"),
    "tune": ("hil.cli.tune", "tune the delivered controller, or fixed gains, by artificial fish swarm"),
    "reproduce": ("hil.cli.reproduce", "repeat the paper's chain from manoeuvre to closed loop, and compare figures"),
    "swarm-table": ("hil.cli.swarm_table", "compare the fish swarm with other searches on standard functions"),
}
INTERRUPTED = 130  # exit code after SIGINT, as in a shell
_INSTALL = "pip install 'rambler-autopilot[hil]', or in a checkout .venv/bin/pip install -e '.[hil]'"


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line with the remedy."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} -h")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand; return 0 for success, 1 for a failure or a finding, 2 for invalid usage, 130 for Ctrl-C."""
    open_closed_streams()
    words = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):  # a path may contain characters that the terminal cannot encode
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")
    parser = _Parser(prog="rambler-hil", description="Simulated sea and test tools for the Rambler autopilot.")
    commit = commit_of(ROOT) if "--version" in words else ""  # calls git
    parser.add_argument("--version", action="version", version=version_text("rambler-hil", commit))
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    selected = next((word for word in words if word in COMMANDS), None)
    try:
        for name, (module_name, text) in COMMANDS.items():
            command = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
            if name == selected:
                module = importlib.import_module(module_name)
                module.add_arguments(command)
                command.set_defaults(run=module.run)
        if any("\0" in word for word in words):
            parser.error("an argument contains a NUL character; remove it")
        parsed = parser.parse_args(words)
        code = int(parsed.run(parsed))
        sys.stdout.flush()
    except HilError as error:
        for line in str(error).splitlines() or [""]:
            print(f"rambler-hil: {line}", file=sys.stderr)
        return error.exit_code
    except BrokenPipeError:
        # The reader (head, less) has closed the pipe.
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
