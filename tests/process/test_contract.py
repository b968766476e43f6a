"""The commands, options, files, columns, keys and names in tests/data/contract.json exist, since scripts rely on them.

Additions are allowed. After an addition, `python tests/process/test_contract.py` writes the list again.
"""

import argparse
import csv
import importlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from firmware_py.common.parameter_table import TABLE as PARAMETERS
from firmware_py.faults.fault import Fault
from firmware_py.link.telemetry.table import TABLE as MESSAGES
from support.json_keys import keys

CONTRACT = Path(__file__).parents[1] / "data" / "contract.json"
PROGRAMS = {"rambler": "firmware_py", "rambler-hil": "hil"}


def list_options(parser):
    """Yield the options and arguments of a parser and of its subcommands."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                yield name
                yield from (f"{name} {option}" for option in list_options(command))
        else:
            yield from action.option_strings or [action.dest]


def list_commands(package):
    """Return the options of each command of a program."""
    options = {}
    for name, (module, _) in importlib.import_module(f"{package}.__main__").COMMANDS.items():
        parser = argparse.ArgumentParser()
        importlib.import_module(module).add_arguments(parser)
        options[name] = sorted(list_options(parser))
    return options


def header(path):
    """Return the columns of a table."""
    with path.open(newline="") as file:
        return next(csv.reader(file))


def list_outputs(directory):
    """Return the files, columns and keys of a run and of the results computed from it."""

    def run_program(package, *words):
        command = [sys.executable, "-m", package, *map(str, words)]
        return subprocess.run(command, capture_output=True, text=True, timeout=300, check=True).stdout

    run, estimate, model = directory / "run", directory / "estimate.csv", directory / "identify.json"
    run_program("hil", "run", "tank", "--speed", "max", "--seconds", "140", "--goal", "0:0,10:40", "--out", run)
    run_program("hil", "estimate", run / "truth.csv", "--out", estimate, "--json", directory / "estimate.json")
    run_program("hil", "identify", run / "truth.csv", "--model", "linear", "--json", model)
    return {
        "run_files": sorted(path.name for path in run.iterdir()),
        "truth.csv": header(run / "truth.csv"),
        "summary.json": sorted(keys(json.loads((run / "summary.json").read_text()))),
        "estimate.csv": header(estimate),
        "estimate --json": sorted(keys(json.loads((directory / "estimate.json").read_text()))),
        "identify --json": sorted(keys(json.loads(model.read_text()))),
        "replay --json": sorted(
            keys(json.loads(run_program("firmware_py", "replay", run / "state/logs/00000001.BIN", "--json")))
        ),
        "scenarios --json": sorted(keys(json.loads(run_program("hil", "scenarios", "--json")))),
    }


def list_names():
    """Return the names of parameters, faults and telemetry messages, and the command lines."""
    return {
        "parameters": [row.name for row in PARAMETERS],
        "faults": [fault.name for fault in Fault],
        "messages": [row.name for row in MESSAGES],
        **{program: list_commands(package) for program, package in PROGRAMS.items()},
    }


def find_missing(expected, present):
    """Return the expected names that are missing."""
    if isinstance(expected, dict):
        return {
            name: absent
            for name, value in expected.items()
            if (absent := find_missing(value, present.get(name) or type(value)()))
        }
    return sorted(set(expected) - set(present))


def test_every_command_option_parameter_fault_and_message_exists():
    assert find_missing(json.loads(CONTRACT.read_text())["names"], list_names()) == {}


@pytest.mark.timeout(300)
def test_every_file_column_and_key_exists(tmp_path):
    assert find_missing(json.loads(CONTRACT.read_text())["outputs"], list_outputs(tmp_path)) == {}


def test_missing_names_are_listed():
    assert find_missing({"a": ["x", "y"], "b": {"c": ["z"]}, "d": []}, {"a": ["y"]}) == {"a": ["x"], "b": {"c": ["z"]}}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        contract = {
            "names": list_names(),
            "outputs": list_outputs(Path(scratch)),
            "status": json.loads(CONTRACT.read_text())["status"],
        }
        CONTRACT.write_text(json.dumps(contract, indent=1) + "\n")
