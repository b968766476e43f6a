"""Check that the paths, modules, commands, options, parameters and figures in the documentation exist."""

import contextlib
import importlib
import io
import json
import re
import shlex
from functools import cache
from unittest.mock import patch

from firmware_py.common.parameter_table import TABLE
from support.paths import ROOT

DOCS = sorted(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts)
ROOT_PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
PAGES = [*ROOT_PAGES, *DOCS]
ALL_PAGES = [*PAGES, ROOT / "CHANGELOG.md", *sorted((ROOT / "params").glob("*.md"))]
PROGRAMS = {"rambler": "firmware_py.__main__", "rambler-hil": "hil.__main__"}
CODE_PATTERN = re.compile(r"```.*?```|`[^`]+`", re.DOTALL)
FOLDER_PATTERN = r"(?:firmware_py|hil|tests|params|docs|\.ci|\.github)"


def find_code(text):
    """Return the code spans and blocks of a page, without the languages of blocks."""
    return [re.sub(r"^```[^\n]*\n|`", "", span) for span in CODE_PATTERN.findall(text)]


def errors_by_page(find_errors, pages=PAGES):
    """Return the errors of each page that has errors."""
    errors = {path.relative_to(ROOT).as_posix(): find_errors(path.read_text()) for path in pages}
    return {name: page_errors for name, page_errors in errors.items() if page_errors}


def test_named_paths_exist():
    def find_missing(text):
        # Paths with the placeholder NAME are not checked, nor _build, which exists only after `make docs`.
        names = re.findall(rf"(?<![\w./-]){FOLDER_PATTERN}/[\w./-]*", text)
        paths = {name.rstrip(".") for name in names if "NAME" not in name and "_build" not in name}
        return [path for path in sorted(paths) if not (ROOT / path).exists()]

    assert errors_by_page(find_missing) == {}


@cache
def is_known_name(name):
    """Return whether a dotted name is a module, or an attribute of a module at any depth."""
    with contextlib.suppress(ModuleNotFoundError):
        importlib.import_module(name)
        return True
    owner, _, attribute = name.rpartition(".")
    return bool(owner) and is_known_name(owner) and hasattr(resolve_name(owner), attribute)


def resolve_name(name):
    """Return the module or attribute of a dotted name."""
    with contextlib.suppress(ModuleNotFoundError):
        return importlib.import_module(name)
    owner, _, attribute = name.rpartition(".")
    return getattr(resolve_name(owner), attribute)


def test_named_modules_exist():
    def find_missing(text):
        names = re.findall(r"(?<![\w./-])(?:firmware_py|hil)(?:\.[a-z_]\w*)+", text)
        return [name for name in names if not name.endswith(".py") and not is_known_name(name)]

    assert errors_by_page(find_missing) == {}


def test_functions_of_the_data_paths_exist():
    text = (ROOT / "docs/explanation/architecture.md").read_text()
    rows = re.findall(r"^\| \d+ \| `([\w.]+)` `([\w.]+)` \|", text, re.MULTILINE)
    names = [f"{module}.{function}" for module, function in rows]
    assert len(names) > 60
    assert [name for name in names if not is_known_name(f"firmware_py.{name}")] == []
    assert not is_known_name("firmware_py.core.step.no_such_function")


@cache
def help_text(program, *words):
    """Return the output of a command with the option -h."""
    main = importlib.import_module(PROGRAMS[program]).main
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output), contextlib.suppress(SystemExit):
        main([*words, "-h"])
    return output.getvalue()


def find_commands(text):
    """Yield program and words of each command line in the code of a page; not the user name in `sudo -u rambler`."""
    for span in find_code(text):
        for program, argument_text in re.findall(
            r"(?<![\w/.:-])(?<!-u )(rambler(?:-hil)?)((?: [^\n#]*)?)", span.replace("\\\n", " ")
        ):
            yield program, argument_text.split()


def describe_unknown_names(program, words):
    """Return the command with its unknown names, as a text; empty if all names are known."""
    commands = importlib.import_module(PROGRAMS[program]).COMMANDS
    if not words or words == ["--version"]:
        return ""
    if words[0] not in commands:
        return f"{program} {words[0]}"
    has_subcommand = words[0] in ("key", "plan", "service", "state") and len(words) > 1 and not words[1].startswith("-")
    depth = 2 if has_subcommand else 1
    text = help_text(program, *words[:depth])
    if not text.startswith("usage:"):
        return f"{program} {' '.join(words[:depth])}"
    options = [re.match(r"--[\w-]+", word.strip("[]'\"")) for word in words]
    unknown = [option[0] for option in options if option and not re.search(rf"{option[0]}\b(?!-)", text)]
    return f"{program} {words[0]} {' '.join(unknown)}" if unknown else ""


def test_named_commands_and_options_exist():
    def find_unknown(text):
        text = re.sub(r"<!-- help: .*?<!-- end -->", "", text, flags=re.DOTALL)
        return {describe_unknown_names(program, words) for program, words in find_commands(text)} - {""}

    assert errors_by_page(find_unknown) == {}


@cache
def parser_error(program, *words):
    """Return the error message of the parser; empty if it accepts the command line or only misses arguments."""
    commands = importlib.import_module(PROGRAMS[program]).COMMANDS
    errors = io.StringIO()
    module = importlib.import_module(commands[words[0]][0])
    with patch.object(module, "run", lambda _: 0), contextlib.redirect_stderr(errors):
        importlib.import_module(PROGRAMS[program]).main(words)
    return "" if "required" in errors.getvalue() else errors.getvalue()


def test_named_command_lines_are_accepted():
    def find_rejected(text):
        text = re.sub(r"<!-- (?:help|output|code): .*?<!-- end -->", "", text, flags=re.DOTALL)
        for span in find_code(text):
            # Lines with NAME, KIND, a|b or [...] are syntax, not commands.
            for program, argument_text in re.findall(
                r"^(?:sudo )?(rambler(?:-hil)?) ([a-z][^#|\[\n]*)$", span.replace("\\\n", " "), re.MULTILINE
            ):
                words = shlex.split(argument_text)
                if (
                    " -" in argument_text
                    and not {"NAME", "KIND"} & set(words)
                    and (error := parser_error(program, *words))
                ):
                    yield f"{program} {argument_text}: {error}"

    assert errors_by_page(lambda text: list(find_rejected(text))) == {}
    assert "expected" in parser_error("rambler-hil", "run", "tank", "--seconds")


def test_command_check_detects_errors():
    assert describe_unknown_names("rambler", ["run", "boat.toml", "--state", "DIR"]) == ""
    assert describe_unknown_names("rambler", ["sail"]) == "rambler sail"
    assert describe_unknown_names("rambler-hil", ["run", "tank", "--sped", "max"]) == "rambler-hil run --sped"
    assert describe_unknown_names("rambler", ["plan", "eat"]) == "rambler plan eat"


def test_command_line_page_has_every_command():
    text = (ROOT / "docs/reference/command-line.md").read_text()
    for program, module in PROGRAMS.items():
        for command in importlib.import_module(module).COMMANDS:
            assert f"<!-- help: {program} {command} -->" in text


def test_named_parameters_exist():
    names = {row.name for row in TABLE}
    prefixes = "|".join(sorted({name.split("_")[0] for name in names}))
    assert errors_by_page(lambda text: set(re.findall(rf"`((?:{prefixes})_[A-Z0-9_]+)`", text)) - names) == {}


def test_linked_files_exist():
    for page in ALL_PAGES:
        links = re.findall(r"\]\((?!https?:)([^)#\s]+)", CODE_PATTERN.sub("", page.read_text()))
        assert [link for link in links if not (page.parent / link).exists()] == [], page


def test_no_page_shows_a_placeholder_or_a_directive():
    names = re.compile(r"\{\{.*|^ *```\{.*|^ *:::.*|\{[a-z:-]+\}`.*", re.MULTILINE)
    assert errors_by_page(names.findall, ALL_PAGES) == {}


def test_every_figure_has_a_source():
    for name, entry in json.loads((ROOT / "docs/figures.json").read_text()).items():
        assert re.fullmatch(r"[a-z0-9_]+", name)
        assert {"value", "unit", "when", "commit", "machine", "command"} <= set(entry), name
