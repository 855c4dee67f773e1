"""Tables from rows: shares with their intervals, bars, detection, unknown, experiments, misses; and the figures."""

import math

import numpy as np
import pytest
from scipy.stats import binomtest

from sksurrogate.blind import ARMS, BlindResult
from sksurrogate.blind._limits import mean, median, wilson
from sksurrogate.blind._pictures import missing_terms, overview, recorded_terms
from sksurrogate.blind._probabilities import PROBABILITY_BINS, calibration_error, class_stated, name_stated
from sksurrogate.blind._summaries import detection, experiments, place_up_to_twins, unknown_scores

TRUE = ("coulomb_friction", "speed", "speed")


def as_dict(key, **more):
    return {"name": key[0], "location": key[1], "variable": key[2], "params": {}, **more}


def made(arm, right=True, *, seed=0, gap=10.0, **more):
    """A row; by default the right answer, at the right place."""
    expected = ARMS[arm][1]
    summary = expected in ("explained", "either") and right
    verdict = ("explained" if expected == "either" else expected) if right else "none"
    return {
        "arm": arm, "seed": seed, "plant": "dc_motor", "excitation": "steps", "n_runs": 6, "n_samples": 300, "n_states": 3,
        "gap_over_noise": gap, "expected": expected, "verdict": verdict,
        "truths": [] if expected == "none" else [as_dict(TRUE)],
        "effects": [as_dict(TRUE, equivalents=[], probability=0.9)] if summary else [],
        "named": int(summary), "false_names": 0, "classes": [1] if summary else [], "covered": [True] * 9 + [False] if summary else [],
        "likely_place": "speed" if right and expected != "none" else None, "place": right, "shrink": 0.99 if summary else 0.0,
        "oracle": 0.995, "region_f1": None, "shape": None, "seconds": 2.0, "processor_seconds": 1.0, "calls": 100.0,
        "right": right, **more,
    }  # fmt: skip


@pytest.mark.parametrize(("hits", "count"), [(0, 6), (49, 50), (7, 7), (30, 60)])
def test_wilson_is_scipys(hits, count):
    known = binomtest(hits, count).proportion_ci(0.90, method="wilson")
    assert wilson(hits, count) == pytest.approx((known.low, known.high), abs=2e-4)
    assert math.isnan(wilson(0, 0)[0])


def test_bars_say_whether_they_are_cleared_and_whether_more_cases_would_tell():
    rows = [made("effect", k >= 2, seed=k) for k in range(400)]
    rows += [made("none", k > 0, seed=k) for k in range(5)] + [made("novel", k > 40, seed=k) for k in range(80)]
    found = {line["question"]: line for line in BlindResult(tuple(rows)).bars()}
    one = found["one effect: named, nothing else"]
    assert one["figure"] == 0.995 and one["cases"] == 400 and one["cleared"] == "yes"
    assert found["outside the catalogue: unknown"]["cleared"] == "no"
    assert found["no effect, white noise: false names"]["cleared"] == "yes, open"  # said nothing false, in 5 cases
    assert found["90 % intervals that hold the truth"]["cleared"] == "yes"
    assert found["shrink over that of the true effect refitted"]["figure"] == pytest.approx(0.99 / 0.995)
    assert found["seconds, 2 to 4 states, 6 x 300 samples, the whole catalogue"]["figure"] == 2.0
    assert "two effects: both named, nothing else" not in found  # not asked


def test_promises_are_shares_of_their_arms_with_limits():
    rows = [made("region", k > 0, seed=k) for k in range(10)] + [made("effect", seed=k) for k in range(10)]
    rows += [made("tails", seed=k) for k in range(6)] + [made("none", False, seed=1, false_names=1)]
    found = {line["question"]: line for line in BlindResult(tuple(rows)).promises()}
    one = found["one effect, in all runs, a region or a time: named, nothing else"]
    assert (one["figure"], one["cases"], one["cleared"]) == (0.95, 20, "no, open")
    assert (one["low"], one["high"]) == wilson(19, 20)
    false = found["no effect (white, coloured, disturbed, spikes, tails, unreached): false names"]
    assert false["figure"] == pytest.approx(1 / 7) and false["cleared"] == "no"
    assert not any(question.startswith("two") for question in found)  # not asked
    assert found["right names that close more than 95 % on unseen runs: not called unknown"]["cases"] == 19


def test_a_right_name_that_closes_the_gap_breaks_a_promise_as_unknown():
    rows = [made("effect"), made("effect", seed=1, verdict="unknown")]
    found = {line["question"]: line for line in BlindResult(tuple(rows)).promises()}
    assert found["right names that close more than 95 % on unseen runs: not called unknown"]["figure"] == 0.5


def test_the_class_shares_the_probability_of_a_name():
    other = ("stribeck_friction", "speed", "speed")
    tied = as_dict(other, equivalents=[list(TRUE)], probability=0.97)
    false = as_dict(("linear_loss", "current", "current"), equivalents=[], probability=0.4)
    assert class_stated(made("two", effects=[tied, false])) == [(0.97, True), (0.4, False)]
    assert class_stated(made("effect", verdict="unknown")) == []
    moved = as_dict(("parameter_error", "inertia", None), equivalents=[], probability=1.0)
    assert class_stated(made("far", effects=[moved])) == []
    sensor = as_dict(("sensor_drift", "speed", None), equivalents=[], probability=0.99)
    same = as_dict(("drift", "speed", None), equivalents=[["sensor_drift", "speed", None]], probability=0.98)
    alone = as_dict(("drift", "speed", None), equivalents=[], probability=0.97)
    stated = class_stated(made("trends", verdict="explained", truths=[], effects=[sensor, same, alone]))
    assert stated == [(0.99, True), (0.98, True), (0.97, False)]


def test_the_error_of_calibration_is_the_distance_in_every_bin():
    assert calibration_error([(0.6, True)] * 6 + [(0.6, False)] * 4)[0] == pytest.approx(0.0)
    off = [(0.6, True)] * 10 + [(1.0, True)] * 8 + [(1.0, False)] * 2  # 0.4 and 0.2 off, as many of each
    error, low, high = calibration_error(off)
    assert error == pytest.approx(0.3) and low <= error <= high
    assert np.isnan(calibration_error([])[0])


def test_rows_that_failed_count_as_misses_and_cases_not_drawn_do_not():
    failed = {"arm": "effect", "seed": 1, "error": "TimeoutError: no answer", "right": False}
    undrawn = {"arm": "effect", "seed": 2, "error": "not drawn: ...", "right": None}
    result = BlindResult((made("effect"), failed, undrawn))
    assert result.bars()[0]["figure"] == 0.5 and result.bars()[0]["cases"] == 2
    assert result.misses()[0]["said"].startswith("TimeoutError")


def test_the_place_counts_up_to_twins_of_the_true_effect_only():
    twin = ("parameter_error", "friction", None)
    row = made("effect", likely_place="friction")
    assert not place_up_to_twins(row)
    row["effects"] = [as_dict(twin, equivalents=[list(TRUE)])]
    assert place_up_to_twins(row)
    row["effects"] = [as_dict(twin, equivalents=[])]
    assert not place_up_to_twins(row)


def test_a_probability_belongs_to_the_very_name():
    row = made("effect")
    assert name_stated(row) == [(0.9, True)]
    row["effects"] = [as_dict(("drift", "speed", None), equivalents=[list(TRUE)], probability=0.6)]
    assert name_stated(row) == [(0.6, False)]
    assert name_stated({**row, "verdict": "unknown"}) == []


def test_detection_over_the_gap():
    rows = [made("sizes", gap > 0.5, seed=k, gap=gap) for k, gap in enumerate(np.geomspace(0.1, 10, 60))]
    points = detection([*rows, made("detuned", False), made("none")])
    assert sum(p["cases"] for p in points) == 60
    assert [p["named"] for p in points][:2] == [0.0, 0.0] and points[-1]["named"] == 1.0
    assert all(p["low"] <= p["named"] <= p["high"] for p in points)


def test_unknown_recall_and_precision():
    rows = [made("novel", seed=k) for k in range(3)] + [made("outside", False)]
    rows += [made("effect", False, verdict="unknown"), made("effect")]
    recall, precision, place = (line["figure"] for line in unknown_scores(rows))
    assert (recall, precision, place) == (0.75, 0.75, 0.75)


def test_the_experiment_against_the_same_run_again():
    assert experiments([made("effect")]) == []
    tied = {
        "experiment": "a run with a step in every input", "gain_expected": 20.0, "class_before": 3, "class_after": 1,
        "class_repeated": 3, "truth_before": True, "truth_after": True, "truth_repeated": True, "lead_before": 0.5,
        "lead_after": 18.0, "lead_repeated": 1.0,
    }  # fmt: skip
    none = {**dict.fromkeys(tied), "class_before": 2, "truth_before": True}
    lines = {r["next experiment"]: r for r in experiments([made("weak", **tied), made("weak", **none)])}
    assert lines["cases with tied names"]["suggested"] == 2
    assert lines["an experiment was suggested and done"]["suggested"] == 1
    after = lines["lead of the true effect after, log-likelihood difference (median)"]
    assert (after["suggested"], after["same run again"]) == (18.0, 1.0)
    alone = lines["share with the true effect named alone"]
    assert (alone["suggested"], alone["same run again"]) == (1.0, 0.0)


def test_misses_are_listed_by_kind_with_right_names_at_other_places_last():
    rows = (made("novel", False, seed=5), made("effect", likely_place="current"), made("none"))
    listed = BlindResult(rows).misses()
    assert [line["kind"] for line in listed] == ["none where it should be unknown", "right, but another likely place"]
    assert listed[0]["seed"] == "5" and listed[0]["truth"] == "coulomb_friction at speed in speed"


def test_figures_are_drawn_from_rows(tmp_path):
    pytest.importorskip("matplotlib")
    curve = {
        "location": "speed",
        "variable": "speed",
        "at": [0.0, 1.0, 2.0],
        "true": [-1.0, 0.0, 1.0],
        "value": [-1.1, 0.1, 1.0],
    }
    rows = [made("novel", curve=curve, shape=0.99, seed=k) for k in range(3)] + [made("effect"), made("weak", gap=1.0)]
    result = BlindResult(tuple(rows))
    assert len(overview(result).axes) == 4 and len(missing_terms(rows).axes) == 3
    assert missing_terms([made("effect")]) is None and recorded_terms([]) is None
    drawn = recorded_terms(
        [
            {
                "recording": "balls",
                "curve": {**curve, "documented": "drag", "low": [-1.2, 0, 0.9], "high": [-1, 0.2, 1.1]},
            }
        ]
    )
    assert drawn.axes[0].get_title() == "balls"
    page = result.to_html()
    assert page.count("data:image/png") == 2 and "All missed cases" not in page and "Bars" in page


def test_seconds_are_those_of_diagnoses_that_had_the_machine_alone_where_there_are_any():
    question = "seconds, 2 to 4 states, 6 x 300 samples, the whole catalogue"
    together = [made("effect", seed=k, seconds=5.0, cases_at_once=2) for k in range(5)]
    alone = [made("effect", seed=9 + k, seconds=2.5, cases_at_once=1) for k in range(3)]
    figures = [
        {line["question"]: line for line in BlindResult(tuple(rows)).bars()}[question]
        for rows in (together, together + alone)
    ]
    assert [(line["figure"], line["cases"]) for line in figures] == [(5.0, 5), (2.5, 3)]


def test_seconds_are_told_apart_where_the_catalogue_is_not_whole():
    rows = [made("effect", seed=k, processor_seconds=5.0) for k in range(3)]
    rows += [made("novel", seed=7, seconds=9.0), made("outside", seed=8, seconds=20.0)]
    found = {line["question"]: line for line in BlindResult(tuple(rows)).bars()}
    whole = found["seconds, 2 to 4 states, 6 x 300 samples, the whole catalogue"]
    assert (whole["figure"], whole["cases"]) == (2.0, 4)
    assert found["processor seconds of two cores, the same"]["cleared"].startswith("yes")
    part = found["seconds where the true effect is taken out of the catalogue"]
    assert (part["figure"], part["cases"]) == (20.0, 1) and part["cleared"].startswith("no")


def test_the_interval_of_a_mean_holds_nine_of_ten():
    values = np.random.default_rng(0).normal(1.0, 2.0, size=(4000, 50))
    rows = [mean("", value, 1.0) for value in values]
    low, high = (np.array([row[name] for row in rows]) for name in ("low", "high"))
    assert np.mean((low <= 1.0) & (high >= 1.0)) == pytest.approx(0.9, abs=0.02)


def test_the_interval_of_a_median_holds_nine_of_ten():
    values = np.random.default_rng(1).exponential(size=(4000, 60))
    rows = [median("", value, 1.0) for value in values]
    low, high = (np.array([row[name] for row in rows]) for name in ("low", "high"))
    # whole order statistics, rounded outwards: of 60 values those of ranks 24 and 38, between which the binomial has 0.93
    assert 0.9 <= np.mean((low <= np.log(2.0)) & (high >= np.log(2.0))) <= 0.95


def test_a_false_name_counts_as_one_where_it_is_said_to_explain_the_gap():
    verdicts = ("explained", "explained", "unknown", "none")
    rows = [made("effect", seed=k, verdict=verdict, false_names=k > 0) for k, verdict in enumerate(verdicts)]
    assert BlindResult(tuple(rows)).scores()[0]["false"] == pytest.approx(1 / 4)


def test_the_bins_of_probabilities_part_all_of_them():
    assert (PROBABILITY_BINS[0], PROBABILITY_BINS[-1]) == (0.0, 1.0) and np.all(np.diff(PROBABILITY_BINS) > 0)


def test_every_stated_probability_counts_in_the_one_bin_that_holds_it():
    stated = [0.0, 0.3, 0.5, 0.6, 0.8, 0.9, 0.99, 1.0, 1.0]
    rows = [
        made("effect", seed=k, effects=[as_dict(TRUE, equivalents=[], probability=p)]) for k, p in enumerate(stated)
    ]
    rows[0]["effects"][0]["name"] = "constant_bias"
    found = BlindResult(tuple(rows)).calibration()
    assert [bin["count"] for bin in found] == [2, 2, 2, 3]
    assert sum(bin["count"] * bin["stated"] for bin in found) == pytest.approx(sum(stated))
    assert [bin["right"] for bin in found] == [0.5, 1.0, 1.0, 1.0]
