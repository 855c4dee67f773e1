"""The page and the terminal text: escaped, self-contained, readable without colour, pictures with round ticks."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from html import escape
from html.parser import HTMLParser

import numpy as np
import pytest

from sksurrogate.gap import EffectEstimate, GapReport
from sksurrogate.gap.render._page import _unequalled, html_fragment, html_page
from sksurrogate.gap.render._script import SCRIPT
from sksurrogate.gap.render._svg import Line, Panel, bars, figure, limits, ticks
from sksurrogate.gap.render._terminal import terminal_page
from sksurrogate.gap.results._missing_term import Curve, MissingTerm
from sksurrogate.gap.results._next_experiment import NextExperiment
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.results._trace import Trace
from sksurrogate.gap.results._where import Where

EVIL = '<script>alert("x")</script>\x1b[31m&'


@pytest.fixture
def report():
    """A report in which every name is hostile."""
    t = np.linspace(0, 4, 50)
    wave = np.stack([np.sin(t), np.cos(t)], axis=1)
    curve = Curve(EVIL, t, t**2, t**2 - 1, t**2 + 1, 0.9)
    effect = EffectEstimate(EVIL, EVIL, EVIL, 0.9, {EVIL: 1.0}, {EVIL: (0.5, np.inf)}, 0.8, [(EVIL, EVIL, EVIL)], EVIL)
    rows = Table(
        ({"name": EVIL, "location": EVIL, "variable": None, "evidence": 3.0, "named": np.True_, EVIL: np.nan},)
    )
    return GapReport(
        verdict="unknown",
        sentence=EVIL,
        effects=[effect],
        ranking=rows,
        retuned=rows,
        where=Where(EVIL, "state", rows, rows, rows, rows, rows),
        shrink=Shrink(1.0, 0.2, 0.1, 0.8, (0.7, 0.9)),
        missing_term=MissingTerm(EVIL, "state", (curve,), (EVIL,)),
        next_experiment=NextExperiment(EVIL, rows),
        complete=False,
        notes=(EVIL,),
        untestable=(EVIL,),
        outputs=(EVIL, "second"),
        traces=(Trace(EVIL, t, wave, 10 * wave, wave),),
        seconds=1.0,
    )


class Tags(HTMLParser):
    """Tags that a browser would see, and whether each is closed."""

    def __init__(self):
        super().__init__()
        self.seen, self.open = [], []

    def handle_starttag(self, tag, attrs):
        self.seen.append((tag, dict(attrs)))
        if tag not in ("meta", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.seen.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_no_name_becomes_a_tag_and_every_tag_is_closed(report):
    page = html_page(report)
    assert page.count("<script") == 1 and page.count(f"<script>{SCRIPT}</script>") == 1
    tags = Tags()
    tags.feed(page.replace(f"<script>{SCRIPT}</script>", ""))
    assert tags.open == []
    assert "script" not in {tag for tag, _ in tags.seen}


def test_the_form_of_an_effect_of_the_catalogue_is_written(report):
    assert "Form:" not in html_page(report)  # of a name that the catalogue does not hold
    known = replace(report.effects[0], name="state_saturation", location="level", params={"limit": 2.0})
    assert "<p>Form: <code>x &lt;= c</code>, with c = limit, x = level</p>" in html_page(
        replace(report, effects=[known])
    )


def test_nothing_comes_from_outside(report):
    tags = Tags()
    page = html_page(report)
    tags.feed(page)
    for _, attributes in tags.seen:
        assert not {"src", "href", "onload", "onclick"} & set(attributes)
    assert "http" not in page and "url(" not in page and "@import" not in page


def test_every_output_of_the_worst_run_is_drawn_and_the_others_stand_beside_it(report):
    page = html_page(report)
    large = page[page.index('aria-label="Run') :]
    assert large[: large.index("</figure>")].count('data-name="measured"') == 2
    calm = replace(report.traces[0], label="calm", before=report.traces[0].measured)
    page = html_page(replace(report, traces=(calm, report.traces[0])))
    assert page.index(escape(EVIL) + "</strong>: RMSE") < page.index("Run calm</strong>: RMSE")  # the worst first


def test_lines_differ_without_colour(report):
    grey = re.sub(r'class="[a-z]+"', "", html_page(report))
    run = grey[grey.index('aria-label="Run') :]
    styles = re.findall(r'<polyline[^>]*stroke-width="([\d.]+)"( stroke-dasharray="[^"]*")?', run)[:3]
    assert len(set(styles)) == 3


def test_the_fragment_does_not_style_the_notebook_around_it(report):
    style = re.search(r"<style>(.*?)</style>", html_fragment(report), re.S).group(1)
    for selector in re.findall(r"(?:^|[{}])\s*([^{}@]+)\{", style):
        assert all(part.strip().startswith(".skgap") for part in selector.split(","))


def test_the_terminal_gets_no_control_characters(report):
    text = terminal_page(report)
    assert "\x1b" not in text
    assert all(c == "\n" or c.isprintable() for c in text)


def test_ticks_are_round_and_within_the_axis():
    assert ticks(0.0, 3.98) == [0.0, 1.0, 2.0, 3.0]
    assert ticks(-0.013, 0.024, 4) == pytest.approx([-0.01, 0.0, 0.01, 0.02])
    for low, high in ((1e-9, 2e-9), (-5e12, 3e12), (0.1, 0.1000001)):
        found = ticks(low, high)
        assert 2 <= len(found) <= 8
        assert low - 1e-9 * (high - low) <= min(found) <= max(found) <= high + 1e-9 * (high - low)


@pytest.mark.parametrize(
    "y", [np.zeros(5), np.full(5, np.nan), np.array([1, np.nan, np.inf, 2, 3.0]), np.full(5, 1e300)]
)
def test_any_line_gives_a_picture(y):
    picture = figure([Panel([Line("a<b", np.arange(5.0), y)], "y")], "x", "any")
    root = ElementTree.fromstring(picture)
    for line in root.iter("polyline"):
        assert "nan" not in line.get("points") and "inf" not in line.get("points")


def test_a_missing_value_breaks_the_line():
    y = np.array([0, 1, np.nan, 1, 0.0])
    assert figure([Panel([Line("", np.arange(5.0), y)], "y")], "x", "gap").count("<polyline") == 2


def test_bars_are_in_proportion():
    widths = [
        float(w) for w in re.findall(r"width:([\d.]+)%", bars([("a", 2.0), ("b", 1.0), ("c", 0.0), ("d", 9.0)], 2.0))
    ]
    assert widths == [100.0, 50.0, 0.3, 100.0]  # the last is no help, and cut


def test_a_constant_signal_has_an_axis():
    low, high = limits([np.full(3, 7.0)])
    assert low < 7.0 < high


def test_lines_are_named_once_above_the_first_panel_that_has_them():
    x = np.arange(3.0)
    one, other = (Panel([Line(name, x, x), Line("", x, x + 1)], "level") for name in ("measured", "simulated"))
    pictures = [
        figure(panels, "time", "a run") for panels in ([one], [one, one], [one, other], [replace(one, legend=False)])
    ]
    assert [picture.count(">measured<") for picture in pictures] == [1, 1, 1, 0]
    assert [picture.count(">simulated<") for picture in pictures] == [0, 0, 1, 0]


def test_of_several_effects_it_is_said_which_no_other_explains():
    alone, tied = (
        EffectEstimate(name, "A", None, 1.0, {}, {}, 0.5, equivalents, "No other effect of the catalogue explains these data as well.")
        for name, equivalents in (("sensor_nonlinearity", []), ("sensor_gain", [("input_gain", "feed", None)]))
    )  # fmt: skip
    assert _unequalled([alone]) == '<p class="small">No other effect of the catalogue explains these data as well.</p>'
    assert "In place of sensor nonlinearity at A: no other effect of the catalogue" in _unequalled([alone, tied])
    assert _unequalled([tied]) == ""
