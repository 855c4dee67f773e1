"""The choice of the names, repeated without each fold of runs."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.decide._choice_by_fold import ByRun, by_run, chosen_without
from sksurrogate.gap.decide._held_out import held_out, notes_on_names, same_names, without_names
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import judged_under
from sksurrogate.gap.fit._prior import prior_cost
from sksurrogate.kernels.disturbance import Disturbance
from sksurrogate.kernels.record import Record
from sksurrogate.physics import CallableSimulator, ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, RUNS = 0.1, 150, 4


def tank(leak=0.0):
    return ODESimulator(
        lambda t, x, u, p: (u[0] - p["out"] * x[0] - leak,),
        states=["level"], inputs=["flow"], outputs=["level"], params={"out": 0.8}, x0=[1.0], dt=DT,
    )  # fmt: skip


def recorded():
    """Runs of the tank with a constant leak."""
    rng = np.random.default_rng(0)
    U = [np.repeat(rng.uniform(0.5, 2.0, N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [tank(0.3).simulate(u) + 0.01 * rng.normal(size=(N, 1)) for u in U]
    return np.concatenate(U), np.concatenate(Y), np.repeat(np.arange(RUNS), N)


def fitted(data, *effects):
    """The problem, and one candidate of each effect."""
    X, y, groups = data
    runs = [groups == k for k in range(RUNS)]
    record = Record.from_runs([X[k] for k in runs], [y[k] for k in runs], [DT * np.arange(N)] * RUNS, DT)
    plant = describe(tank(), n_inputs=1, n_outputs=1, dt=DT)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("level",))
    return problem, [problem.fit((effect,), np.full(1, 0.1), smoothed.x) for effect in effects]


def likelihood(candidate, noise):
    """Largest log likelihood under a noise, with what the candidate's initial states cost."""
    return judged_under(candidate, [noise]).log_likelihood - 0.5 * prior_cost(candidate)


def test_likelihoods_of_runs_add_up_and_those_of_some_runs_are_those_of_a_fit_to_them():
    """The plant and the effect are linear: one step leads from the fit of all runs to that of three of them."""
    problem, (candidate,) = fitted(recorded(), CATALOGUE["constant_bias"]("level"))
    noise = problem.first_noise()
    runs = by_run(candidate, [noise], problem.record.starts, by_size=False, prior=prior_cost(candidate))
    everything = np.ones(RUNS, bool)
    assert runs.evidence(everything) == pytest.approx(likelihood(candidate, noise), rel=1e-9)
    kept = np.array([True, False, True, True])
    some = problem.on([0, 2, 3])
    again = some.fit(
        candidate.effects, candidate.fit.theta, candidate.fit.x[:, np.isin(problem.record.run_of_row, [0, 2, 3])]
    )
    assert runs.evidence(kept) == pytest.approx(likelihood(again, noise), abs=0.01)


def test_blocks_of_a_run_have_the_likelihood_of_runs_of_their_own():
    problem, (candidate,) = fitted(recorded(), CATALOGUE["constant_bias"]("level"))
    whole, noise = candidate.disturbance, problem.first_noise()
    cut = np.sort(np.r_[whole.starts, whole.starts + 60])
    r = np.random.default_rng(1).normal(size=(1, 2, problem.record.n_samples))
    grams, log_dets = whole.in_runs_from(cut).gram_by_run(r, noise)
    for k, (a, b) in enumerate(zip(cut, np.r_[cut[1:], problem.record.n_samples])):
        A, B, C = (part[a:b].transpose(1, 2, 0) for part in (whole.A, whole.B, whole.C))
        alone = Disturbance(A, B, C, np.array([0]), whole.start_sd, whole.slack)
        G, log_det = alone.gram(r[:, :, a:b], noise)
        np.testing.assert_allclose(grams[k], G, rtol=1e-7)
        assert log_dets[k] == pytest.approx(log_det, rel=1e-7)


def of_costs(costs, n_parameters=1):
    """A candidate of these costs in the runs, whose parameters do nothing there."""
    grams = np.array(costs, float)[:, None, None]
    return ByRun(grams, np.zeros(len(costs)), lambda G, log_det: -0.5 * (G[0, 0] + log_det), 0.0, n_parameters)


def test_the_other_runs_keep_a_name_unless_they_reject_it():
    fold, lengths = np.arange(4), np.full(4, 100)
    own = of_costs([100, 100, 100, 100])
    # Run 0 alone speaks for the name: without it the others prefer the other one, by 45; the bar is ln 300 + 2 ln 50 = 13.5.
    assert chosen_without(own, [of_costs([500, 85, 85, 85])], fold, lengths, 50) == [0, None, None, None]
    assert chosen_without(own, [of_costs([500, 96, 96, 96])], fold, lengths, 50) == [None] * 4
    assert chosen_without(own, [of_costs([500, 85, 85, 85], 9)], fold, lengths, 50) == [None] * 4
    assert chosen_without(own, [], fold, lengths, 50) == [None] * 4


def test_a_name_that_acts_in_one_run_alone_is_not_left_for_a_simpler_one():
    """An overflow that one run of a tank reached: the others need none of its parameters."""
    fold, lengths = np.arange(4), np.full(4, 400)
    own, simple = of_costs([100, 100, 100, 100], 2), of_costs([9000, 98, 98, 98], 1)
    assert chosen_without(own, [simple] * 8, fold, lengths, 170) == [None] * 4


def test_by_size_one_value_in_ten_counts():
    fold, lengths = np.arange(2), np.full(2, 1000)
    own, near = of_costs([1e6, 1e6]), of_costs([9e5, 9e5])
    assert chosen_without(own, [near], fold, lengths, 50, by_size=True) == [None, None]
    assert chosen_without(own, [of_costs([5e5, 5e6])], fold, lengths, 50, by_size=True) == [None, 0]


def test_what_all_runs_prefer_is_held_back_by_what_held_it_back_there():
    fold, lengths = np.arange(4), np.full(4, 100)
    own = of_costs([100, 100, 100, 100])
    # 80 nats nearer in all runs, and not named: three of them, which prefer it by 60, do not name it either
    assert chosen_without(own, [of_costs([80, 80, 80, 80])], fold, lengths, 50) == [None] * 4
    assert chosen_without(own, [of_costs([190, 40, 40, 40])], fold, lengths, 50) == [0, None, None, None]


def test_what_the_other_runs_choose_stands_in_the_error_on_a_run_left_out():
    problem, (bias, loss) = fitted(
        recorded(), CATALOGUE["constant_bias"]("level"), CATALOGUE["linear_loss"]("level", "level")
    )
    null = problem.fit((), np.zeros(0), bias.fit.x)
    without = without_names(null)
    right, wrong = (held_out([one] * RUNS, without).after for one in (bias, loss))
    mixed = held_out([bias, loss, bias, bias], without, same_names([bias, loss, bias, bias], bias))
    second = problem.record.run_of_row == 1
    np.testing.assert_array_equal(mixed.after[:, second], wrong[:, second])
    np.testing.assert_array_equal(mixed.after[:, ~second], right[:, ~second])
    assert mixed.same_names == 0.75
    (note,) = notes_on_names([one.effects for one in (bias, loss, bias, bias)], bias.effects, mixed, list("abcd"))
    assert "without run 'b' linear loss at level" in note
    assert notes_on_names([bias.effects] * RUNS, bias.effects, mixed, list("abcd")) == []


def trajectories():
    """The tank as a simulator that tells its outputs and nothing else."""

    def simulate(U, x0):
        return tank().simulate(U, x0=x0)

    return CallableSimulator(simulate, inputs=["flow"], outputs=["level"], dt=DT, x0=[1.0])


@pytest.mark.slow
@pytest.mark.parametrize("simulator", [tank(), trajectories()], ids=["equations", "trajectories"])
def test_a_name_that_all_runs_show_is_chosen_by_all_folds(simulator):
    X, y, groups = recorded()
    effects = ["input_bias", "input_gain", "sensor_gain"]
    report = GapDiagnoser(simulator, effects=effects, random_state=0).fit(X, y, groups).report_
    assert [effect.name for effect in report.effects] == ["input_bias"]
    assert report.shrink.same_names == 1.0
    assert not any("Some folds choose" in note for note in report.notes)
