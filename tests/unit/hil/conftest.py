"""Pages without the picture of matplotlib, which takes a second to draw."""

from types import SimpleNamespace

import pytest

from hil.report import run_page


@pytest.fixture
def without_picture(monkeypatch):
    """Make the pages of a computer without matplotlib."""
    nothing = SimpleNamespace(util=SimpleNamespace(find_spec=lambda _name: None))
    monkeypatch.setattr(run_page, "importlib", nothing)
