"""Unknown as a candidate: a law without a name beats several names that imitate it, and never the name that is true."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.fit._normal_equations import project_starts
from sksurrogate.gap.unnamed import _law_rival
from sksurrogate.gap.unnamed._law_rival import law_rival, without_names
from sksurrogate.gap.unnamed._law_shapes import PLAYS, SLEWS, followers, laws, of_time, over_sample, surfaces
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

RUNS, N, DT, NOISE = 4, 250, 0.1, 0.003


def nothing(q, f):
    return 0.0 * q


def simulator(law=nothing, outputs=("q",), force=0.0):
    """With a law, and a force from 12.3 s on."""
    return ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - p["k"] * x[0] - 0.5 * x[1] - law(x[0], u[0]) + force * (t > 12.3)),
        states=["q", "v"], inputs=["f"], outputs=list(outputs), params={"k": 1.0}, dt=DT,
    )  # fmt: skip


def problem_of(law, free=(), outputs=("q",), read=lambda y: y, force=0.0, real=None):
    rng, real = np.random.default_rng(3), real or simulator(law, outputs, force)
    U = [np.repeat(rng.uniform(-1.5, 1.5, N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [read(real.simulate(u, x0=np.zeros(2)).reshape(N, -1)) for u in U]
    Y = [y + NOISE * rng.normal(size=y.shape) for y in Y]
    plant = describe(simulator(outputs=outputs), n_inputs=1, n_outputs=len(outputs), dt=DT)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    return build_problem(plant, PlantModel(plant), record, free, ("v",))


def fitted(problem, x, *effects):
    """Effects and where their parameters start, fitted."""
    theta = np.concatenate([np.zeros(0), *(start for _, start in effects), np.zeros(len(problem.free))])
    candidate = problem.fit(tuple(effect for effect, _ in effects), theta, x)
    return estimate_noise(candidate, problem.first_noise())


def effect(name, *start):
    return CATALOGUE[name]("v", "q"), np.array(start)


def quintic(q, f):
    return 0.3 * q**5


@pytest.mark.parametrize("free", [(), ("k",)])
def test_one_law_beats_names_that_imitate_it(free):
    problem, smoothed = problem_of(quintic, free)
    names = fitted(problem, smoothed.x, effect("cubic_stiffness", 0.3), effect("linear_loss", -0.1))
    found = law_rival(names, names.fit.x, 50)
    assert found.gain > 10.0
    assert (found.location, found.kind, found.variable) == ("v", "state", "q")


def test_the_true_name_is_not_beaten_by_the_law_that_it_is():
    problem, smoothed = problem_of(lambda q, f: 0.3 * q**3)
    names = fitted(problem, smoothed.x, effect("cubic_stiffness", 0.2))
    found = law_rival(names, names.fit.x, 50)
    assert found.gain < 5.0
    assert (found.location, found.variable) == ("v", "q")


def test_two_true_names_are_not_beaten():
    problem, smoothed = problem_of(lambda q, f: 0.3 * q**3 + 0.2 * q)
    names = fitted(problem, smoothed.x, effect("cubic_stiffness", 0.2), effect("linear_loss", 0.1))
    assert law_rival(names, names.fit.x, 50).gain < 5.0


@pytest.mark.parametrize(
    ("name", "theta"),
    [("hidden_mode", (2.0, 3.0, 0.05)), ("hidden_relaxation", (1.0, 2.0)), ("hysteresis", (0.6, 0.3))],
)
def test_a_law_far_behind_a_true_name_is_behind_it_under_every_noise(monkeypatch, name, theta):
    """Judged at once under the names' noise, and with the noise fitted beside the law."""
    memory = CATALOGUE[name]("v", "q")
    values = dict(zip([p.name for p in memory.parameters], theta))
    problem, smoothed = problem_of(nothing, real=AugmentedSimulator(simulator(), [memory], [values]))
    x = np.concatenate([smoothed.x, np.zeros((memory.n_hidden, RUNS * N))])
    named = fitted(problem, x, (memory, np.array(theta)))
    at_once = law_rival(named, named.fit.x[:2], 50)
    monkeypatch.setattr(_law_rival, "BEYOND_NOISE", -np.inf)
    whole = law_rival(named, named.fit.x[:2], 50)
    assert at_once.gain < -60.0 and whole.gain < -60.0
    assert at_once.gain != whole.gain  # two ways to one answer


def test_a_law_of_two_signals_is_told_in_its_balance():
    """An input that a state lets through: neither the input's own curve nor a law of the state alone says as much."""
    problem, smoothed = problem_of(lambda q, f: 0.5 * np.tanh(3.0 * q) * f)
    found = law_rival(fitted(problem, smoothed.x), smoothed.x, 50)
    assert found.gain > 100.0
    assert (found.location, found.kind, found.variable) == ("v", "state", "q*f")


def test_what_all_runs_share_at_one_time_is_told_in_its_balance():
    problem, smoothed = problem_of(nothing, outputs=("q", "v"), force=0.2)
    found = law_rival(fitted(problem, smoothed.x), smoothed.x, 50)
    assert found.gain > 100.0
    assert (found.location, found.kind, found.variable) == ("v", "state", "time")


def test_no_law_of_time_where_the_runs_have_one_input():
    """Their gap is a function of the time whatever it is a law of."""
    u, y, t = np.sin(np.arange(9.0))[:, None], np.zeros((9, 1)), np.arange(9.0)
    assert not list(of_time(Record.from_runs([u] * 4, [y] * 4, [t] * 4, 1.0)))
    assert len(list(of_time(Record.from_runs([k * u for k in range(4)], [y] * 4, [t] * 4, 1.0)))) == 1


def test_without_the_names_the_simulator_alone_is_left():
    """The free run without the names, to first order about theirs: near to the simulator's own where they are small."""
    problem, smoothed = problem_of(lambda q, f: 0.003 * q**3)
    names = fitted(problem, smoothed.x, effect("cubic_stiffness", 0.003))
    _, r = without_names(names.candidate, names.fit.x)
    alone = fitted(problem, smoothed.x)
    J_x = alone.candidate.linearised.J_x
    residuals = np.stack([r, problem.record.y - alone.fit.y, problem.record.y - names.fit.y])
    without, own, named = project_starts(residuals, J_x, problem.record.starts)
    assert np.linalg.norm(without - own) < 0.1 * np.linalg.norm(own - named)


def test_no_law_of_a_signal_that_stands_still():
    record = Record.from_runs([np.zeros((9, 1))], [np.zeros((9, 1))], [np.arange(9.0)], 1.0)
    signals = np.stack([np.full(9, 2.0), np.linspace(-1.0, 1.0, 9)])
    found = list(laws(record, signals, ["still", "moving"]))
    assert {law.variable for law in found} == {"moving", "moving and its past"}


def test_a_law_acts_by_its_mean_over_each_sample():
    record = Record.from_runs([np.zeros((4, 1))] * 2, [np.zeros((4, 1))] * 2, [np.arange(4.0)] * 2, 1.0)
    f = np.array([[0.0, 2.0, 6.0, 12.0, 1.0, 1.0, 3.0, 3.0]])
    np.testing.assert_allclose(over_sample(record, f), [[1.0, 4.0, 9.0, 12.0, 1.0, 2.0, 3.0, 3.0]])


def test_a_surface_holds_every_product_of_the_parts_of_its_signals():
    """A partition of one along each signal; where one is held, its value is that of the whole sample."""
    record = Record.from_runs([np.zeros((50, 1))], [np.zeros((50, 1))], [np.arange(50.0)], 1.0)
    q, f = np.sin(0.3 * np.arange(50)), np.repeat([1.0, -2.0, 0.5, 3.0, -1.0], 10)
    law = next(surfaces(record, np.stack([q, f]), ["q", "f"], held={"f"}))
    assert law.variable == "q*f"
    surface = law.functions[law.forms[1].functions]
    np.testing.assert_allclose(surface.sum(axis=0), 1.0)
    product = over_sample(record, q[None])[0] * f
    weights = np.linalg.lstsq(surface.T, product, rcond=None)[0]
    np.testing.assert_allclose(weights @ surface, product, atol=1e-9)
    plane = np.add.outer(np.arange(6.0), 2.0 * np.arange(6.0)).ravel()
    np.testing.assert_allclose(law.forms[1].rough @ plane, 0.0, atol=1e-9)


def test_late_readings_are_told_in_their_sensor():
    def late(y):
        return np.column_stack([np.r_[y[:1, 0], y[:1, 0], y[:-2, 0]], y[:, 1]])

    problem, smoothed = problem_of(nothing, outputs=("q", "v"), read=late)
    found = law_rival(fitted(problem, smoothed.x), smoothed.x, 50)
    assert found.gain > 100.0
    assert (found.location, found.kind, found.variable) == ("q", "output", "q and its past")


def test_a_filter_of_a_measured_state_is_no_law():
    """Its last samples tell any force that has moved it; those of an input tell none."""
    rng = np.random.default_rng(7)
    record = Record.from_runs([np.zeros((N, 1))], [np.zeros((N, 1))], [DT * np.arange(N)], DT)
    x = np.cumsum(rng.normal(size=(1, N)), axis=1)
    late = x[0][record.back(1)]

    def left(given):
        law = next(law for law in laws(record, x, ["x"], given) if law.variable == "x and its past")
        designs = [law.functions[form.functions].T for form in law.forms]
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
    problem, smoothed = build_problem(plant, PlantModel(plant), Record.from_runs(U, Y, [t] * RUNS, DT), (), ("v",))
    found = law_rival(fitted(problem, smoothed.x), smoothed.x, 50)
    assert found.gain > 1000.0
    assert (found.location, found.variable) == ("v", "f and its past")


def played(u, width):
    """Backlash of a half width, from the first value on."""
    out = u.copy()
    for k in range(1, len(u)):
        out[k] = np.clip(out[k - 1], u[k] - width, u[k] + width)
    return out
