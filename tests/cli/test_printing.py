"""Lines and tables: no figure is cut short, however narrow the terminal or the pipe, and names stay as they are."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from rich.table import Table

from cltaa.commands.printing import figures, print_line, print_table, three_digits
from cltaa.errors import CltaaError
from cltaa.printable import markdown, printable, shell_word, shown


@pytest.mark.parametrize("columns", ["40", "80", "200"])
def test_no_figure_is_cut_short(
    columns: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    table = Table(title="a title")
    figures = [f"{number}.{number:08d}" for number in range(10, 20)]
    for figure in figures:
        table.add_column(f"heading {figure}", no_wrap=True)
    table.add_row(*figures)
    print_table(table)
    said = capsys.readouterr().out
    assert "…" not in said
    assert all(f" {figure} " in said and f"heading {figure}" in said for figure in figures)


def test_columns_that_do_not_fit_follow_behind_the_first(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And every line of a part fits, has the name of its row, and stands there once."""
    table = Table("name", *(f"score {number}" for number in range(12)), title="a title")
    for name in ("one", "two"):
        table.add_row(name, *(f"{name}-{number}" for number in range(12)), style="dim")
    monkeypatch.delenv("COLUMNS", raising=False)
    print_table(table)
    whole = capsys.readouterr().out.splitlines()
    assert len(whole) == 7  # no terminal: a pipe has no width
    monkeypatch.setenv("COLUMNS", "60")
    print_table(table)
    said = capsys.readouterr().out
    lines = said.splitlines()
    assert max(map(len, lines)) <= 60
    rows = {name: [line.split()[3::2] for line in lines if line.startswith(f"│ {name} ")] for name in ("one", "two")}
    assert len(rows["one"]) > 1
    for name, parts in rows.items():
        assert [cell for part in parts for cell in part if cell != "│"] == [f"{name}-{n}" for n in range(12)]
    assert said.count("a title") == 1


def test_a_name_is_printed_to_the_letter(capsys: pytest.CaptureFixture[str]) -> None:
    name = "shots/:fire:/[bold]12[/] of 100.exr"  # what rich would draw, and take for markup
    table = Table("name")
    table.add_row(shown(name))
    print_table(table)
    print_line(f"[bold]{shown(name)}[/]")
    assert capsys.readouterr().out.count(name) == 2


@pytest.mark.parametrize(
    "name", ["-x", "in/-x", "new\nline", "two  spaces", "it's\t", "\\\n1", "\udcff\n", "映画\xa0", "$x {}"]
)
def test_a_message_holds_paths_as_a_shell_reads_them(name: str) -> None:
    said = str(CltaaError("it failed", cure=f"run: {shell_word(Path(name))}"))
    assert printable(said) == said
    read = subprocess.run(["bash", "-c", f"printf %s {said.partition('run: ')[2]}"], capture_output=True, check=True)
    assert read.stdout == os.fsencode(f"./{name}" if name[0] == "-" else name)


def test_thousands_are_in_full() -> None:
    assert [three_digits(value) for value in (0.0, 0.01234, 7.946, 999.4, 1288.7, 2.36e4)] == [
        "0",
        "0.0123",
        "7.95",
        "999",
        "1289",
        "23600",
    ]


def test_a_first_column_of_names_stands_to_the_left_and_figures_to_the_right(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for table, row in ((figures(None, "frame", named=True), "│ 7     │"), (figures(None, "frame"), "│     7 │")):
        table.add_row("7")
        print_table(table)
        assert row in capsys.readouterr().out


def test_figures_stand_to_the_right_where_that_is_asked() -> None:
    assert markdown("ab", ["cd"]) == "| a | b |\n| --- | --- |\n| c | d |\n"
    assert markdown("ab", ["cd"], figures=True) == "| a | b |\n| --- | ---: |\n| c | d |\n"
