"""A search ends where further names are below the practical bar; the screen works in blocks and says how far several names lead."""

import numpy as np
import pytest
from joblib import parallel_config

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.screen import _candidate_columns
from sksurrogate.gap.screen._left_by_several import left_by_several
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.physics import ODESimulator

FEW = [
    "coulomb_friction",
    "stribeck_friction",
    "hysteresis",
    "cubic_stiffness",
    "quadratic_drag",
    "linear_loss",
    "input_gain",
]
HOW = {"states": ["x", "v"], "inputs": ["u"], "outputs": ["x"], "params": {"k": 1.0, "c": 0.3}}


def oscillator(missing):
    def rhs(t, x, u, p):
        return [x[1], u[0] - p["k"] * x[0] - p["c"] * x[1] + missing(x)]

    return rhs


def recorded(missing, noise, rows=200):
    """A simulator, and three runs of a plant with a term more."""
    rng = np.random.default_rng(0)
    plant = ODESimulator(oscillator(missing), dt=0.02, **HOW)
    U = np.repeat(rng.uniform(-2, 2, (3, rows // 10)), 10, axis=1)
    Y = np.concatenate([plant.simulate(np.repeat(u, 5)[:, None])[::5] for u in U])
    simulator = ODESimulator(oscillator(lambda x: 0.0), dt=0.1, **HOW)
    return simulator, U.reshape(-1, 1), Y + noise * rng.normal(size=Y.shape), np.repeat(np.arange(3), rows)


def test_columns_one_after_the_other_leave_what_least_squares_leaves():
    rng = np.random.default_rng(1)
    A, r = rng.normal(size=(12, 40)), rng.normal(size=40)
    left = left_by_several(r @ r, A @ r, np.sum(A**2, axis=1), lambda k: A @ A[k], 3)
    chosen = []
    for n in range(1, 4):  # the same choice by least squares
        tries = [[*chosen, k] for k in range(len(A)) if k not in chosen]
        rests = [np.linalg.lstsq(A[t].T, r, rcond=None)[1][0] for t in tries]
        chosen = tries[int(np.argmin(rests))]
        assert left[n] == pytest.approx(min(rests), rel=1e-9)
    assert left[0] == r @ r


def test_twins_of_a_column_and_columns_without_power_say_nothing_more():
    one = np.array([1.0, 2.0, 3.0])
    A, r = np.stack([one, one * (1 + 1e-9), 0 * one, np.nan * one]), np.array([1.0, 0.0, -1.0])
    left = left_by_several(r @ r, A @ r, np.sum(A**2, axis=1), lambda k: A @ A[k], 3)
    assert left[1:] == pytest.approx(2.0 - (one @ r) ** 2 / (one @ one))


@pytest.mark.slow
def test_the_screen_in_blocks_is_the_screen_at_once(monkeypatch):
    simulator, X, y, groups = recorded(lambda x: -0.5 * x[0] ** 3, 0.005)
    found = []
    for at_once in (_candidate_columns.AT_ONCE, 1):
        monkeypatch.setattr(_candidate_columns, "AT_ONCE", at_once)
        search = searched(simulator, X, y, groups, first=True)
        found.append(search.first_screen)
    assert [start.effect.key for start in found[0].starts] == [start.effect.key for start in found[1].starts]
    assert np.allclose([s.white for s in found[0].starts], [s.white for s in found[1].starts], rtol=1e-8, atol=1e-6)


def searched(simulator, X, y, groups, first=False, n_jobs=1):
    """A search over a part of the catalogue, its report left undecided; ``first``: the screen of the null alone."""
    kept = []

    class Watched(OdeSearch):
        def look_for_one(self):
            kept.append(self)
            if not first:
                return super().look_for_one()
            self.base_and_screen(self.fitted_null.candidate)
            raise KeyboardInterrupt

        def look_for_more(self):
            super().look_for_more()
            raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch, pytest.warns(UserWarning, match="interrupted"):
        patch.setattr("sksurrogate.gap._begin.OdeSearch", Watched)
        GapDiagnoser(simulator, effects=FEW, n_jobs=n_jobs).fit(X, y, groups=groups)
    return kept[0]


@pytest.mark.slow
def test_no_third_name_where_two_close_the_gap_and_nothing_leads_to_the_noise():
    def wide(x):  # dry friction with a width, a hardening spring, and ripples that no law of the catalogue has
        return -0.5 * np.tanh(x[1] / 0.1) - 0.4 * x[0] ** 3 + 0.02 * np.sin(9 * x[0]) * np.cos(7 * x[1])

    search = searched(*recorded(wide, 1e-6))
    assert max(len(keys) for keys in search.fitted) == 2
    assert {effect.name for effect in search.final.effects} == {"coulomb_friction", "cubic_stiffness"}


@pytest.mark.slow
def test_a_small_second_effect_that_leads_to_the_noise_is_named_beside_a_large_one():
    def both(x):
        return -0.8 * x[0] ** 3 - 0.02 * x[1] * np.abs(x[1])

    search = searched(*recorded(both, 1e-5))
    assert {effect.name for effect in search.final.effects} == {"cubic_stiffness", "quadratic_drag"}


@pytest.mark.slow
def test_no_second_name_is_fitted_where_none_could_close_half_of_the_power():
    def cogging(x):  # a ripple over the position, of which no sum of the effects has half
        return 3.0 * np.sin(20.0 * x[0])

    search = searched(*recorded(cogging, 0.005))
    null = search.null.candidate
    assert search.first_screen.left_by[-1] > search.most_left_cost > 0.2 * null.fit.cost
    assert max(len(keys) for keys in search.fitted) == 1


def test_beside_a_simulator_at_the_noise_only_the_likeliest_are_fitted():
    def nothing(x):
        return 0.0

    search = searched(*recorded(nothing, 0.01))
    assert not search.final.effects and len(search.first_round) <= 3 < len(FEW)


def test_fits_side_by_side_are_the_fits_one_after_the_other():
    """The first comes to the noise, and none of the others may: they are fitted by neither."""
    case = recorded(lambda x: -0.5 * x[0] ** 3, 0.005, rows=60)
    alone = searched(*case)
    with parallel_config("threading"):
        beside = searched(*case, n_jobs=2)
    assert [one.keys for one in beside.first_round] == [one.keys for one in alone.first_round]
    assert {k: one.fit.cost for k, one in beside.fitted.items()} == {k: one.fit.cost for k, one in alone.fitted.items()}
