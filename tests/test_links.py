"""Links of the documentation, and what code cites of it, lead somewhere: the file is there, and so is the heading."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

TOP = Path(__file__).parents[1]
DECISIONS = TOP / "docs" / "decisions"
PAGES = [*sorted(TOP.glob("*.md")), *sorted((TOP / "docs").rglob("*.md"))]

SOURCES = [
    path
    for folder in ("cltaa", "kernels", "capture", "datasets_gen", "scripts", "tests")
    for path in sorted((TOP / folder).rglob("*"))
    if path.suffix in (".py", ".cl", ".h", ".toml") or (path.is_file() and folder == "scripts")
]

# A page that a comment or a message cites; of a decision the number is enough.
CITED = re.compile(r"\b(?:docs/)?decisions/\d[\w-]*|\bdocs/[\w-]+(?:/[\w-]+)*(?:\.md)?")
LINK = re.compile(r"\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


@cache
def anchors(page: Path) -> set[str]:
    """What a page's headings are called in links: as GitHub makes them, of headings that differ."""
    headings = re.findall(r"^#+ (.*)$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    plain = [re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading) for heading in headings]
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in plain}


def broken(page: Path) -> list[str]:
    """The links of a page that lead nowhere; those into the network are not followed."""
    wrong = []
    for link in LINK.findall(FENCE.sub("", page.read_text(encoding="utf-8"))):
        place, _, anchor = link.partition("#")
        if "://" in link:
            continue
        target = page.parent / place if place else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            wrong.append(link)
    return wrong


def test_links_lead_somewhere() -> None:
    assert {str(page.relative_to(TOP)): wrong for page in PAGES if (wrong := broken(page))} == {}


def not_there(text: str) -> list[str]:
    """What ``text`` cites of the pages and is not there."""
    cited = {place if place.startswith("docs/") else f"docs/{place}" for place in CITED.findall(text)}
    return [place for place in sorted(cited) if not any(TOP.glob(f"{place}*"))]


def test_code_cites_pages_that_there_are() -> None:
    found = {path: not_there(path.read_text(encoding="utf-8")) for path in SOURCES if path != Path(__file__)}
    assert {str(path.relative_to(TOP)): wrong for path, wrong in found.items() if wrong} == {}


def test_a_cited_page_that_is_not_there_is_found() -> None:
    text = "as docs/design.md and decisions/09 say, not docs/decisions/0041 nor docs/nowhere.md"
    assert not_there(text) == ["docs/decisions/0041", "docs/nowhere.md"]


def test_a_link_that_leads_nowhere_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# A heading, `two`\n\n[a](page.md#a-heading-two) [b](#a-heading) [c](none.md) [d](https://x.org/none)"
    )
    assert broken(page) == ["#a-heading", "none.md"]


def test_every_decision_is_in_the_index() -> None:
    listed = LINK.findall((DECISIONS / "README.md").read_text(encoding="utf-8"))
    pages = sorted(path.name for path in DECISIONS.glob("[0-9]*.md"))
    assert sorted(name for name in listed if "/" not in name) == pages


def test_a_decision_begins_with_its_number() -> None:
    headings = {page: page.read_text(encoding="utf-8").partition("\n")[0] for page in DECISIONS.glob("[0-9]*.md")}
    for page, heading in headings.items():
        assert re.fullmatch(rf"# {int(page.name[:2])}: \S.*", heading), page.name
