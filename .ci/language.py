#!/usr/bin/env python3
"""List words that docs/explanation/glossary.md replaces: in names, comments, docstrings, messages and pages.

language.py [PATH ...] checks the tracked files below these paths (default: all) and exits with 1 if it finds any.
language.py --count prints the number of findings of each folder.
"""

import collections
import io
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Denied in every text and as a part of a name.
WORDS = """
she her hers herself nobody somebody whoever anew told tells heed heeds heeded unheeded owes hindrance hindered berth
namesake namesakes helmsman stiffness stiffer stiff soften softened softens softer afloat crew unkind unkindness
unkindnesses reckoned reckons seldom kin ills amiss aught naught hither thence whence
""".split()  # noqa: SIM905 - reads better than a list
# Denied groups of words in texts (regular expressions).
PHRASES = (
    r"(?<!dead )\breckoning\b",
    r"\bcom(?:es|ing) round\b",
    r"\bit may little\b",
    r"\bwhat is (?:told|shown|given|known)\b",
)
# Denied whole names: participles and quantities without a noun.
NAMES = "heard told shown asked said least much enough worth"
# A docstring states what a function computes, not "Return what fills ...".
DOCSTRING = re.compile(r'^[rRbBuUfF]*"""\s*Returns? (?:what|who|how)\b')
# Names of parameters, faults, commands, keys and log fields that scripts rely on.
ALLOWED = re.compile(
    r"\b(?:POS_RECKON_M|told_s)\b|(?<=\")tells(?=\")|\breckoned(?:_\w+\b|(?=:))|dead-reckoned|hindrance(?=[`\"'])|(?<=one\.)hindrance"
)
# Former names of stored fields.
FORMER_NAMES_TABLE = re.compile(r"^FORMER_NAMES.*?^}", re.MULTILINE | re.DOTALL)
EXEMPT_PATHS = (
    "CHANGELOG.md", "LICENSE", "docs/decisions/", "docs/explanation/glossary.md", "docs/reference/changed-texts.md",
    "docs/figures.json", "tests/data/", "tests/replay/data/", "tests/fuzz/corpus/", ".ci/language.py",
    ".ci/constraints.txt",
)  # fmt: skip
SUFFIXES = (".py", ".md", ".toml", ".html", ".js", ".css", ".svg", "")

_WORD = re.compile(rf"(?<![A-Za-z])(?:{'|'.join(WORDS)})(?![a-z])", re.IGNORECASE)
_PHRASE = re.compile("|".join(PHRASES), re.IGNORECASE)
_NAME = re.compile(rf"_*(?:{'|'.join(NAMES.split())})", re.IGNORECASE)
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


def _text_findings(text: str) -> Iterator[tuple[int, str]]:
    """Yield the line, from 0, and the text of each finding."""
    for line, content in enumerate(text.splitlines()):
        checked_text = ALLOWED.sub("", content)
        for match in (*_WORD.finditer(checked_text), *_PHRASE.finditer(checked_text)):
            yield line, match.group()


def _python_findings(text: str) -> Iterator[tuple[int, str]]:
    """Yield the findings of a Python file."""
    text = FORMER_NAMES_TABLE.sub(lambda match: "\n" * match.group().count("\n"), text)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        line = token.start[0] - 1
        if token.type == tokenize.NAME:
            arguments = _CAMEL.sub("_", token.string).split("_")
            is_denied = _NAME.fullmatch(token.string) or any(word.lower() in WORDS for word in arguments)
            if is_denied and not ALLOWED.fullmatch(token.string):
                yield line, token.string
        elif token.type in (tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", -1)):
            if DOCSTRING.match(token.string):
                yield line, " ".join(token.string.split()[:2]).strip('"')
            for offset, word in _text_findings(token.string):
                yield line + offset, word


def findings(path: Path) -> list[tuple[int, str]]:
    """Return the line number and the word of each finding in a file."""
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return []
    hits = _python_findings(text) if path.suffix == ".py" else _text_findings(text)
    return [(line + 1, word) for line, word in hits]


def main(arguments: list[str]) -> int:
    """Print the findings; return 1 if there are any."""
    paths = [word for word in arguments if not word.startswith("-")]
    listing = ["git", "ls-files", *paths]
    names = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=True).stdout  # noqa: S603
    counts: collections.Counter[str] = collections.Counter()
    for name in names.splitlines():
        path = ROOT / name
        if name.startswith(EXEMPT_PATHS) or path.suffix not in SUFFIXES or not path.is_file():
            continue
        hits = findings(path)
        counts["/".join(name.split("/")[:-1]) or name] += len(hits)
        if "--count" not in arguments:
            for line, word in hits:
                print(f"{name}:{line}: {word}")
    total = sum(counts.values())
    if "--count" in arguments:
        for folder, count in sorted(counts.items()):
            if count:
                print(f"{count:6d} {folder}")
    print(f"{total} words of the deny list")
    return 1 if total else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
