"""Lines and tables: no figure is cut short, however narrow the terminal or the pipe, and names stay as they are."""

from __future__ import annotations

import pytest
from rich.table import Table

from cltaa.commands.printing import print_line, print_table
from cltaa.printable import shown


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


def test_a_name_is_printed_to_the_letter(capsys: pytest.CaptureFixture[str]) -> None:
    name = "shots/:fire:/[bold]12[/] of 100.exr"  # what rich would draw, and take for markup
    table = Table("name")
    table.add_row(shown(name))
    print_table(table)
    print_line(f"[bold]{shown(name)}[/]")
    assert capsys.readouterr().out.count(name) == 2
