"""Directives that print what a command says, while the pages are built: its help, or Markdown that it makes."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

PROGRAMS = {"rambler": "firmware_py.__main__", "rambler-hil": "hil.__main__"}
WIDTH = "88"


def said_by(words: list[str]) -> str:
    """Return what a command line prints, given as its program and arguments; ValueError when it prints nothing."""
    program, *rest = words
    main = importlib.import_module(PROGRAMS[program]).main
    said = io.StringIO()
    os.environ["COLUMNS"] = WIDTH
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        main(rest)
    if not said.getvalue():
        raise ValueError(f"{' '.join(words)} says nothing; is the command still there?")
    return said.getvalue()


class CommandHelp(Directive):
    """A literal block with the help of the command that the arguments name."""

    required_arguments = 1
    final_argument_whitespace = True
    option_spec: ClassVar = {}

    def run(self) -> list[nodes.Node]:
        """Make the block."""
        try:
            text = said_by([*self.arguments[0].split(), "-h"])
        except (KeyError, ValueError, ImportError) as error:
            raise self.error(str(error)) from error
        block = nodes.literal_block(text, text)
        block["language"] = "text"
        return [block]


class CommandMarkdown(Directive):
    """The Markdown that a command prints, as part of the page."""

    required_arguments = 1
    final_argument_whitespace = True
    option_spec: ClassVar = {}

    def run(self) -> list[nodes.Node]:
        """Read it as if it stood in the page."""
        lines = StringList(said_by(self.arguments[0].split()).splitlines(), self.arguments[0])
        found = nodes.container()
        self.state.nested_parse(lines, self.content_offset, found)
        return found.children


def setup(app: Sphinx) -> ExtensionMetadata:
    """Register the directive."""
    app.add_directive("command-help", CommandHelp)
    app.add_directive("command-markdown", CommandMarkdown)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
