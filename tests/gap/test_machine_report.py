"""The report for programs: dicts, strict JSON that keeps its schema, frames, the summary, single panels."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.gap import EffectEstimate, GapDiagnoser, GapDisplay, GapReport
from sksurrogate.gap.results._provenance import Provenance
from sksurrogate.gap.results._remainder import Remainder
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.results._trace import Trace
from sksurrogate.gap.results._where import Where


@pytest.fixture
def report():
    t = np.linspace(0, 4, 40)
    runs = tuple(
        Trace(
            name, t, size * np.sin(t)[:, None], np.zeros((40, 1)), 0.9 * size * np.sin(t)[:, None], np.cos(t)[:, None]
        )
        for name, size in (("calm", 1.0), ("wild", 5.0), ("medium", 2.0))
    )
    effect = EffectEstimate(
        "parameter_error", "length", None, 0.9, {"relative_error": 0.25}, {"relative_error": (0.2, np.inf)}, 0.9996,
        [("input_gain", "u", None)],
    )  # fmt: skip
    retuned = Table(
        ({"parameter": "k", "nominal": 60.0, "value": 99.97, "low": 99.9, "high": 100.1, "moved": np.True_},)
    )
    budget = Table(({"part": "effect", "kind": "effect", "share": 0.9, "low": 0.8, "high": 0.95},))
    by_output = Table(({"output": "y", "before": 1.0, "after": 0.2, "floor": 0.1, "fraction": 0.8},))
    return GapReport(
        verdict="explained",
        sentence="The gap is explained.",
        effects=[effect],
        ranking=Table(({"name": "input_gain", "location": "u", "variable": None, "evidence": np.nan},)),
        retuned=retuned,
        where=Where("length", "parameter"),
        shrink=Shrink(1.0, 0.2, 0.1, 0.8, (0.7, 0.9), by_output),
        outputs=("y",),
        inputs=("u",),
        traces=runs,
        budget=budget,
        remainder=Remainder(share=0.2),
        units={"y": "m", "length": "m", "u": "N", "k": "N/m"},
        nominal={"length": 2.0, "k": 60.0},
        provenance=Provenance(simulator="ODESimulator", n_runs=3, n_rows=120, dt=0.1, seed="0"),
    )


def test_json_is_strict_and_gives_the_values_back(report):
    found = json.loads(report.to_json(), parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert found["schema"] == "sksurrogate.gap-report/1"
    assert found["effects"][0]["intervals"]["relative_error"] == [0.2, "Infinity"]
    assert found["ranking"][0]["evidence"] is None
    assert found["retuned"][0]["moved"] is True
    np.testing.assert_array_equal(found["traces"][1]["measured"], report.traces[1].measured)
    assert found["shrink"]["interval"] == [0.7, 0.9]


def test_the_dict_holds_plain_objects_alone(report):
    def check(value):
        assert value is None or type(value) in (dict, list, str, float, int, bool)
        for one in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
            check(one)

    check(report.to_dict())
    assert "traces" not in report.to_dict(traces=False)


def test_the_json_keeps_its_schema(report):
    jsonschema = pytest.importorskip("jsonschema")
    schema = GapReport.json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    for traces in (True, False):
        jsonschema.validate(json.loads(report.to_json(traces=traces)), schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**json.loads(report.to_json()), "verdict": 3}, schema)


def test_every_entry_of_the_schema_is_described(report):
    summary = {name: one.get("description") for name, one in GapReport.json_schema()["properties"].items()}
    parts = ("where", "shrink", "missing_term", "next_experiment", "schema", "outputs", "states", "inputs", "complete")
    assert [name for name, text in summary.items() if not text and name not in parts] == []


def test_json_is_written_to_a_file(report, tmp_path):
    text = report.to_json(tmp_path / "report.json", traces=False)
    assert json.loads((tmp_path / "report.json").read_text()) == json.loads(text)


def test_the_summary_shows_every_estimate_with_its_interval_and_unit(report):
    text = str(report.summary())
    assert max(map(len, text.splitlines())) <= 90
    for word in (
        "explained",
        "ODESimulator",
        "parameter error at length",
        "relative_error",
        "99.97",
        "N/m",
        "80.0 % [70.0, 90.0]",
    ):
        assert word in text
    rows = report.summary().effects
    assert rows[0]["estimate"] == 0.25 and rows[0]["high"] == np.inf
    assert "<table>" in report.summary()._repr_html_()


def test_a_summary_of_a_report_that_knows_nothing():
    bare = GapReport("none", "", [], Table(), Table(), Where(None, None), Shrink(*[np.nan] * 4, (np.nan, np.nan)))
    assert "none" in str(bare.summary()) and bare.summary().tables == ()


def test_frames_hold_the_tables(report):
    pandas = pytest.importorskip("pandas")
    frame = report.to_frame("traces")
    assert isinstance(frame, pandas.DataFrame) and len(frame) == 120
    assert list(frame.columns) == ["run", "t", "u", "y measured", "y before", "y after"]
    assert report.to_frame()["estimate"].tolist() == [0.25]
    assert report.retuned.to_frame().equals(report.to_frame("retuned"))
    with pytest.raises(ValueError, match="table='effect': expected one of"):
        report.to_frame("effect")


def test_one_panel_is_drawn_where_it_is_wanted(report):
    plt = pytest.importorskip("matplotlib.pyplot")
    figure, ax = plt.subplots()
    display = report.plot("residual", ax=ax)
    assert display.ax_ is ax and display.figure_ is figure
    assert ax.get_ylabel() == "residual of y / m"
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), report.traces[1].measured[:, 0])  # the worst run
    runs = report.plot("runs").ax_
    assert [tick.get_text() for tick in runs.get_xticklabels()] == ["wild", "medium", "calm"]
    with pytest.raises(ValueError, match="kind='trace plot': expected one of"):
        report.plot("trace plot")
    with pytest.raises(ValueError, match="nothing to draw"):
        report.plot("missing_term")
    with pytest.raises(ValueError, match="give kind too"):
        report.plot(ax=ax)
    plt.close("all")


def test_a_display_from_a_fitted_diagnoser(report):
    plt = pytest.importorskip("matplotlib.pyplot")
    diagnoser = GapDiagnoser(None)
    with pytest.raises(ValueError, match="not fitted"):
        GapDisplay.from_estimator(diagnoser)
    diagnoser.report_ = report
    assert GapDisplay.from_estimator(diagnoser, kind="budget").ax_.get_xlabel().endswith("/ %")
    assert len(GapDisplay.from_report(report).axes_) == len(report.plot().axes_)
    plt.close("all")


def test_a_report_without_runs_or_units_is_drawn_and_written(report):
    bare = replace(report, traces=(), units={}, nominal={})
    assert json.loads(bare.to_json())["traces"] == []
    assert "relative_error" in str(bare.summary())


def test_a_table_as_text_has_its_columns_above_its_rows():
    text = str(Table(({"name": "lag", "share": 0.5}, {"name": "a leak", "share": 0.25})))
    assert [line.split("  ")[0].strip() for line in text.splitlines()] == ["name", "lag", "a leak"]
    starts = {line.index(word) for line, word in zip(text.splitlines(), ("share", "0.5", "0.25"))}
    assert starts == {8}  # behind the longest name and two blanks
    assert str(Table()) == "(empty)"
