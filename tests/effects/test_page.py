"""The page on effects of one's own runs as it is printed."""

import re
import runpy
import sys
from pathlib import Path
from types import ModuleType

import numpy as np

from sksurrogate.effects import CATALOGUE


def test_the_code_on_the_page_runs(monkeypatch):
    page = (Path(__file__).parents[2] / "docs" / "extending.md").read_text()
    section = page.split("## An effect of your own")[1].split("\n## ")[0]
    module = ModuleType("page")  # a place of its own, so that the class on the page pickles
    monkeypatch.setitem(sys.modules, "page", module)
    for block in re.findall(r"```python\n(.*?)```", section, flags=re.S):
        exec(block, module.__dict__)
    assert module.Y.shape == (60, 1) and np.all(np.diff(module.Y[:, 0]) < 0)


def test_the_page_of_the_catalogue_is_up_to_date():
    """Run docs/_scripts/effects_page.py when this fails."""
    docs = Path(__file__).parents[2] / "docs"
    written = runpy.run_path(str(docs / "_scripts" / "effects_page.py"))["page"]()
    assert (docs / "effects.md").read_text() == written
    assert all(f"| `{name}` |" in written for name in CATALOGUE)


def test_the_table_of_exports_is_up_to_date():
    """Run docs/_scripts/export_table.py when this fails."""
    docs = Path(__file__).parents[2] / "docs"
    written = runpy.run_path(str(docs / "_scripts" / "export_table.py"))["page"]()
    assert (docs / "from_report_to_controller.md").read_text() == written
    assert all(f"`{name}`" in written for name in CATALOGUE)
