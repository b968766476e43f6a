"""The generated pages of params/ are those of this version."""

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import link_page, parameter_page, text_page
from firmware_py.faults import page as fault_page
from support.paths import ROOT


@pytest.mark.parametrize(
    ("page", "option", "name"),
    [
        (link_page, "--messages", "MESSAGES"),
        (parameter_page, "--markdown", "REFERENCE"),
        (fault_page, "--faults", "FAULTS"),
        (text_page, "--texts", "TEXTS"),
    ],
    ids=["messages", "parameters", "faults", "texts"],
)
def test_generated_pages_are_up_to_date(page, option, name, capsys):
    text = (ROOT / f"params/{name}.md").read_text()
    assert page.markdown() == text, "write them with make pages"
    assert main(["params", option]) == 0
    assert capsys.readouterr().out == text
