"""The drawing: every axis is named, the worst output is shown, lines differ without colour."""

import dataclasses

import numpy as np
import pytest

from sksurrogate.gap import GapDisplay
from sksurrogate.gap.render._report import GapReport
from sksurrogate.gap.results._missing_term import Curve, MissingTerm
from sksurrogate.gap.results._provenance import Provenance
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.results._trace import Trace
from sksurrogate.gap.results._where import Where

plt = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture
def report():
    t = np.linspace(0, 4, 50)
    wave = np.stack([np.sin(t), 5 + np.cos(t)], axis=1)
    outputs = Table(({"output": "a", "share": 0.1}, {"output": "b", "share": 0.9}))
    bands = Table(tuple({"low": f, "high": 2 * f, "gap": 1 / f, "noise": 0.01, "share": 0.3} for f in (0.1, 0.2, 0.4)))
    ranking = Table(
        tuple(
            {"name": f"effect {k}", "location": "x", "variable": None, "evidence": 10.0 - k, "named": k == 0}
            for k in range(12)
        )
    )
    return GapReport(
        verdict="unknown",
        sentence="Something is missing.",
        effects=[],
        ranking=ranking,
        retuned=Table(),
        where=Where("x", "state", outputs, by_frequency=bands),
        shrink=Shrink(1.0, 0.2, 0.1, 0.8, (0.7, 0.9), after_correction=0.15),
        missing_term=MissingTerm("x", "state", (Curve("u", t, t**2, t**2 - 1, t**2 + 1, 0.9),)),
        outputs=("a", "b"),
        traces=(Trace(3, t, wave, 40 * wave, wave),),
    )


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_every_axis_has_its_names(report):
    display = report.plot()
    assert isinstance(display, GapDisplay) and len(display.axes_) == 5
    for ax in display.axes_:
        assert ax.get_xlabel()
    assert all(ax.get_ylabel() for ax in display.axes_[2:])


def test_the_output_with_the_largest_gap_is_drawn(report):
    ax = report.plot().axes_[2]
    assert ax.get_ylabel() == "b"
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), report.traces[0].measured[:, 1])


def test_a_simulator_that_runs_away_does_not_flatten_the_measurement(report):
    ax = report.plot().axes_[2]
    low, high = ax.get_ylim()
    assert high - low < 3 * np.ptp(report.traces[0].measured[:, 1])


@pytest.mark.parametrize(
    "rows, label", [((), "initial states fitted"), (({"parameter": "k", "value": 2.0},), "re-tuned")]
)
def test_without_a_named_effect_the_fitted_curve_says_what_was_fitted(report, rows, label):
    report = dataclasses.replace(report, retuned=Table(rows))
    for kind in ("trace", "residual"):
        assert label in report.plot(kind=kind).ax_.get_legend_handles_labels()[1]


def test_a_simulator_that_is_drawn_from_fitted_initial_states_says_so(report):
    for access, said in (("rhs", True), ("step", True), ("trajectory", False)):
        made = dataclasses.replace(report, provenance=Provenance(access=access))
        assert ("simulator, start fitted" in made.plot(kind="trace").ax_.get_legend_handles_labels()[1]) == said
        assert ("from initial states that are fitted to this run too" in made.to_html()) == said


def test_lines_differ_without_colour(report):
    for ax in report.plot().axes_:
        styles = [(line.get_linestyle(), line.get_linewidth()) for line in ax.lines]
        assert len(set(styles)) == len(styles)


@pytest.mark.parametrize(
    ("kind", "label"), [("state", "d(x)/dt"), ("input", "added to input x"), ("output", "added to output x")]
)
def test_the_missing_term_is_labelled_by_the_kind_of_its_place(report, kind, label):
    term = dataclasses.replace(report.missing_term, kind=kind)
    assert dataclasses.replace(report, missing_term=term).plot().axes_[-1].get_ylabel() == label


def test_a_report_that_knows_little_is_drawn_too(report):
    bare = dataclasses.replace(report, ranking=Table(), traces=(), where=Where(None, None), missing_term=None)
    assert len(bare.plot().axes_) == 1


def test_bars_of_regions_stand_beside_each_other(report):
    rows = Table(
        ({"rule": "v <= 0.3", "share": 0.9, "samples": 0.5}, {"rule": "v > 0.3", "share": 0.1, "samples": 0.5})
    )
    where = Where("v", "state", by_region=rows)
    ax = dataclasses.replace(report, where=where).plot("regions").ax_
    spans = sorted((bar.get_y(), bar.get_y() + bar.get_height()) for bar in ax.patches)
    middles = [bar.get_y() + bar.get_height() / 2 for bar in ax.patches]
    assert np.add(middles[:2], middles[2:]).tolist() == pytest.approx([0.0, 2.0])  # about the ticks
    assert len(spans) == 4 and all(a[1] <= b[0] + 1e-9 for a, b in zip(spans[:-1], spans[1:]))
    assert [bar.get_width() for bar in ax.patches] == [10.0, 90.0, 50.0, 50.0]
