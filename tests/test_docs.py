"""Every Python block in the pages runs: prompts as doctests, the rest as a script, in one namespace a page."""

import doctest
import re
import sys
import types
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(DOCS.glob("*.md"))
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
#: Blocks with these words need what a test machine may not have: a cluster's address, a recording (the examples run these).
ELSEWHERE = ("scheduler.example", "= fetch_")


def blocks(page: Path) -> list[tuple[int, str]]:
    """(line, source) of the Python blocks of a page."""
    text = page.read_text(encoding="utf-8")
    found = re.finditer(r"^```python\n(.*?)^```", text, re.S | re.M)
    return [(text[: match.start(1)].count("\n") + 1, match.group(1)) for match in found]


@pytest.mark.skipif(not PAGES, reason="the pages are not beside the tests (installed package)")
@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=lambda page: page.stem)
def test_the_blocks_of_a_page_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = types.ModuleType(f"page_{page.stem}")  # a module, so that what a page defines can be pickled
    monkeypatch.setitem(sys.modules, module.__name__, module)
    names = module.__dict__
    failures: list[str] = []
    for line, source in blocks(page):
        if any(word in source for word in ELSEWHERE):
            continue
        if ">>> " not in source:
            exec(compile("\n" * (line - 1) + source, str(page), "exec"), names)
            continue
        example = doctest.DocTestParser().get_doctest(source, {}, page.name, str(page), line - 1)
        example.globs = names
        doctest.DocTestRunner(optionflags=OPTIONS).run(example, out=failures.append, clear_globs=False)
    assert not failures, "".join(failures)


def test_links_between_pages_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+\.md)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"
