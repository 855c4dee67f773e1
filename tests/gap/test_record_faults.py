"""Faults of the record beside faults of the simulator."""

import json
import pickle
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.faults._corrections import SMOOTHINGS, Gains, Hum, Names, NoisyInput, Offsets, Shifts, SlowNoise
from sksurrogate.gap.faults._fault_left import Alternative, Found, is_harmonic
from sksurrogate.gap.faults._proposals import tone
from sksurrogate.gap.faults._record_book import RecordBook
from sksurrogate.gap.faults._wrong_readings import (
    _in_rows,
    _is_expected,
    outlying,
    outlying_beside,
    outlying_rows,
    wrong_readings,
)
from sksurrogate.kernels.readings import Stretch
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from record_cases import make_case

SOME = ["coulomb_friction", "linear_loss", "sensor_bias", "sensor_gain", "input_gain", "sensor_delay"]


def diagnosed(case, *further, **other):
    return GapDiagnoser(case.simulator, effects=[*SOME, *further], n_jobs=1, random_state=0, **other).fit(
        case.U, case.Y, case.groups
    )


@pytest.fixture(scope="module")
def spiky():
    return diagnosed(make_case("cart", "spikes", True)).report_


@pytest.mark.slow
def test_a_clean_record_has_no_faults():
    report = diagnosed(make_case("cart", "nothing", True)).report_
    assert len(report.data) == 0 and not report.data and report.data.sentence == ""
    assert [effect.name for effect in report.effects] == ["coulomb_friction"]


def test_spikes_and_friction_are_both_found(spiky):
    assert spiky.data.kinds == ("spikes",)
    assert [effect.name for effect in spiky.effects] == ["coulomb_friction"]
    assert spiky.verdict == "explained"


def test_spikes_alone_leave_no_gap():
    case = make_case("cart", "spikes", False)
    report = diagnosed(case).report_
    fault = report.data[0]
    clean = make_case("cart", "nothing", False)
    assert report.verdict == "none" and report.effects == []
    assert fault.kind == "spikes" and fault.location == "position" and fault.side == "output"
    assert fault.share > 0.5
    assert len(fault.rows) >= 10
    spread = np.std(clean.Y[:, 0])
    jumps = np.abs(np.diff(case.Y[:, 0], prepend=case.Y[0, 0]))
    assert np.all(np.maximum(jumps[list(fault.rows)], np.roll(jumps, -1)[list(fault.rows)]) > 0.04 * spread)


@pytest.mark.slow
def test_rows_are_those_of_the_user():
    case = make_case("cart", "spikes", False)
    keep = np.r_[np.full(7, -1), np.asarray(case.groups)]
    U, Y = np.vstack([np.zeros((7, 1)), case.U]), np.vstack([np.zeros((7, 1)), case.Y])
    rows = diagnosed(case).report_.data[0].rows
    shifted = GapDiagnoser(case.simulator, effects=SOME, n_jobs=1, random_state=0).fit(U, Y, keep).report_.data[0].rows
    assert shifted == tuple(row + 7 for row in rows)


def test_the_pages_tell_the_record(spiky):
    assert "spikes" in spiky.sentence
    assert "The record" in str(spiky) and "OutlierFilter" in str(spiky)
    assert "<h2>The record</h2>" in spiky.to_html()
    entry = json.loads(spiky.to_json())["data"]["entries"][0]
    assert entry["kind"] == "spikes" and entry["rows"] == list(spiky.data[0].rows)
    assert pickle.loads(pickle.dumps(spiky)).data == spiky.data
    assert spiky.data.table()[0]["readings"] == len(spiky.data[0].rows)
    assert spiky.to_frame("data")["kind"].tolist() == ["spikes"]


# ---- faults of runs --------------------------------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["offset", "gain", "shift", "hum"])
def test_a_fault_of_runs_is_no_effect(kind):
    report = diagnosed(make_case("cart", kind, False)).report_
    assert kind in report.data.kinds
    assert report.verdict == "none" and report.effects == []
    fault = next(one for one in report.data if one.kind == kind)
    if kind in ("offset", "gain"):
        truth = {"offset": [-0.3, 0.25, 0.1, -0.15, 0.35], "gain": [-0.12, 0.1, 0.05, -0.07, 0.15]}[kind]
        found = np.array(sorted(fault.values.values()))
        unit = np.ptp(found) / np.ptp(truth) if kind == "offset" else 1.0  # offsets are in deviations of the output
        assert found / unit == pytest.approx(sorted(truth), abs=0.02)
        assert fault.effect == {"offset": "sensor_bias", "gain": "sensor_gain"}[kind]
        assert fault.share > 0.9
    if kind == "shift":
        assert fault.runs == (1,) and fault.values[1] in range(3, 7) and fault.location is None


@pytest.mark.slow
def test_a_scale_of_two_runs_is_listed_with_these_alone():
    case = make_case("cart", "nothing", False)
    some = np.isin(case.groups, (1, 3))
    report = diagnosed(replace(case, Y=np.where(some[:, None], 1.15 * case.Y, case.Y))).report_
    assert report.verdict == "none" and report.data.kinds == ("gain",)
    assert report.data[0].values == pytest.approx({1: 0.15, 3: 0.15}, abs=0.01)
    assert "gain error of 15" in report.sentence and "in runs 1, 3" in report.sentence


@pytest.mark.slow
def test_offsets_and_friction_are_both_found():
    report = diagnosed(make_case("cart", "offset", True)).report_
    assert report.data.kinds == ("offset",)
    names = [effect.name for effect in report.effects]
    assert names[0] == "coulomb_friction"
    assert set(names[1:]) <= {"sensor_bias"}  # what all runs have in common is the sensor's own zero


def record(n_runs=3, n=100, dt=0.1):
    rng = np.random.default_rng(0)
    return Record(
        rng.normal(size=(1, n_runs * n)),
        rng.normal(size=(2, n_runs * n)).cumsum(axis=1),
        np.tile(dt * np.arange(n), n_runs),
        np.arange(0, n_runs * n, n),
        dt,
    )


def test_corrections_undo_what_was_done_to_a_record():
    clean, run = record(), record().run_of_row
    b, g = np.array([0.5, 0.0, -1.0]), np.array([0.1, -0.2, 0.0])
    y = clean.y.copy()
    y[1] += b[run]
    np.testing.assert_allclose(Offsets(1, b).corrected(replace(clean, y=y)).y, clean.y, atol=1e-12)
    y = clean.y.copy()
    y[0] *= 1 + g[run]
    np.testing.assert_allclose(Gains(0, g).corrected(replace(clean, y=y)).y, clean.y, atol=1e-12)
    weights, y = np.array([[1.0, 0.5], [0.0, 2.0], [-1.0, 0.0]]), clean.y.copy()
    y[0] += weights[run, 0] * np.sin(3.0 * clean.t) + weights[run, 1] * np.cos(3.0 * clean.t)
    np.testing.assert_allclose(Hum(0, weights, 3.0).corrected(replace(clean, y=y)).y, clean.y, atol=1e-12)


def test_a_shift_is_undone_and_what_is_missing_is_not_measured():
    clean, y = record(), record().y.copy()
    y[:, 103:200] = clean.y[:, 100:197]  # the second run comes three samples late
    back = Shifts(None, np.array([0, 3, 0])).corrected(replace(clean, y=y))
    assert back.known is not None
    np.testing.assert_allclose(back.y[back.known], clean.y[back.known])
    assert np.flatnonzero(~back.known[0]).tolist() == [197, 198, 199]


def test_two_looks_at_one_fault_add_up():
    clean = record()
    a, b = Gains(0, np.array([0.1, 0.0, 0.2])), Gains(0, np.array([-0.05, 0.3, 0.0]))
    np.testing.assert_allclose(b.corrected(a.corrected(clean)).y, a.and_also(b).corrected(clean).y, rtol=1e-12)


@pytest.mark.parametrize("w", [1.3, 7.77, 25.0])
def test_a_tone_is_found_at_its_frequency(w):
    clean, rng = record(4, 150), np.random.default_rng(1)
    phase = rng.uniform(0, 6, 4)[clean.run_of_row]
    residual = np.sin(w * clean.t + phase) + 0.5 * rng.normal(size=clean.n_samples)
    # Cramer and Rao: the deviation of the frequency is sqrt(24 / (runs n^3)) / (amplitude over noise) / dt.
    assert tone(clean, residual) == pytest.approx(w, abs=5 * np.sqrt(24 / (4 * 150**3)) * 0.5 / 0.1)


def test_smoothed_inputs_keep_their_edges():
    u = np.repeat([0.0, 1.0, -2.0], 60)
    noisy = u + 0.05 * np.random.default_rng(2).normal(size=180)
    best = min(np.std(way(noisy) - u) for way in SMOOTHINGS)
    assert best < 0.05 / np.sqrt(60) * 1.5  # the mean of every level


def test_outliers_of_a_residual_are_not_its_waves():
    rng, k = np.random.default_rng(3), np.arange(600)
    wave = 5.0 * np.sin(0.05 * k) + rng.normal(size=600)
    assert outlying_rows(wave, np.array([0])).size == 0
    r = rng.normal(size=600)
    r[[100, 101, 333]] += 20.0
    assert outlying_rows(r, np.array([0])).tolist() == [100, 101, 333]
    r[400:460] += 20.0  # long: the plant's, not a reading's
    assert outlying_rows(r, np.array([0])).tolist() == [100, 101, 333]
    rounded = r / 1e4  # most readings are rounded, and the noise of the others is larger than what these leave
    assert outlying_rows(rounded, np.array([0])).tolist() == [100, 101, 333]
    assert outlying_rows(rounded, np.array([0]), noise=1e-3).size == 0


@pytest.mark.parametrize(("share", "left", "found"), [(0.7, 1.5, True), (0.3, 1.5, False), (0.7, 1.1, False)])
def test_outliers_that_names_only_bend_are_found_beside_the_simulator_alone(share, left, found):
    def model(residual):
        return SimpleNamespace(residual=residual, effects=(), problem=SimpleNamespace(record=clean, sd=np.ones(1)))

    clean, rng = SimpleNamespace(starts=np.array([0])), np.random.default_rng(5)
    null, wave = rng.normal(size=(1, 400)), np.exp(-0.5 * ((np.arange(400) - 200.5) / 6.0) ** 2)
    null[0, [200, 201]] -= 100.0
    bent = share * null + 10.0 * wave  # a name with a memory follows them, and the readings around are off instead
    final = SimpleNamespace(candidate=model(bent), left=left, effects=("hidden_mode",))
    odd = outlying_beside(final, model(null))
    assert (odd is not None) is found and (odd is None or odd.rows.tolist() == [200, 201])


@pytest.mark.parametrize(("moved", "faulty"), [(0.0, True), (12.0, False)])
def test_peaks_that_another_output_shows_too_are_no_wrong_readings(moved, faulty):
    """A coil that saturates: its current peaks for a sample or two, and the voltage of the capacitor moves with it."""
    rng, rows = np.random.default_rng(0), [90, 91, 200, 333]
    residual = rng.normal(size=(2, 500))
    residual[0, rows] += 60.0
    residual[1, rows] += moved
    problem = SimpleNamespace(record=SimpleNamespace(starts=np.array([0, 250])), sd=np.ones(2))
    odd = outlying(SimpleNamespace(problem=problem, residual=residual, effects=()))
    assert (odd is not None and odd.rows.tolist() == rows) == faulty


@pytest.mark.parametrize(("onset", "found"), [(8.9, None), (30.0, [90, 91])])
def test_what_is_off_where_an_effect_begins_is_no_wrong_reading(onset, found):
    """The time of a step is fitted; beside a step elsewhere two readings are off by themselves."""
    residual = np.random.default_rng(0).normal(size=(1, 500))
    residual[0, [90, 91]] += 60.0
    rows = SimpleNamespace(starts=np.array([0]), t=0.1 * np.arange(500), dt=0.1)
    step = CATALOGUE["step_disturbance"]("v")
    model = SimpleNamespace(
        problem=SimpleNamespace(record=rows, sd=np.ones(1)),
        residual=residual,
        effects=(step,),
        theta_of=lambda i: (1.0, onset),
    )
    odd = outlying(model)
    assert (None if odd is None else odd.rows.tolist()) == found


def test_readings_out_of_reach_are_found_wherever_they_are_and_hide_no_other():
    """One of 1e9 at the end of a run, and a spike that is small beside it."""
    whole = record(3, 300)
    y = whole.y.copy()
    y[0, 299], y[0, 450] = 1e9, y[0, 450] + 50.0
    (found,) = wrong_readings(replace(whole, y=y), lambda: None)
    assert (found.kind, found.rows.tolist()) == ("spikes", [299, 450])


@pytest.mark.parametrize(("ratio", "harmonic"), [(1.0, True), (2.0, True), (3.0, True), (2.5, False), (0.5, False)])
def test_a_tone_at_a_multiple_of_a_named_disturbance_is_its_shape(ratio, harmonic):
    """The record of 100 time units tells frequencies apart that differ by 0.063."""
    named = SimpleNamespace(
        problem=SimpleNamespace(record=SimpleNamespace(dt=0.1, lengths=np.array([1000]))),
        effects=(CATALOGUE["periodic_disturbance"]("v"),), theta_of=lambda i: (0.3, 1.3, 0.0),
    )  # fmt: skip
    tone = Hum(output=0, values=np.ones((1, 2)), angular_frequency=1.3 * ratio + 0.01)
    assert is_harmonic(tone, named) is harmonic


@pytest.mark.slow
def test_dropouts_that_follow_each_other_closely_are_found_beside_a_name():
    report = diagnosed(make_case("tanks", "dropouts", False), "hidden_mode").report_
    rows = {row for fault in report.data for row in fault.rows}
    assert report.verdict == "none" and report.effects == [] and rows >= {292, 293, 295, 296}


def test_a_sensor_that_stands_still_is_not_excused_by_a_small_move_of_the_simulator():
    # It leaves its value at a moment at which the simulator moves too, but the simulator moved on in between.
    rng, rows = np.random.default_rng(0), np.arange(240)
    model = np.sin(0.08 * rows)[None]
    y = model + 0.007 * rng.normal(size=(1, 240))
    y[0, 62:107] = y[0, 62]
    still = Record(np.zeros((1, 240)), y, 0.05 * rows, np.array([0]), 0.05)
    assert [(f.kind, f.rows[0], f.rows[-1]) for f in wrong_readings(still, lambda: model)] == [("stuck", 62, 106)]
    # A simulator that stands still and jumps itself: so may the plant.
    held = np.where((rows < 62) | (rows > 106), model, model[0, 62])
    assert wrong_readings(still, lambda: held) == []


@pytest.mark.slow
def test_a_late_run_of_a_slow_plant_is_late_by_the_right_samples():
    # Initial states that are fitted to late outputs bend the first readings of a slow plant.
    report = diagnosed(make_case("oven", "shift", False)).report_
    assert report.verdict == "none" and report.effects == []
    assert dict(report.data[0].values) == {1: 5.0}


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "effect"), [("cart", True), ("oven", False)])
def test_inputs_written_one_row_late_are_no_effect(plant, effect):
    # Actuators cannot be early: a hidden mode with far parameters came to the noise instead.
    case = make_case(plant, "late_inputs", effect)
    rivals = (
        "coulomb_friction",
        "linear_loss",
        "hidden_mode",
        "hidden_relaxation",
        "hysteresis",
        "input_lag",
        "input_delay",
        "sensor_delay",
    )
    diagnoser = GapDiagnoser(case.simulator, effects=rivals, free_params="all", n_jobs=1, random_state=0)
    report = diagnoser.fit(case.U, case.Y, case.groups).report_
    assert report.data.kinds == ("shift",) and set(report.data[0].values.values()) == {-1.0}
    assert "X[1:] with y[:-1]" in report.data[0].remedy
    assert [effect.name for effect in report.effects] == (["coulomb_friction"] if effect else [])
    assert report.verdict == ("explained" if effect else "none")


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "effect"), [("cart", True), ("oven", False)])
def test_inputs_that_move_between_the_rows_are_no_effect(plant, effect):
    # Held over the rows they come half a sample late: three effects that do the same were named, or a relaxation with a lead.
    case = make_case(plant, "hold", effect, 1)
    early = "hidden_relaxation", "hidden_mode", "hysteresis", "input_lag", "input_delay"
    diagnoser = diagnosed(case, *early)
    report = diagnoser.report_
    assert report.data.kinds == ("hold",) and np.isnan(report.data[0].size)
    assert (
        str(report.data[0]).startswith("all inputs: they move between the rows")
        and 'hold="foh"' in report.data[0].remedy
    )
    assert [effect.name for effect in report.effects] == (["coulomb_friction"] if effect else [])
    assert report.verdict == ("explained" if effect else "none")
    assert diagnoser.augmented_.hold == "foh" and case.simulator.hold == "zoh"
    case = replace(case, simulator=diagnoser.augmented_)
    again = diagnosed(case, *early).report_
    assert (again.verdict, again.effects, again.data.kinds) == ("none", [], ())


@pytest.mark.slow
def test_inputs_that_are_held_stay_held():
    report = diagnosed(make_case("motor", "nothing", True)).report_
    assert report.data.kinds == ()


@pytest.mark.parametrize(
    ("values", "said", "way_out"),
    [([-2.0, -2.0], "come 2 samples before", "X[2:] with y[:-2]"), ([0.0, 3.0], "come 3 samples after", "one clock"),
     ([-1.0, 2.0], "come up to 2 samples apart from", "one clock"), ([-1.0, 0.0], "come 1 sample before", "one clock")],
)  # fmt: skip
def test_a_shift_says_its_direction_and_what_to_do(values, said, way_out):
    record = Record(np.zeros((1, 20)), np.zeros((1, 20)), np.arange(20.0), np.array([0, 10]), 1.0)
    names = Names(("u",), ("y",), ["a", "b"], np.array([0, 10]))
    fault = Shifts(None, np.array(values)).described(record, names, 0.5)
    assert said in fault.what and way_out in fault.remedy


@pytest.mark.slow
def test_a_late_run_beside_a_loss_is_no_law():
    # Far from the data the likelihood of a law is that of no model that was simulated; the late run comes to the noise.
    report = diagnosed(make_case("oven", "shift", True), "quadratic_loss", "power_law").report_
    assert report.data.kinds == ("shift",) and report.verdict == "explained"
    assert {effect.name for effect in report.effects} <= {"quadratic_loss", "power_law"} and len(report.effects) == 1


@pytest.mark.parametrize(
    ("left", "score", "law", "right"),
    [(1.0, 10.0, Alternative(20.0, 6.0), True), (1.0, 10.0, Alternative(20.0, 1.0), False), (6.0, 10.0, Alternative(20.0, 8.0), False),
     (6.0, 20.0, Alternative(10.0, 1.0), True)],
)  # fmt: skip
def test_a_fault_that_alone_comes_to_the_noise_beats_a_likelier_law(left, score, law, right):
    assert Found(Shifts(None, np.ones(1)), None, score, 100.0, 0.9, left).beats(law) is right


@pytest.mark.parametrize(("score", "kept"), [(11.0, True), (9.0, False)])
def test_noise_on_an_input_stays_only_where_the_names_are_likelier_with_it(score, kept):
    first = RecordBook(raw=None, names=None)
    second = first.with_fault(NoisyInput(0, 1, slow=SlowNoise(0.01, 0.001, np.zeros(1))), np.inf, score=10.0)
    search = SimpleNamespace(standing=SimpleNamespace(left=1.0, candidate=None), score=lambda _: score)
    after = replace(second, closed=True).with_next_fault(search, np.arange(3), None)
    assert bool(after.faults) == kept and after.closed


@pytest.mark.slow
def test_names_do_not_stand_in_for_noise_on_an_input():
    # Grids of the input follow single readings of it: what the noise makes up is judged beside the model without them.
    report = diagnosed(make_case("tanks", "input_noise", False), "input_quantization").report_
    assert report.verdict == "none" and report.effects == [] and report.data.kinds == ("input_noise",)
    assert report.data[0].share > 0.5 and not report.data[0].taken_out


def test_noise_of_an_input_is_the_gap_as_far_as_one_draw_of_it_may_be_off():
    def noise(share, spread):
        return SlowNoise(share, spread, np.zeros(1))

    assert noise(0.8, 0.1).is_the_gap and not noise(0.6, 0.1).is_the_gap
    assert noise(1.7, 0.3).is_possible and not noise(1.7, 0.1).is_possible


def test_noise_that_stays_on_an_input_is_noise_of_the_outputs():
    clean, slow = record(), SlowNoise(1.0, 0.1, np.array([3.0, 0.0]))
    once = NoisyInput(0, 0, slow=slow).corrected(clean)
    assert once.disturbance.tolist() == [3.0, 0.0] and once.select([1, 2]).disturbance.tolist() == [3.0, 0.0]
    both = NoisyInput(0, 1, slow=SlowNoise(1.0, 0.1, np.array([4.0, 1.0]))).corrected(once)
    assert both.disturbance.tolist() == [5.0, 1.0]
    assert NoisyInput(0, 0).corrected(clean).disturbance == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 4711])  # under white noise alone the smoother input looks unlikely with 4711
def test_noise_on_an_input_is_said_and_is_no_law(seed):
    case = make_case("cart", "input_noise", False, seed)
    report = diagnosed(case).report_
    assert report.verdict == "none" and report.effects == []
    fault = report.data[0]
    assert fault.kind == "input_noise" and fault.location == "u" and fault.share > 0.5
    size = 0.35 * 4.0 / np.sqrt(3)  # a share of the deviation of levels that are uniform within 4
    assert fault.size == pytest.approx(size, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 5813])
def test_a_bounded_input_whose_noise_is_smoothed_does_not_saturate(seed):
    """Its noise is the gap: a limit that the input never passed is likelier, and no name."""
    report = diagnosed(make_case("cart", "input_noise", False, seed), "input_saturation").report_
    assert report.data.kinds == ("input_noise",)
    assert (report.verdict, report.effects) == ("none", [])


@pytest.mark.slow
def test_an_effect_elsewhere_is_named_beside_noise_of_an_input_that_makes_up_the_gap():
    """Neighbouring levels of the input differ by less than a level with a place of its own costs."""
    report = diagnosed(make_case("motor", "input_noise", True, 0), "quadratic_drag", "input_saturation").report_
    assert report.data.kinds == ("input_noise",)
    assert [(effect.name, effect.location) for effect in report.effects] == [("quadratic_drag", "speed")]


@pytest.mark.slow
def test_a_slow_actuator_is_no_noise_of_the_input():
    # The plant gets a smoother input than was measured, and another effect is all that may be named.
    case, rng = make_case("cart", "nothing", False), np.random.default_rng(4)
    U = 4.0 * rng.uniform(-1, 1, (960, 1))
    slow = np.concatenate([lfilter([0.4], [1, -0.6], part, axis=0) for part in np.split(U, 4)])
    Y = np.concatenate([case.simulator.simulate(part) for part in np.split(slow, 4)])
    Y += 0.01 * Y.std() * rng.normal(size=Y.shape)
    runs = np.repeat(np.arange(4), 240)
    report = GapDiagnoser(case.simulator, effects=["sensor_bias"], n_jobs=1, random_state=0).fit(U, Y, runs).report_
    assert report.verdict == "unknown" and "input_noise" not in report.data.kinds


@pytest.mark.parametrize("level", [0.0, 3.0, -3.0])
@pytest.mark.parametrize("unit", [1e-2, 1.0, 1e2])
def test_a_jump_is_expected_where_the_simulator_makes_it_too(level, unit):
    jump = unit * np.array([0.0, 0.1, 0.0, 2.0, 2.1, 1.9, 2.0, 0.1, 0.0, 0.1])
    stretch = Stretch(3, 7, 2.0 * unit)
    assert _is_expected(jump, unit * level + jump, stretch) and _is_expected(jump, unit * level + 0.5 * jump, stretch)
    assert not _is_expected(jump, np.full(10, unit * level), stretch)
    assert not _is_expected(jump, unit * level - jump, stretch) and not _is_expected(jump, np.full(10, np.nan), stretch)


def test_a_stretch_of_measured_readings_keeps_its_first_and_last_row():
    rows = np.array([0, 2, 5, 6, 9])
    assert _in_rows(Stretch(1, 4, 0.5), rows) == Stretch(2, 7, 0.5) and _in_rows(Stretch(4, 5, 0.5), rows) == Stretch(
        9, 10, 0.5
    )


@pytest.mark.slow
def test_loads_of_each_run_read_as_offsets_where_the_plant_is_linear_and_the_remedy_says_so():
    """From free initial states ``dx/dt = u - a x + load`` is the plant without the load, and ``load / a`` on top."""
    loads, rng = np.array([0.8, -0.5, 0.3, -0.9]), np.random.default_rng(0)
    plant = ODESimulator(
        lambda t, x, u, p: (u[0] - 2.0 * x[0],), states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1
    )
    U = np.repeat(rng.uniform(-1, 1, (4, 12)), 10, axis=1)
    y = np.concatenate([plant.simulate((u + load)[:, None]).ravel() for u, load in zip(U, loads)])
    y += 0.01 * y.std() * rng.normal(size=len(y))
    diagnoser = GapDiagnoser(plant, effects=["input_gain", "linear_loss"], n_jobs=1, random_state=0)
    (fault,) = diagnoser.fit(U.reshape(-1, 1), y, np.repeat(range(4), 120)).report_.data
    assert fault.kind == "offset"
    assert [fault.values[k] for k in range(4)] == pytest.approx(loads / 2.0, abs=0.02)
    assert "a load" in fault.remedy


def test_readings_that_are_scaled_keep_their_density():
    """A Gaussian of the readings is the one of the corrected readings, times what the correction stretches them by."""
    rng, gains = np.random.default_rng(3), np.array([0.5, -0.2])
    y, known = rng.normal(size=(2, 6)), rng.uniform(size=(2, 6)) < 0.7
    record = Record(np.zeros((0, 6)), y, np.arange(6.0) % 3, np.array([0, 3]), 1.0, known)
    fault, scale = Gains(1, gains), 1.0 + gains[[0, 0, 0, 1, 1, 1]]
    before = norm.logpdf(y[1], 2.0 * scale, 0.3 * scale)[known[1]].sum()
    after = norm.logpdf(fault.corrected(record).y[1], 2.0, 0.3)[known[1]].sum()
    assert before == pytest.approx(after + fault.log_stretch(record), rel=1e-12)


@pytest.mark.slow
def test_a_valve_that_is_nearly_a_gain_is_no_gain_of_all_runs():
    """It leaves more than the noise, and readings that are divided by 1.35 have less of it."""
    simulator = ODESimulator(
        lambda t, x, u, p: (u[0] - x[0],), states=["q"], inputs=["u"], outputs=["q"], params={}, dt=0.1
    )
    rng = np.random.default_rng(5)
    U = np.repeat(rng.uniform(-2.0, 2.0, (4, 15)), 12, axis=1)[..., None]
    opened = U * (1.0 + 0.45 * np.abs(U) ** 0.3 / (1.0 + 0.3 * np.abs(U)))
    y = np.concatenate([simulator.simulate(u, x0=[0.0]) for u in opened]).reshape(-1, 1)
    y += rng.normal(0.0, 0.005, y.shape)
    report = GapDiagnoser(simulator, random_state=0, n_jobs=1).fit(U.reshape(-1, 1), y, np.repeat(np.arange(4), 180))
    assert not report.report_.data.kinds and report.report_.verdict == "explained"


@pytest.mark.parametrize("fault", [Offsets, Gains])
@pytest.mark.parametrize(
    ("values", "differs"),
    [((0.3, 0.0, 0.3), True), ((0.1, -0.2, 0.1), True), ((0.0030, 0.0028, 0.0029), False), ((-0.2, -0.1, -0.2), False)],
)
def test_what_all_runs_share_is_no_fault_of_runs(fault, values, differs):
    assert fault(0, np.array(values)).differs is differs


def test_inputs_that_are_late_in_all_runs_are_a_fault():
    assert Shifts(None, np.array([-1, -1, -1])).differs
