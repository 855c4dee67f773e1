"""A law without a name is found in its balance, input or sensor and in its signals, and none beside the name that is true."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.fit._linear_set import linear_set
from sksurrogate.gap.unnamed import _law_evidence
from sksurrogate.gap.unnamed._along_a_path import as_regressors
from sksurrogate.gap.unnamed._law_evidence import LawQuestion, law_beside, law_names
from sksurrogate.gap.unnamed._law_places import in_all_places
from sksurrogate.gap.unnamed._law_shapes import PLAYS, SLEWS, followers, laws, of_time, over_sample, surfaces
from sksurrogate.gap.unnamed._ode_channels import OdeChannels
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

RUNS, N, DT, NOISE = 4, 250, 0.1, 0.003


def nothing(q, f):
    return 0.0 * q


def simulator(acting=nothing, outputs=("q",), force=0.0):
    """With a law, and a force from 12.3 s on."""
    return ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - p["k"] * x[0] - 0.5 * x[1] - acting(x[0], u[0]) + force * (t > 12.3)),
        states=["q", "v"], inputs=["f"], outputs=list(outputs), params={"k": 1.0}, dt=DT,
    )  # fmt: skip


def problem_of(acting, free=(), outputs=("q",), read=lambda y: y, force=0.0, real=None):
    rng, real = np.random.default_rng(3), real or simulator(acting, outputs, force)
    U = [np.repeat(rng.uniform(-1.5, 1.5, N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [read(real.simulate(u, x0=np.zeros(2)).reshape(N, -1)) for u in U]
    Y = [y + NOISE * rng.normal(size=y.shape) for y in Y]
    plant = describe(simulator(outputs=outputs), n_inputs=1, n_outputs=len(outputs), dt=DT)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    return build_problem(PlantModel(plant), record, free, ("v",))


def fitted(problem, x, *effects):
    """Effects and where their parameters start, fitted."""
    theta = np.concatenate([np.zeros(0), *(start for _, start in effects), np.zeros(len(problem.free))])
    candidate = problem.fit(tuple(effect for effect, _ in effects), theta, x)
    return estimate_noise(candidate, problem.first_noise())


def effect(name, *start):
    return CATALOGUE[name]("v", "q"), np.array(start)


def quintic(q, f):
    return 0.3 * q**5


def law(found, x):
    """The likeliest law beside a set, along a path; its size over the gap of what the set leaves."""
    problem = found.candidate.problem
    unit = np.sqrt(max(found.fit.cost / found.candidate.problem.record.n_values - 1.0, 1e-2))
    asked = LawQuestion(found.candidate, (found.noise, problem.quiet(found.noise)), x[:2])
    return law_beside(asked, unit, 0.1).left


@pytest.mark.parametrize("free", [(), ("k",)])
def test_a_law_is_found_in_its_balance_and_signal(free):
    problem, smoothed = problem_of(quintic, free)
    found = law(fitted(problem, smoothed.x), smoothed.x)
    assert found.gain > 100.0 and found.probability > 0.999
    assert (found.location, found.kind, found.variable) == ("v", "state", "q")


@pytest.mark.parametrize("linear", [0.0, 0.2])
def test_beside_true_names_is_no_law(linear):
    problem, smoothed = problem_of(lambda q, f: 0.3 * q**3 + linear * q)
    true = [effect("cubic_stiffness", 0.2), *([effect("linear_loss", 0.1)] if linear else [])]
    names = fitted(problem, smoothed.x, *true)
    found = law(names, names.fit.x)
    assert found.gain < 5.0 and found.probability < 0.5


def test_a_law_of_a_sensor_has_one_name_beside_every_set():
    """The law of a valve between two tanks is not listed beside the name of another effect: laws of sensors stand earlier there."""
    tanks = ODESimulator(
        lambda t, x, u, p: (u[0] - p["valve"] * (x[0] - x[1]), p["valve"] * (x[0] - x[1]) - 0.3 * x[1]),
        states=["first", "last"], inputs=["flow"], outputs=["last"], params={"valve": 0.5}, dt=DT,
    )  # fmt: skip
    rng = np.random.default_rng(3)
    U = [np.repeat(rng.uniform(0.2, 1.5, N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [y + 0.2 * y**2 + NOISE * rng.normal(size=y.shape) for y in (tanks.simulate(u, x0=np.ones(2)) for u in U)]
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    problem, smoothed = build_problem(PlantModel(describe(tanks)), record, (), ("first", "last"))
    null = fitted(problem, smoothed.x)
    named = fitted(problem, smoothed.x, (CATALOGUE["linear_loss"]("last", "last"), np.array([0.1])))
    name = law_beside(LawQuestion(null.candidate, (null.noise,)), 1.0, 0.1).name
    assert (name.location, name.kind, name.variable) == ("last", "output", "last")
    beside = [list(in_all_places(linear_set(one.candidate).base)) for one in (null, named)]
    places = [law_names(laws).index(name._replace(form=0)) for laws in beside]
    assert places[0] > places[1]
    assert all(laws[k].kind == "output" for laws, k in zip(beside, places))


def test_a_signal_is_followed_beside_an_effect_with_a_state_of_its_own():
    """The equations of the simulator take its own states apart: those of the effect are not given to them."""

    def rhs(t, x, u, p):
        (level,) = x
        return (u[0] - p["k"] * level,)

    tank = ODESimulator(rhs, states=["level"], inputs=["flow"], outputs=["level"], params={"k": 0.5}, dt=DT)
    rng = np.random.default_rng(4)
    U = [np.repeat(rng.uniform(0.2, 1.5, N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [y + NOISE * rng.normal(size=y.shape) for y in (tank.simulate(u) for u in U)]
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    problem, smoothed = build_problem(PlantModel(describe(tank)), record, (), ("level",))
    slow = CATALOGUE["hidden_relaxation"]("level", "flow"), np.array([0.1, 2.0])
    channel = OdeChannels(fitted(problem, smoothed.x, slow).candidate).at("level", "state")
    assert channel is not None and set(channel.signals) >= {"level", "flow"}
    assert not problem.model.raised


def test_a_law_of_two_signals_is_told_in_its_balance():
    """An input that a state lets through: neither the input's own curve nor a law of the state alone says as much."""
    problem, smoothed = problem_of(lambda q, f: 0.5 * np.tanh(3.0 * q) * f)
    found = law(fitted(problem, smoothed.x), smoothed.x)
    assert found.gain > 100.0
    assert (found.location, found.kind, found.variable) == ("v", "state", "q*f")


@pytest.mark.slow
def test_what_all_runs_share_at_one_time_is_told_in_its_balance():
    problem, smoothed = problem_of(nothing, outputs=("q", "v"), force=0.2)
    found = law(fitted(problem, smoothed.x), smoothed.x)
    assert found.gain > 100.0
    assert (found.location, found.kind, found.variable) == ("v", "state", "time")


def test_no_law_of_time_where_the_runs_have_one_input():
    """Their gap is a function of the time whatever it is a law of."""
    u, y, t = np.sin(np.arange(9.0))[:, None], np.zeros((9, 1)), np.arange(9.0)
    assert not list(of_time(Record.from_runs([u] * 4, [y] * 4, [t] * 4, 1.0)))
    assert len(list(of_time(Record.from_runs([k * u for k in range(4)], [y] * 4, [t] * 4, 1.0)))) == 1


def test_no_law_of_a_signal_that_stands_still():
    record = Record.from_runs([np.zeros((9, 1))], [np.zeros((9, 1))], [np.arange(9.0)], 1.0)
    signals = np.stack([np.full(9, 2.0), np.linspace(-1.0, 1.0, 9)])
    found = list(laws(record, signals, ["still", "moving"]))
    assert {one.variable for one in found} == {"moving", "moving and its past"}


def test_a_law_acts_by_its_mean_over_each_sample():
    record = Record.from_runs([np.zeros((4, 1))] * 2, [np.zeros((4, 1))] * 2, [np.arange(4.0)] * 2, 1.0)
    f = np.array([[0.0, 2.0, 6.0, 12.0, 1.0, 1.0, 3.0, 3.0]])
    np.testing.assert_allclose(over_sample(record, f), [[1.0, 4.0, 9.0, 12.0, 1.0, 2.0, 3.0, 3.0]])


def test_a_surface_holds_every_product_of_the_parts_of_its_signals():
    """A partition of one along each signal; where one is held, its value is that of the whole sample."""
    record = Record.from_runs([np.zeros((50, 1))], [np.zeros((50, 1))], [np.arange(50.0)], 1.0)
    q, f = np.sin(0.3 * np.arange(50)), np.repeat([1.0, -2.0, 0.5, 3.0, -1.0], 10)
    one = next(surfaces(record, np.stack([q, f]), ["q", "f"], held={"f"}))
    assert one.variable == "q*f"
    surface = one.functions[one.forms[1].functions]
    np.testing.assert_allclose(surface.sum(axis=0), 1.0)
    product = over_sample(record, q[None])[0] * f
    weights = np.linalg.lstsq(surface.T, product, rcond=None)[0]
    np.testing.assert_allclose(weights @ surface, product, atol=1e-9)
    plane = np.add.outer(np.arange(6.0), 2.0 * np.arange(6.0)).ravel()
    np.testing.assert_allclose(one.forms[1].rough @ plane, 0.0, atol=1e-9)


def test_late_readings_are_told_in_their_sensor():
    def late(y):
        return np.column_stack([np.r_[y[:1, 0], y[:1, 0], y[:-2, 0]], y[:, 1]])

    problem, smoothed = problem_of(nothing, outputs=("q", "v"), read=late)
    found = law(fitted(problem, smoothed.x), smoothed.x)
    assert found.gain > 100.0
    assert (found.location, found.kind, found.variable) == ("q", "output", "q and its past")


def test_a_filter_of_a_measured_state_is_no_law():
    """Its last samples tell any force that has moved it; those of an input tell none."""
    rng = np.random.default_rng(7)
    record = Record.from_runs([np.zeros((N, 1))], [np.zeros((N, 1))], [DT * np.arange(N)], DT)
    x = np.cumsum(rng.normal(size=(1, N)), axis=1)
    late = x[0][record.back(1)]

    def left(given):
        one = next(one for one in laws(record, x, ["x"], given) if one.variable == "x and its past")
        designs = [one.functions[form.functions].T for form in one.forms]
        return min(np.std(late - F @ np.linalg.lstsq(F, late, rcond=None)[0]) for F in designs)

    assert left(["x"]) < 1e-9
    assert left([]) > 0.3  # of steps of 1


def test_play_and_limited_rates_follow_in_closed_form():
    """A rise takes a play along once its slack is used up; a step is followed at the rate; both begin anew with a run."""
    ramp, step = np.arange(41.0), np.r_[0.0, np.ones(40)]
    record = Record.from_runs([np.zeros((41, 1))] * 2, [np.zeros((41, 1))] * 2, [np.arange(41.0)] * 2, 1.0)
    up_and_again = np.stack([np.tile(ramp, 2), np.tile(step, 2)])
    (play, *_), (_, slew, shown) = (followers(record, z) for z in up_and_again)
    for k, share in enumerate(PLAYS):
        np.testing.assert_allclose(play[k], np.tile(np.maximum(ramp - 40.0 * share, 0.0), 2), atol=1e-12)
    for k, n in enumerate(SLEWS):
        np.testing.assert_allclose(slew[k], np.tile(np.clip((ramp - 0.5) / n, 0.0, 1.0), 2), atol=1e-12)
        np.testing.assert_allclose(shown[k], np.tile(np.clip((ramp - 1.0) / n, 0.0, 1.0), 2), atol=1e-12)


def test_an_actuator_with_play_is_told_by_the_past_of_its_input():
    """One position of the play between the two that are tried: the plays in between are sums of them, nearly."""
    rng = np.random.default_rng(5)
    t = DT * np.arange(N)
    U = [np.sin(w * t)[:, None] * 1.5 for w in rng.uniform(0.5, 1.5, RUNS)]
    slack = [played(u, 0.3) for u in U]
    Y = [simulator().simulate(v, x0=np.zeros(2)).reshape(N, 1) + NOISE * rng.normal(size=(N, 1)) for v in slack]
    plant = describe(simulator(), n_inputs=1, n_outputs=1, dt=DT)
    problem, smoothed = build_problem(PlantModel(plant), Record.from_runs(U, Y, [t] * RUNS, DT), (), ("v",))
    found = law(fitted(problem, smoothed.x), smoothed.x)
    assert found.gain > 1000.0
    assert (found.location, found.variable) == ("v", "f and its past")


def played(u, width):
    """Backlash of a half width, from the first value on."""
    out = u.copy()
    for k in range(1, len(u)):
        out[k] = np.clip(out[k - 1], u[k] - width, u[k] + width)
    return out


def test_an_effect_without_parameters_acts_in_the_simulator_without_effects_too():
    problem, smoothed = problem_of(nothing, read=np.abs)
    found = fitted(problem, smoothed.x, (CATALOGUE["sensor_rectification"]("q"), np.zeros(0))).candidate
    np.testing.assert_allclose(as_regressors(found, found.fit.x[:2]).r, linear_set(found).r, atol=0.1 * NOISE)


def test_forms_of_a_law_are_compared_as_one_at_a_time():
    problem, smoothed = problem_of(quintic, ("k",))
    found = fitted(problem, smoothed.x)
    fit = _law_evidence._Fit(linear_set(found.candidate), (found.noise,), 30.0, 0.1, frozenset())
    k = next(k for k, law in enumerate(fit.candidates) if law.place == ("v", "q"))
    moved = fit.candidates[k].moved()
    G, _ = fit.linear.D.gram(np.concatenate([fit.linear.known, moved], axis=1), found.noise)
    together = fit.evidence_of_forms(k, moved, G)
    noise, none = found.noise, fit.linear.log_likelihood(found.noise)
    for f in range(0, len(together), 5):
        alone = fit.found(k, f, moved[:, fit.candidates[k].signal.forms[f].functions], noise)
        assert together[f] == pytest.approx(np.logaddexp(alone.small, alone.large) - none, abs=1e-6)
    G[1, -1] = np.nan
    assert np.all(np.isneginf(fit.evidence_of_forms(k, moved, G)))


def test_a_form_that_moves_the_outputs_as_the_effect_is_this_effect_and_no_law():
    problem, smoothed = problem_of(quintic, ("k",))
    found = fitted(problem, smoothed.x)
    fit = _law_evidence._Fit(linear_set(found.candidate), (found.noise,), 30.0, 0.1, frozenset())
    k = next(k for k, law in enumerate(fit.candidates) if law.place == ("v", "q"))
    f = next(f for f, form in enumerate(fit.candidates[k].signal.forms) if len(form.functions) == 1)
    moved = fit.candidates[k].moved()
    G, _ = fit.linear.D.gram(np.concatenate([fit.linear.known, moved], axis=1), found.noise)
    all_forms = fit.evidence_of_forms(k, moved, G)
    beside = replace(fit, instead=1.7 * moved[:, fit.candidates[k].signal.forms[f].functions[0]])
    others = beside.evidence_of_forms(k, moved, G)
    assert np.isneginf(others[f]) and np.isfinite(all_forms[f])
    assert others[:f] + others[f + 1 :] == all_forms[:f] + all_forms[f + 1 :]
    assert f not in beside.relatives(k, f) and f in fit.relatives(k, f)
    # beside another effect in this place and variable it corrects that one's form
    assert replace(beside, named=frozenset({("v", "q")})).relatives(k, f)[0] == f
