"""Effects that begin within the runs are named with their onset; effects that are always there are not given one."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, starting
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.screen._screen import Screen, Start
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.search._onsets import confined, twins_with_onset
from sksurrogate.physics import ODESimulator

DT, N, RUNS = 0.05, 300, 2
EFFECTS = [
    "coulomb_friction",
    "linear_loss",
    "quadratic_drag",
    "input_gain",
    "input_bias",
    "sensor_bias",
    "constant_bias",
]


def oscillator(t, x, u, p):
    return x[1], u[0] - 9.0 * x[0] - 0.6 * x[1]


def simulator():
    return ODESimulator(oscillator, states=["q", "v"], inputs=["F"], outputs=["q"], params={}, dt=DT)


def diagnosed(effect, values, seed=0):
    rng = np.random.default_rng(seed)
    U = np.repeat(3 * rng.normal(size=(RUNS, N // 10, 1)), 10, axis=1)
    plant = AugmentedSimulator(simulator(), [effect], [values])
    Y = np.stack([plant.simulate(u) for u in U])
    Y = Y + 0.003 * rng.normal(size=Y.shape)
    diagnoser = GapDiagnoser(simulator(), effects=EFFECTS, n_jobs=1, random_state=0)
    return diagnoser.fit(U.reshape(-1, 1), Y.reshape(-1, 1), groups=np.repeat(np.arange(RUNS), N)).report_


@pytest.mark.parametrize(
    ("name", "place", "values"),
    [
        ("coulomb_friction", ("v", "v"), {"level": 0.5}),
        pytest.param("sensor_bias", ("q", None), {"value": 0.05}, marks=pytest.mark.slow),
    ],
)
def test_an_effect_that_begins_is_named_with_its_onset(name, place, values):
    report = diagnosed(starting(CATALOGUE[name](*place)), {**values, "onset": 8.33})
    assert report.verdict == "explained" and [effect.name for effect in report.effects] == [name]
    effect = report.effects[0]
    magnitude = next(iter(values))
    assert effect.params["onset"] == pytest.approx(8.33, abs=DT)
    assert effect.params[magnitude] == pytest.approx(values[magnitude], rel=0.03)
    low, high = effect.intervals["onset"]
    assert low <= 8.33 <= high and list(effect.params) == [magnitude, "onset"]
    assert "from t = 8.3" in report.sentence
    first = report.ranking.rows[0]
    assert first["named"] and first["name"] == name


@pytest.mark.slow
def test_an_effect_that_is_always_there_has_no_onset():
    report = diagnosed(CATALOGUE["coulomb_friction"]("v", "v"), {"level": 0.5})
    assert [(effect.name, list(effect.params)) for effect in report.effects] == [("coulomb_friction", ["level"])]


def screen_of(columns, residual, n_runs=2):
    """A screen of effects with these columns (n, n_samples), an initial state that the outputs forget."""
    n = len(residual) // n_runs
    ages = np.tile(np.arange(n), n_runs)
    names = ["linear_loss", "quadratic_drag", "coulomb_friction"]
    starts = [
        Start(CATALOGUE[name]("v", "v"), np.ones(1), gain, 0.0, 0.0, np.zeros((1, 1)), raw=np.ones(1))
        for name, gain in zip(names, [float((c @ residual) ** 2 / (c @ c)) for c in columns])
    ]
    open_ends = np.full(len(columns), -np.inf), np.full(len(columns), np.inf)
    return Screen(
        starts, np.asarray(columns, np.float32)[:, None], residual[None, None], 0.5 ** ages[None, None].astype(float),
        np.zeros(0), np.zeros(0), n * np.arange(n_runs), *open_ends, np.zeros(4),
    ), np.full(n_runs, n)  # fmt: skip


def test_a_part_of_a_column_is_found_and_a_whole_one_is_not():
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(3, 400))
    age = np.tile(np.arange(200), 2)
    noise = 0.1 * rng.normal(size=400)
    found = confined(*screen_of(columns, noise + columns[1] * (age >= 125)), least=5.0)
    assert found[0].effect.name == "quadratic_drag" and found[0].span == ("onset",)
    assert found[0].drop == pytest.approx(np.sum(columns[1][age >= 125] ** 2), rel=0.1)
    ended = confined(*screen_of(columns, noise + columns[2] * (age < 75)), least=5.0)
    assert ended[0].effect.name == "coulomb_friction" and ended[0].span == ("end",)
    within = confined(*screen_of(columns, noise + columns[0] * ((age >= 62) & (age < 138))), least=5.0)
    assert within[0].effect.name == "linear_loss" and within[0].span == ("onset", "end")
    assert confined(*screen_of(columns, noise + columns[1]), least=5.0) == []
    assert confined(*screen_of(columns, noise), least=20.0) == []


def test_the_edges_of_a_short_window_are_found_between_those_of_the_grid():
    """The grid has windows of 50 rows at least; 14 rows of a column are the whole residual, but for the noise."""
    rng = np.random.default_rng(0)
    columns, age = rng.normal(size=(3, 800)), np.tile(np.arange(400), 2)
    planted = 3.0 * columns[1] * ((age >= 211) & (age < 225))
    best = confined(*screen_of(columns, 0.05 * rng.normal(size=800) + planted), least=5.0)[0]
    assert (best.effect.name, best.span) == ("quadratic_drag", ("onset", "end"))
    paid = 4 * np.log(800)  # initial states that are free at both edges of two runs
    assert best.drop == pytest.approx(np.sum(planted**2) - paid, rel=0.02)


def test_a_window_that_closes_what_an_effect_leaves_is_worth_a_fit():
    """Always there it explains 96 % already."""
    rng = np.random.default_rng(0)
    age = np.tile(np.arange(200), 2)
    columns = rng.normal(size=(3, 400)) * np.where(age < 12, 0.7, 1.0)
    best = confined(*screen_of(columns, 10 * (0.1 * rng.normal(size=400) + columns[1] * (age >= 12))), least=5.0)[0]
    assert (best.effect.name, best.span) == ("quadratic_drag", ("onset",))


@pytest.mark.parametrize("span", [("onset",), ("end",), ("onset", "end")])
def test_what_moves_the_outputs_as_an_effect_in_a_window_does_so_in_its_window(span):
    """A quadratic drag is a loss twice as large here, and a friction is something else."""
    rng = np.random.default_rng(0)
    loss, other = rng.normal(size=(2, 400))
    screen, _ = screen_of([loss, 2.0 * loss, other], loss)
    bounds = [8.0, 11.0][: len(span)]
    found = twins_with_onset(screen, starting(CATALOGUE["linear_loss"]("v", "v"), span), np.array([0.6, *bounds]))
    [(effect, values)] = found
    assert effect.key == ("quadratic_drag", "v", "v", "-".join(span))
    np.testing.assert_allclose(values, [0.3, *bounds], rtol=1e-6)
    assert twins_with_onset(screen, CATALOGUE["linear_loss"]("v", "v"), np.array([0.6])) == []


def test_effects_in_a_window_lend_their_shape_to_such_effects_alone():
    friction = CATALOGUE["coulomb_friction"]
    late, plain, other = starting(friction("v", "v")), friction("w", "w"), starting(friction("w", "w"))
    nearest = SimpleNamespace(
        fit=SimpleNamespace(cost=1.0), effects=(late,), keys=(late.key,), theta_of=lambda i: np.array([0.5, 8.0])
    )
    search = SimpleNamespace(
        library=[plain, other],
        may_be_beside=lambda effect: True,
        known=lambda *given: [],
        as_searched=lambda base: base,
        shaped=lambda base, effects, shape, best: [(effect, shape) for effect in effects],
    )
    base = SimpleNamespace(keys=())
    assert OdeSearch.siblings(search, [nearest], base) == [(other, (8.0,))]


@pytest.mark.slow
def test_in_one_run_a_gain_that_sets_in_and_the_jump_of_its_parameter_are_one_class():
    def rhs(t, x, u, p):
        return x[1], p["gain"] * u[0] - 9.0 * x[0] - 0.6 * x[1]

    nominal = ODESimulator(rhs, states=["q", "v"], inputs=["F"], outputs=["q"], params={"gain": 1.0}, dt=DT)
    rng = np.random.default_rng(1)
    U = np.repeat(3 * rng.normal(size=(60, 1)), 10, axis=0)
    plant = AugmentedSimulator(
        nominal, [starting(CATALOGUE["input_gain"]("F"))], [{"relative_error": 0.4, "onset": 17.3}]
    )
    Y = plant.simulate(U) + 0.003 * rng.normal(size=(600, 1))
    effects = [*EFFECTS, "parameter_error", "parameter_step"]
    report = GapDiagnoser(nominal, effects=effects, n_jobs=1, random_state=0).fit(U, Y).report_
    assert report.verdict == "explained" and report.shrink.fraction > 0.9  # the blocks know when it sets in
    (effect,) = report.effects
    names = {effect.name, *(name for name, _, _ in effect.equivalents)}
    assert {"input_gain", "parameter_step"} <= names and "input_bias" not in names
    assert effect.name == "parameter_step"  # what jumps by itself is named before what begins
    low, high = effect.intervals["onset" if "onset" in effect.intervals else "time"]
    assert low <= 17.3 <= high and high - low < 0.3


def spindle(t, x, u, p):
    return [(0.9 * x[1] - p["b"] * x[0]) / 0.09, (u[0] - 1.4 * x[1] - 0.9 * x[0]) / 0.03]


@pytest.mark.slow
def test_what_begins_is_found_beside_a_free_parameter():
    """A re-tuning to the whole record spreads over it what begins within: from the parameters as they are given it is seen where it is."""
    nominal = ODESimulator(spindle, states=["w", "i"], inputs=["u"], outputs=["w", "i"], params={"b": 0.05}, dt=0.02)
    brake = starting(CATALOGUE["coulomb_friction"]("w", "w"))
    plant = AugmentedSimulator(nominal, [brake], [{"level": 14.4, "onset": 2.5}])
    rng = np.random.default_rng(311)
    U = np.repeat(rng.uniform(-24, 24, (3, 12, 1)), 20, axis=1)
    Y = np.stack([plant.simulate(u) for u in U]) + np.array([0.2, 0.12]) * rng.normal(size=(3, 240, 2))
    effects = ["coulomb_friction", "parameter_step", "linear_loss"]
    diagnoser = GapDiagnoser(nominal, effects=effects, free_params=["b"], n_jobs=1, random_state=0)
    report = diagnoser.fit(U.reshape(-1, 1), Y.reshape(-1, 2), groups=np.repeat(np.arange(3), 240)).report_
    assert report.verdict == "explained" and [effect.name for effect in report.effects] == ["coulomb_friction"]
    params = report.effects[0].params
    assert params["onset"] == pytest.approx(2.5, abs=0.04) and params["level"] == pytest.approx(14.4, rel=0.03)
