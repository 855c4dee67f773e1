"""The README's lines run, and its figure is there."""

import re
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"
EXAMPLE = README.parent / "examples" / "diagnosis" / "plot_readme_figure.py"


@pytest.mark.skipif(not README.exists(), reason="the README is not beside the tests (installed package)")
def test_the_readme_runs(tmp_path, monkeypatch, capsys):
    text = README.read_text()
    code = re.search(r"```python\n(.*?)```", text, re.S).group(1)
    assert len([line for line in code.splitlines() if line.strip()]) <= 12
    imread = pytest.importorskip("matplotlib.image").imread
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    assert "VERDICT  explained" in capsys.readouterr().out
    assert (tmp_path / "gap.png").read_bytes().startswith(b"\x89PNG")
    figure = re.search(r"!\[.*?\]\((.*?)\)", text).group(1)
    shown, drawn = (imread(path) for path in (README.parent / figure, tmp_path / "gap.png"))
    assert shown.shape == drawn.shape
    assert abs(shown - drawn).mean() < 0.01  # another version of the fonts moves a few pixels


@pytest.mark.skipif(not README.exists(), reason="the README is not beside the tests (installed package)")
def test_links_of_the_readme_lead_somewhere():
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", README.read_text(encoding="utf-8")):
        assert (README.parent / target).exists(), f"README.md links to {target}"


@pytest.mark.skipif(not EXAMPLE.exists(), reason="the examples are not beside the tests (installed package)")
def test_the_figure_is_made_by_the_lines_of_the_readme():
    code = re.search(r"```python\n(.*?)```", README.read_text(), re.S).group(1)
    script = EXAMPLE.read_text()
    assert [line for line in code.splitlines() if line not in script] == []
