"""The directive `command-help`: what a command says to `-h`, printed while the pages are built."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

PROGRAMS = {"rambler": "firmware_py.__main__", "rambler-hil": "hil.__main__"}
WIDTH = "88"


def help_of(words: list[str]) -> str:
    """Return the help text of a command, given as its program and sub-commands."""
    program, *rest = words
    main = importlib.import_module(PROGRAMS[program]).main
    said = io.StringIO()
    os.environ["COLUMNS"] = WIDTH
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        main([*rest, "-h"])
    text = said.getvalue()
    if not text.startswith("usage:"):
        raise ValueError(f"{' '.join(words)} -h says no usage; is the command still there?")
    return text


class CommandHelp(Directive):
    """A literal block with the help of the command that the arguments name."""

    required_arguments = 1
    final_argument_whitespace = True
    option_spec: ClassVar = {}

    def run(self) -> list[nodes.Node]:
        """Make the block."""
        try:
            text = help_of(self.arguments[0].split())
        except (KeyError, ValueError, ImportError) as error:
            raise self.error(str(error)) from error
        block = nodes.literal_block(text, text)
        block["language"] = "text"
        return [block]


def setup(app: Sphinx) -> ExtensionMetadata:
    """Register the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
