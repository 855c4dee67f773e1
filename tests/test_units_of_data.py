"""No answer depends on the units of the data: numbers that are so many times as large give results that are so many times as large."""

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sksurrogate.compose import HybridRegressor, RecursivePredictor
from sksurrogate.effects import CATALOGUE
from sksurrogate.exceptions import SimulatorError
from sksurrogate.features import SplineFeatures
from sksurrogate.gap.decide._ode_access import has_kink
from sksurrogate.linear import Bounds, Monotone, PenalizedRegressor, Ridge
from sksurrogate.model_selection import ConformalFreeRun, scan_orders
from sksurrogate.physics import ODESimulator, TableSimulator, linearise, steady_state

RUNS = np.repeat(np.arange(6), 60)


def oscillator(units, cubic=0.0):
    """Position and velocity of a driven spring, each in a unit of its own."""

    def rhs(t, x, u, p):
        q, v = x[0] / units[0], x[1] / units[1]
        return v * units[0], (u[0] - 4 * q - 0.8 * v - cubic * q**3) * units[1]

    return ODESimulator(rhs, states=["q", "v"], inputs=["f"], outputs=["q", "v"], params={}, dt=0.1)


def measured(units, seed=0):
    """Inputs and noisy outputs of six runs of the spring that hardens."""
    rng = np.random.default_rng(seed)
    U = np.concatenate([np.repeat(6 * rng.normal(size=(8, 1)), 8, axis=0)[:60] for _ in range(6)])
    plant = oscillator((1.0, 1.0), cubic=2.0)
    clean = np.concatenate([plant.simulate(U[r == RUNS]) for r in range(6)])
    return U, (clean + 0.01 * rng.normal(size=clean.shape)) * units


# powers of two: the arithmetic is the same to the last digit
@pytest.mark.parametrize("units", [(2.0**20, 1.0), (1.0, 2.0**-30), (2.0**-30, 2.0**-30)])
def test_a_hybrid_is_the_same_in_every_unit_of_an_output(units):
    def found(units):
        U, y = measured(np.array(units))
        hybrid = HybridRegressor(oscillator(units)).fit(U, y, groups=RUNS)
        return hybrid.predict(U[:60], y0=y[: hybrid.n_initial_]) / units, hybrid.shrinkage_

    plain, share = found((1.0, 1.0))
    other, other_share = found(units)
    assert np.all(share > 0)
    np.testing.assert_allclose(other, plain, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(other_share, share)


@pytest.mark.parametrize(("times", "plus"), [(1.0, 1e5), (1e-15, 0.0), (200.0, 101325.0)])
def test_lags_depend_neither_on_the_unit_nor_on_its_origin(times, plus):
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(600, 1)), np.zeros(600)
    for t in range(2, 600):
        y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + X[t - 1, 0] + 0.1 * rng.normal()
    plain = scan_orders(X, y, max_output_lags=4, max_input_lags=3)
    for scan in (
        scan_orders(X, times * y + plus, max_output_lags=4, max_input_lags=3),
        scan_orders(times * X + plus, y, max_output_lags=4, max_input_lags=3),
    ):
        assert (scan.best_output_lags, scan.best_input_lags) == (2, 1)
        np.testing.assert_allclose(scan.free_run, plain.free_run, rtol=1e-4)
        np.testing.assert_allclose(scan.one_step, plain.one_step, rtol=1e-4)


def test_an_output_in_a_small_unit_has_the_interval_of_a_large_one():
    def half_widths(units):
        U, y = measured(np.array(units))
        model = RecursivePredictor(make_pipeline(StandardScaler(), LinearRegression()), output_lags=2, input_lags=1)
        found = ConformalFreeRun(model, coverage=0.7, random_state=0).fit(U, y, groups=RUNS)
        low, high = found.predict_interval(U[:60], y0=y[:2])
        return (high - low) / units

    np.testing.assert_allclose(half_widths((1.0, 1e-14)), half_widths((1.0, 1.0)), rtol=1e-6)


def test_uneven_stamps_of_nanoseconds_are_not_taken_for_even_ones():
    rng = np.random.default_rng(0)
    U, t = rng.normal(size=(40, 1)), np.cumsum(rng.uniform(0.02, 0.18, 40))

    def run(unit):
        def rhs(t, x, u, p):
            return x[1] / unit, (u[0] - 4 * np.sin(x[0]) - 0.5 * x[1]) / unit

        plant = ODESimulator(rhs, states=["q", "v"], inputs=["u"], outputs=["q"], params={}, dt=0.1 * unit)
        return plant.simulate(U, t=t * unit)

    np.testing.assert_allclose(run(1e-9), run(1.0), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("method", ["auto", "Radau"])
@pytest.mark.parametrize("unit", [1e-12, 1e6])
def test_a_stiff_plant_is_integrated_as_well_in_every_unit(method, unit):
    def run(unit, method=method):
        def rhs(t, x, u, p):
            slow, fast = x[0] / unit, x[1] / unit
            return unit * (fast - np.tanh(slow)), unit * 5000 * (u[0] - fast - 0.1 * fast**3)

        plant = ODESimulator(
            rhs, states=["q", "v"], inputs=["u"], outputs=["q"], params={}, dt=0.1, method=method, x0=[0.3 * unit, 0.0]
        )
        return plant.simulate(U) / unit

    U = np.repeat(np.random.default_rng(0).normal(size=(6, 1)), 5, axis=0)
    np.testing.assert_allclose(run(unit), run(1.0, "BDF"), atol=1e-6)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e3])
def test_a_pendulum_is_linearised_in_every_unit(unit):
    def rhs(t, x, u, p):
        return x[1], unit * (np.tanh(u[0] / unit) - 9 * np.sin(x[0] / unit)) - 0.5 * x[1]

    plant = ODESimulator(rhs, states=["q", "v"], inputs=["f"], outputs=["q"], params={}, dt=0.1)
    local = linearise(plant, [0.3 * unit, 0.0], [0.0])
    np.testing.assert_allclose(local.A, [[0.0, 1.0], [-9 * np.cos(0.3), -0.5]], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(local.B, [[0.0], [1.0]], rtol=1e-6)


def test_a_table_of_small_inputs_refuses_others():
    inputs, outputs = 1e-13 * np.random.default_rng(0).normal(size=(30, 1)), np.arange(30.0)[:, None]
    table = TableSimulator(inputs, outputs)
    np.testing.assert_array_equal(table.simulate(inputs[10:20]), outputs[10:20])
    with pytest.raises(SimulatorError):
        table.simulate(2 * inputs)


@pytest.mark.parametrize("force", [1.0, 1e-12])
def test_a_small_force_has_its_kink(force):
    assert has_kink(CATALOGUE["coulomb_friction"]("v", "v"), np.array([force]), 0.1)
    assert not has_kink(CATALOGUE["linear_loss"]("v", "v"), np.array([force]), 0.1)


@pytest.mark.parametrize("unit", [1e-12, 1e6])
def test_constraints_hold_in_every_unit(unit):
    rng = np.random.default_rng(0)
    x = np.sort(rng.uniform(0, 1, 60))[:, None]
    y, grid = np.sin(6 * x[:, 0]) + 0.1 * rng.normal(size=60), np.linspace(0, 1, 101)[:, None]

    def monotone(unit):
        model = PenalizedRegressor([Ridge()], [Monotone(grid)], alpha=1e-3, features=SplineFeatures(12, 3))
        return model.fit(x, y * unit).predict(grid) / unit

    assert np.diff(monotone(unit)).min() > -1e-9
    np.testing.assert_allclose(monotone(unit), monotone(1.0), rtol=1e-6, atol=1e-9)
    bounded = PenalizedRegressor(constraints=[Bounds(lower=0.0)]).fit(np.c_[x, -x + 0.1 * x**2] * unit, y + x[:, 0])
    assert np.all(bounded.coef_ >= 0)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e6])
def test_a_pendulum_rests_or_not_in_every_unit(unit):
    def rhs(t, x, u, p):
        return x[1], unit * (u[0] - 9 * np.sin(x[0] / unit)) - 0.5 * x[1]

    plant = ODESimulator(rhs, states=["q", "v"], inputs=["torque"], outputs=["q"], params={}, dt=0.1)
    np.testing.assert_allclose(steady_state(plant, [4.5]) / unit, [np.pi / 6, 0.0], rtol=1e-9, atol=1e-9)
    with pytest.raises(SimulatorError, match="no steady state"):
        steady_state(plant, [12.0])  # beyond the largest torque that it holds


def test_a_large_state_hides_no_other_that_moves():
    def rhs(t, x, u, p):
        return 1e6 - x[0], x[2], 0.5 - 0.4 * np.sin(x[1]) - 0.5 * x[2] + 0 * u[0]

    plant = ODESimulator(rhs, states=["p", "q", "v"], inputs=["f"], outputs=["q"], params={}, dt=0.1)
    with pytest.raises(SimulatorError, match="no steady state"):
        steady_state(plant, [0.0])
