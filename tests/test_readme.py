"""The README's lines run, and its figure is there."""

import re
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"


@pytest.mark.skipif(not README.exists(), reason="the README is not beside the tests (installed package)")
def test_the_readme_runs(tmp_path, monkeypatch, capsys):
    text = README.read_text()
    code = re.search(r"```python\n(.*?)```", text, re.S).group(1)
    assert len([line for line in code.splitlines() if line.strip()]) <= 12
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    assert "VERDICT  explained" in capsys.readouterr().out
    assert (tmp_path / "gap.html").read_text().startswith("<!doctype html>")
    figure = re.search(r"!\[.*?\]\((.*?)\)", text).group(1)
    assert (README.parent / figure).exists()
