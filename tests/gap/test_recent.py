"""Large values are kept by the latest few alone; pairs in blocks are pairs at once."""

import gc
import weakref
from dataclasses import dataclass, replace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._normal_equations import eliminate, project_starts
from sksurrogate.gap.fit._recent import recent_property
from sksurrogate.gap.screen._pairs import _Columns, beside, best_pairs
from sksurrogate.gap.screen._screen import Screen, Start
from sksurrogate.physics import ODESimulator


@dataclass(frozen=True)
class Holder:
    n: int

    @recent_property(2)
    def row(self):
        return np.full(3, self.n)


def test_the_latest_few_keep_their_value_and_others_make_it_again():
    holders = [Holder(n) for n in range(4)]
    rows = [holder.row for holder in holders]
    assert ["row" in vars(holder) for holder in holders] == [False, False, True, True]
    assert holders[3].row is rows[3] and np.array_equal(holders[0].row, rows[0])
    assert "row" not in vars(holders[2])


def test_holders_are_not_kept_alive():
    holder = Holder(1)
    ref = weakref.ref(holder)
    _ = holder.row
    del holder
    gc.collect()
    assert ref() is None


def screen_of(seed=0, n=30, n_samples=60):
    """A screen with columns of several starting values of each effect, initial states and a fitted parameter."""
    rng = np.random.default_rng(seed)
    names = ["constant_bias", "linear_loss", "coulomb_friction", "quadratic_drag", "cubic_stiffness", "gravity_tilt"]
    effects = [CATALOGUE[name]("x", None if name == "constant_bias" else "x") for name in names]
    columns = rng.normal(size=(n, 1, n_samples)).astype(np.float32)
    path = np.zeros((1, n_samples))
    starts = [Start(effects[k % 6], np.ones(1), 0.0, 0.0, 0.0, path, raw=np.ones(1)) for k in range(n)]
    known = rng.normal(size=(2, 1, n_samples))
    known[0] += columns[3] - 2.0 * columns[10]
    open_ends = np.full(n, -np.inf), np.full(n, np.inf)
    J_x = rng.normal(size=(1, 2, n_samples))
    rest = np.array([0.1]), np.array([0.02]), np.array([0, 25])
    return Screen(starts, columns, known, J_x, *rest, *open_ends, np.zeros(4))


def test_products_of_columns_are_those_of_the_whole_gram():
    screen = screen_of()
    stack = np.concatenate([screen.known, screen.columns.astype(float)])
    flat = project_starts(stack, screen.J_x, screen.record_starts).reshape(len(stack), -1)
    G = eliminate(flat @ flat.T, 1, screen.precision, screen.pull)
    g, H = G[0, 1:], G[1:, 1:]
    drop = _Columns.of(screen).with_all(np.array([3, 7]))[0]
    for k, row in zip((3, 7), drop):
        for m in range(len(g)):
            if m != k:
                both = [k, m]
                assert row[m] == pytest.approx(g[both] @ np.linalg.solve(H[np.ix_(both, both)], g[both]), rel=1e-4)


def test_the_unit_of_a_fitted_parameter_changes_no_pair():
    """Ten to the 25 times the readings move with the coefficient of a tenth power of a temperature in K: too much for single precision squared."""
    screen, unit = screen_of(), 1e25
    scaled = replace(screen, known=screen.known * np.array([1.0, unit])[:, None, None])
    scaled = replace(scaled, precision=screen.precision * unit**2, pull=screen.pull * unit)
    for one, other in zip(best_pairs(screen, 3), best_pairs(scaled, 3), strict=True):
        assert (one.first.effect.key, one.second.effect.key) == (other.first.effect.key, other.second.effect.key)
        assert one.drop == pytest.approx(other.drop, rel=1e-5)


def test_a_fitted_parameter_that_the_data_do_not_see_changes_no_pair():
    screen = screen_of()
    blind = replace(
        screen, known=np.concatenate([screen.known, 0.0 * screen.known[1:]]), precision=np.array([0.1, 0.1]),
        pull=np.append(screen.pull, 0.0),
    )  # fmt: skip
    for one, other in zip(best_pairs(screen, 3), best_pairs(blind, 3), strict=True):
        assert (one.first.effect.key, one.second.effect.key) == (other.first.effect.key, other.second.effect.key)
        assert one.drop == pytest.approx(other.drop, rel=1e-6)


def test_the_pair_that_makes_the_residual_is_the_best():
    first, second, _ = best_pairs(screen_of(), 3)[0]
    assert {first.effect.name, second.effect.name} == {"quadratic_drag", "cubic_stiffness"}
    assert sorted(round(float(start.theta[0]), 1) for start in (first, second)) != [1.0, 1.0]


def test_two_that_cancel_are_seen_beside_another_effect():
    screen = screen_of()
    base = replace(screen, starts=[], columns=None, known=screen.known.copy())
    base.known[0] = 5.0 * (screen.columns[4] - screen.columns[13]) + 0.1 * screen.columns[0]
    taken = {screen.starts[0].effect.key}
    first, second, drop = best_pairs(beside(screen, base, taken), 3)[0]
    assert {first.effect.name, second.effect.name} == {"cubic_stiffness", "linear_loss"}
    assert drop == pytest.approx(np.sum(base.known[0] ** 2), rel=0.2)
    assert all(
        pair.first.effect.key not in taken and pair.second.effect.key not in taken
        for pair in best_pairs(beside(screen, base, taken), 9)
    )


def test_a_base_whose_path_left_the_finite_numbers_has_no_pairs_and_ends_no_search():
    screen = screen_of()
    broken = replace(screen, starts=[], columns=None, known=np.full_like(screen.known, np.nan))
    assert best_pairs(beside(screen, broken, ()), 3) == []


@pytest.mark.slow
def test_a_load_and_a_gain_that_cancel_are_named_beside_a_play():
    """One by one neither leaves less than an offset of the other sensor does, which was named alone."""

    def rhs(t, x, u, p):
        return u[0] - x[0] - 0.5 * (x[0] - x[1]), 0.5 * (x[0] - x[1]) - 0.8 * x[1] + 0.3 * u[1]

    nominal = ODESimulator(rhs, states=["a", "b"], inputs=["F", "G"], outputs=["a", "b"], params={}, dt=0.1)
    rng, n = np.random.default_rng(0), 400
    U = np.repeat(np.stack([4 + 0.5 * rng.normal(size=n // 20), 4 * rng.normal(size=n // 20)], axis=1), 20, axis=0)
    planted = {"input_backlash": ("G", 1.2), "input_bias": ("F", -0.12), "sensor_gain": ("a", 0.03)}
    effects = [CATALOGUE[name](place) for name, (place, _) in planted.items()]
    values = [{effect.parameters[0].name: planted[effect.name][1]} for effect in effects]
    plant = AugmentedSimulator(nominal, effects, values)
    runs = [U, U[::-1]]
    y = np.concatenate([plant.simulate(u, x0=[2.0, 1.5]) for u in runs]) + 0.003 * rng.normal(size=(2 * n, 2))
    names = [
        *planted,
        "sensor_bias",
        "linear_loss",
        "constant_bias",
        "input_gain",
        "quadratic_drag",
        "coulomb_friction",
    ]
    diagnoser = GapDiagnoser(nominal, effects=names, n_jobs=1, random_state=0)
    report = diagnoser.fit(np.concatenate(runs), y, groups=np.repeat([0, 1], n)).report_
    classes = [{effect.name, *(name for name, _, _ in effect.equivalents)} for effect in report.effects]
    assert len(classes) == 3 and all(any(name in names for names in classes) for name in planted)
