"""The page on effects of one's own runs as it is printed."""

import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np


def test_the_code_on_the_page_runs(monkeypatch):
    page = (Path(__file__).parents[2] / "docs" / "extending.md").read_text()
    section = page.split("## An effect of your own")[1].split("\n## ")[0]
    module = ModuleType("page")  # a place of its own, so that the class on the page pickles
    monkeypatch.setitem(sys.modules, "page", module)
    for block in re.findall(r"```python\n(.*?)```", section, flags=re.S):
        exec(block, module.__dict__)
    assert module.Y.shape == (60, 1) and np.all(np.diff(module.Y[:, 0]) < 0)
