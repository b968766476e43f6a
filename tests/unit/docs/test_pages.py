"""The generated parts of Markdown pages (docs/pages.py)."""

import importlib.util

import pytest

from support.paths import ROOT

SOURCE = {"when": "2026-01-02", "commit": "abc1234", "machine": "a machine", "command": "a command"}


@pytest.fixture(scope="module")
def pages():
    spec = importlib.util.spec_from_file_location("docs_pages", ROOT / "docs/pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def fill(pages):
    """Return a function that generates the parts of a text from these figures."""

    def run(text, **entries):
        return pages.Pages({name: {**SOURCE, **entry} for name, entry in entries.items()}).fill(text)

    return run


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (0.018, "0.018"), (3.5, "3.5"), (1.0, "1"), (33.74, "33.7"), (561.4, "561"), (-2.3, "-2.3"),
        (49500.0, "49\u202f500"), (1221.0, "1\u202f221"), ("2.7 to 3.7", "2.7 to 3.7"),
    ],
)  # fmt: skip
def test_numbers_have_three_significant_digits(pages, value, text):
    assert pages.format_number(value) == text


def test_figure_is_replaced_with_its_unit(fill):
    text = "It is <!-- figure: a -->old<!-- end -->, or <!-- figure: b --><!-- end -->."
    new = "It is <!-- figure: a -->1.25\u00a0deg<!-- end -->, or <!-- figure: b -->3<!-- end -->."
    assert fill(text, a={"value": 1.25, "unit": "deg"}, b={"value": 3.0, "unit": ""}) == new
    assert fill(new, a={"value": 1.25, "unit": "deg"}, b={"value": 3.0, "unit": ""}) == new


def test_unknown_figure_is_an_error(fill):
    with pytest.raises(KeyError):
        fill("It is <!-- figure: a --><!-- end -->.")


@pytest.mark.parametrize(
    "text", ["<!-- figure: a --><!-- end --> is it.", "Text <!-- figure: a -->", "Text <!-- help: rambler -->"]
)
def test_invalid_generated_part_is_an_error(fill, text):
    with pytest.raises(ValueError, match=r"takes for HTML|has no end"):
        fill(text, a={"value": 1.0, "unit": ""})


def test_bench_table_marks_missed_aims_without_empty_columns(fill):
    entry = {"name": "CPU", "value": 3.5, "unit": "%", "aim": "<= 1.5 %", "met": False}
    table = fill("<!-- table: bench load -->\n<!-- end -->", load_cpu=entry).splitlines()
    assert table[2] == "| figure | measured | aim |"
    assert table[4] == "| CPU | 3.5\u00a0% | ≤ 1.5 %: **missed** |"


def test_table_without_figures_is_an_error(fill):
    with pytest.raises(ValueError, match="no rows"):
        fill("<!-- table: bench load -->\n<!-- end -->")


def test_source_table_counts_figures_of_a_measurement(fill):
    text = fill("<!-- table: sources -->\n<!-- end -->", a={"value": 1.0, "unit": "s"}, b={"value": 2.0, "unit": "s"})
    assert text.splitlines()[4] == "| `a command` | 2026-01-02 | abc1234 | a machine | 2 |"


def test_excerpt_is_indented_in_a_list(fill):
    text = "1. Code:\n\n   <!-- code: docs/extensions/tables.py setup -->\n   old\n   <!-- end -->\n"
    lines = fill(text).splitlines()
    assert lines[4:6] == ["   ```python", "   def setup(app: Sphinx) -> ExtensionMetadata:"]
    assert lines[-3:] == ["   ```", "", "   <!-- end -->"]
    assert fill("\n".join(lines)) == "\n".join(lines)


def test_help_of_a_command_is_inserted(fill):
    text = fill("<!-- help: rambler replay -->\n<!-- end -->")
    assert text.splitlines()[2:4] == ["```text", "usage: rambler replay [-h] [--json] LOG"]


def test_all_generated_parts_can_be_written(pages):
    assert {path.name for path, text in pages.expected_pages() if text} > {
        "REFERENCE.md",
        "README.md",
        "command-line.md",
    }


@pytest.mark.parametrize("name", ["nmea-sentences", "plan-items", "vehicle-file"])
def test_tables_of_the_reference_are_those_of_the_program(fill, name):
    """A limit or a sentence that changes in the program has to change in the reference, too."""
    text = (ROOT / f"docs/reference/{name}.md").read_text()
    assert fill(text).split() == text.split()


def test_check_reports_a_changed_page_and_ignores_line_breaks(pages, monkeypatch, tmp_path):
    page = tmp_path / "a.md"
    monkeypatch.setattr(pages, "ROOT", tmp_path)
    monkeypatch.setattr(pages, "expected_pages", lambda: [(page, "one two\n")])
    for content, arguments, code, result in (
        ("one\ntwo\n", ["--check"], 0, "one\ntwo\n"),
        ("one three\n", ["--check"], 1, "one three\n"),
        ("one three\n", [], 0, "one two\n"),
    ):
        page.write_text(content)
        monkeypatch.setattr("sys.argv", ["pages.py", *arguments])
        assert (pages.main(), page.read_text()) == (code, result)
