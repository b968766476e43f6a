"""Settings for all tests: examples drawn the same every time, no files left behind, and time for the long proofs."""

import gc
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.configuration import set_hypothesis_home_dir

from hil.bench.machine import circumstances, text_of
from hil.report.figure_file import entry, merge, origin

PROOF_S = 3600.0

# A shell starts what goes to the background deaf to Ctrl-C, and what tests start would be so, too.
signal.signal(signal.SIGINT, signal.default_int_handler)

# What it keeps goes where pytest keeps its own, out of the sight of git.
set_hypothesis_home_dir(Path(__file__).parents[1] / ".venv" / ".pytest_cache" / "hypothesis")

# The suite draws 20 examples; `pytest --hypothesis-profile proof` draws more.
settings.register_profile(
    "rambler",
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=20,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile("proof", settings.get_profile("rambler"), max_examples=1000)
settings.load_profile("rambler")


def pytest_collection_modifyitems(items):
    """A proof that names no time of its own has an hour, however it is run."""
    for item in items:
        if item.get_closest_marker("proof") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(PROOF_S))


def pytest_collection():
    """Collect without garbage collections, which find nothing: what is collected stays."""
    gc.disable()


def pytest_collection_finish():
    """Keep the thousands of tests out of each garbage collection to come."""
    gc.freeze()
    gc.enable()


def pytest_addoption(parser):
    text = "write what the proofs measure over the figures in FILE, docs/figures.json, for the pages"
    parser.addoption("--figures", type=Path, metavar="FILE", help=text)


class Figures:
    """What a proof measures: printed, and kept for the pages where a file is named."""

    def __init__(self, path, command):
        self._path = path
        self.source = origin(command, text_of(circumstances())) if path else {}

    def keep(self, name, value, unit, case=None):
        """Keep a figure under a name; of several cases the pages show the largest."""
        print(f"{name}: {value:.4g} {unit}" + (f" ({case})" if case else ""))
        more = {"cases": {case: float(value)}} if case else {}
        self.merge({name: entry(float(value), unit, self.source, **more)})

    def merge(self, entries):
        """Keep entries that are made already."""
        if self._path:
            merge(self._path, entries)


@pytest.fixture
def figures(request):
    """Keep the figures of a proof."""
    file = Path(request.node.path).relative_to(request.config.rootpath)
    which = "-m proof " if request.node.get_closest_marker("proof") else ""
    return Figures(request.config.getoption("--figures"), f"pytest {which}{file.as_posix()}")
