"""Pages without the plot of matplotlib, which takes a second."""

from types import SimpleNamespace

import pytest

from hil.report import run_page


@pytest.fixture
def without_picture(monkeypatch):
    """Write pages as on a computer without matplotlib."""
    no_package = SimpleNamespace(util=SimpleNamespace(find_spec=lambda _name: None))
    monkeypatch.setattr(run_page, "importlib", no_package)
