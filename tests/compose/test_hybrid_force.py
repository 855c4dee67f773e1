"""Any regressor inside the plant: the force that the plant lacks is found along the runs, then learned."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.ensemble import RandomForestRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, WhiteKernel
from sklearn.model_selection import GridSearchCV, GroupKFold
from sklearn.neighbors import KNeighborsRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sksurrogate.compose import HybridRegressor
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.smoother import smooth
from sksurrogate.physics import ODESimulator, StepSimulator
from sksurrogate.runs import stack_runs

FOREST = RandomForestRegressor(15, min_samples_leaf=3, random_state=0)


def oscillator(t, x, u, p):
    return x[1], u[0] + p["bend"] * u[0] ** 2 - x[0] - p["cubic"] * x[0] ** 3 - 0.4 * x[1]


def plant(outputs=("q",), **changes):
    params = {"bend": 0.0, "cubic": 0.0, **changes}
    return ODESimulator(oscillator, states=["q", "v"], inputs=["f"], outputs=list(outputs), params=params, dt=0.05)


def runs(simulator, n_runs=6, n=120, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.uniform(-1.5, 1.5, size=n // 10), 10)[:, None] for _ in range(n_runs)]
    Y = [simulator.simulate(u) for u in U]
    return stack_runs(U, [(y + noise * rng.normal(size=y.shape)).squeeze() for y in Y])


def closed(hybrid, truth, model, seed=1):
    """Share of the error of the model alone that is gone on fresh runs."""
    X, y, groups = runs(truth, seed=seed)
    alone = np.concatenate([model.simulate(X[groups == k]).squeeze() for k in np.unique(groups)])
    return 1 - np.std(hybrid.predict(X, groups=groups) - y) / np.std(alone - y)


def gaussian_process():
    return make_pipeline(StandardScaler(), GaussianProcessRegressor(RBF() + WhiteKernel(0.003), optimizer=None))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("residual", "least"),
    [
        (FOREST, 0.8),
        (gaussian_process(), 0.8),
        (
            make_pipeline(
                StandardScaler(),
                MLPRegressor(hidden_layer_sizes=(20,), solver="lbfgs", alpha=0.1, max_iter=300, random_state=0),
            ),
            0.8,
        ),
        (make_pipeline(StandardScaler(), KNeighborsRegressor(7)), 0.7),
    ],
    ids=["forest", "gp", "mlp", "knn"],
)
def test_a_missing_spring_is_learned_behind_an_unmeasured_speed(residual, least):
    X, y, groups = runs(plant(cubic=0.5), noise=0.003)
    hybrid = HybridRegressor(plant(), residual, "dynamics").fit(X, y, groups=groups)
    assert hybrid.correction_.targets == (1,)  # dq/dt = v is an identity
    assert closed(hybrid, plant(cubic=0.5), plant()) > least
    assert type(hybrid.residual_) is type(residual)
    again = pickle.loads(pickle.dumps(hybrid))
    np.testing.assert_array_equal(again.predict(X, groups=groups), hybrid.predict(X, groups=groups))
    np.testing.assert_array_equal(
        clone(hybrid).fit(X, y, groups=groups).predict(X, groups=groups), again.predict(X, groups=groups)
    )


@pytest.mark.slow
def test_the_force_is_that_of_the_planted_term():
    X, y, groups = runs(plant(cubic=0.5), n_runs=8, n=200)
    hybrid = HybridRegressor(plant(), gaussian_process(), "dynamics", fade=float("inf")).fit(X, y, groups=groups)
    q = np.linspace(-0.8, 0.8, 9)
    at = np.stack([q, np.zeros(9)]), np.zeros((1, 9))
    np.testing.assert_allclose(hybrid.correction_.force(*at)[0], -0.5 * q**3, atol=0.03)
    np.testing.assert_allclose(hybrid.correction_.rhs(0.0, *at), np.stack([0 * q, -q - 0.5 * q**3]), atol=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("residual", [FOREST, gaussian_process()], ids=["forest", "gp"])
def test_a_bent_input_is_learned_by_the_input_form(residual):
    X, y, groups = runs(plant(bend=0.3))
    hybrid = HybridRegressor(plant(), residual, "input").fit(X, y, groups=groups)
    assert closed(hybrid, plant(bend=0.3), plant()) > 0.75


@pytest.mark.slow
def test_all_states_measured_one_step_is_the_step_of_the_free_run():
    truth, model = plant(("q", "v"), cubic=0.5), plant(("q", "v"))
    X, y, groups = runs(truth)
    hybrid = HybridRegressor(model, FOREST, "dynamics").fit(X, y, groups=groups)
    assert closed(hybrid, truth, model) > 0.8
    one = hybrid.predict_one_step(X, y, groups=groups)
    free = hybrid.predict(X[:2], y0=y[:1], groups=groups[:2])
    np.testing.assert_allclose(one[1], free[1], rtol=1e-12)
    assert np.isnan(one[0]).all() and np.nanstd(one - y) < 0.01


@pytest.mark.slow
def test_a_regressor_that_predicts_nothing_leaves_the_physics_alone():
    class Nothing(KNeighborsRegressor):
        def predict(self, X):
            return np.zeros(len(X))

    X, y, groups = runs(plant(cubic=0.5))
    hybrid = HybridRegressor(plant(), Nothing(), "dynamics").fit(X, y, groups=groups)
    alone = np.concatenate([plant().simulate(X[groups == k])[:, 0] for k in range(6)])
    np.testing.assert_allclose(hybrid.predict(X, groups=groups), alone, atol=1e-6)


@pytest.mark.slow
def test_a_grid_over_the_residual_and_more_data():
    X, y, groups = runs(plant(cubic=0.5), n=80)
    grid = GridSearchCV(
        HybridRegressor(plant(), KNeighborsRegressor(), "dynamics", run=1),
        {"residual__n_neighbors": [5, 200], "form": ["dynamics", "input"]},
        cv=GroupKFold(2),
    ).fit(np.column_stack([X, groups]), y, groups=groups)
    assert grid.best_params_ == {"residual__n_neighbors": 5, "form": "dynamics"}
    half = HybridRegressor(plant(), KNeighborsRegressor(), "dynamics").partial_fit(
        X[groups < 2], y[groups < 2], groups=groups[groups < 2]
    )
    # neighbours in two runs of 80 rows do not surely help on rows left out
    assert half.residual_.n_samples_fit_ < 160 and closed(half, plant(cubic=0.5), plant()) > -1e-5
    half.partial_fit(X[groups >= 2], y[groups >= 2], groups=groups[groups >= 2])
    whole = HybridRegressor(plant(), KNeighborsRegressor(), "dynamics").fit(X, y, groups=groups)
    assert half.residual_.n_samples_fit_ == whole.residual_.n_samples_fit_
    np.testing.assert_allclose(half.shrinkage_, whole.shrinkage_)


@pytest.mark.slow
def test_the_map_of_a_step_function_is_corrected():
    def make(bend):
        def step(t, x, u, p, dt):
            return [0.8 * x[0] + u[0] + bend * x[0] ** 2]

        return StepSimulator(step, states=["x"], inputs=["u"], outputs=["x"])

    rng = np.random.default_rng(0)
    X, groups = 0.3 * rng.normal(size=(400, 1)), np.repeat([0, 1, 2, 3], 100)
    y = np.concatenate([make(0.03).simulate(X[groups == k])[:, 0] for k in range(4)])
    hybrid = HybridRegressor(make(0.0), gaussian_process(), form="dynamics").fit(X, y, groups=groups)
    np.testing.assert_allclose(hybrid.predict(X, groups=groups), y, atol=0.01)


@pytest.mark.slow
def test_far_outside_the_data_the_physics_is_left_alone():
    X, y, groups = runs(plant(cubic=0.5))
    hybrid = HybridRegressor(plant(), FOREST, "dynamics").fit(X, y, groups=groups)
    assert np.all(np.abs(hybrid.correction_.force(np.array([[50.0], [0.0]]), np.zeros((1, 1)))) < 1e-100)
    wild = hybrid.predict(30.0 * np.ones((40, 1)))
    assert np.all(np.isfinite(wild)) and hybrid.validity(30.0 * np.ones((40, 1)))[-1] < 1e-3


def test_what_has_no_slopes_is_not_shot():
    X, y, groups = runs(plant(cubic=0.5), n_runs=2)
    with pytest.raises(
        DataError, match='loss="shooting" with form="dynamics" needs slopes of the residual, and RandomForestRegressor'
    ):
        HybridRegressor(plant(), FOREST, "dynamics", loss="shooting").fit(X, y, groups=groups)


@pytest.mark.slow
def test_the_export_of_a_net_inside_equals_predict():
    X, y, groups = runs(plant(cubic=0.5))
    residual = make_pipeline(
        StandardScaler(), MLPRegressor(hidden_layer_sizes=(8,), solver="lbfgs", alpha=1.0, max_iter=400, random_state=0)
    )
    for form in ("dynamics", "input"):
        hybrid = HybridRegressor(plant(), residual, form).fit(X, y, groups=groups)
        graph = hybrid.to_graph()
        expected, x, found = hybrid.predict(X[groups == 1]), graph.initial, []
        for u in X[groups == 1]:
            at = graph(x=x, u=u)
            found.append(at["y"][0])
            x = at["x_next"]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_the_share_of_an_allowance_is_that_of_its_sample():
    class Walk:
        """x[k+1] = x[k], measured."""

        def __call__(self, x):
            return x

        def outputs(self, x):
            return x

    y = np.concatenate([np.zeros(20), np.ones(20)])[None]
    share = np.full((1, 40), 1e-3)
    share[0, 19] = 1.0  # the only sample in which it may move
    noisy = y + 0.01 * np.random.default_rng(0).normal(size=y.shape)
    start, args = np.array([0]), (np.array([0.01]), noisy.copy(), np.ones(1))
    found = smooth(Walk(), noisy, start, *args, share=share).x
    np.testing.assert_allclose(found[0, :20], noisy[0, :20].mean(), atol=1e-3)
    np.testing.assert_allclose(found[0, 20:], noisy[0, 20:].mean(), atol=1e-3)
    same = smooth(Walk(), noisy, start, *args, share=np.ones((1, 40))).x
    np.testing.assert_array_equal(same, smooth(Walk(), noisy, start, *args).x)
