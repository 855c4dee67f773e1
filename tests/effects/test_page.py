"""The page on effects of one's own runs as it is printed."""

import re
from pathlib import Path

import numpy as np


def test_the_code_on_the_page_runs():
    page = (Path(__file__).parents[2] / "docs" / "extending.md").read_text()
    section = page.split("## An effect of your own")[1].split("\n## ")[0]
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", section, flags=re.S):
        exec(block, names)
    assert names["Y"].shape == (60, 1) and np.all(np.diff(names["Y"][:, 0]) < 0)
