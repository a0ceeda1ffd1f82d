"""Tables of figures: none is cut short, however narrow the terminal or the pipe."""

from __future__ import annotations

import pytest
from rich.table import Table

from cltaa.commands.printing import print_table


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
