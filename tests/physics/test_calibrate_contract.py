"""A calibrated simulator keeps scikit-learn's contract, also inside searches and hybrids."""

import numpy as np
import pytest
import sklearn
from sklearn.exceptions import DataConversionWarning
from sklearn.model_selection import GridSearchCV, GroupKFold
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.physics import BaseSimulator, CalibratedSimulator, ODESimulator
from sksurrogate.runs import stack_runs

ORDER = "row order matters to a free run"
EXPECTED = {"check_methods_sample_order_invariance": ORDER, "check_methods_subset_invariance": ORDER}


class AnyInputs(BaseSimulator):
    """``x[t+1] = a x[t] + g mean(u)``, for any number of inputs."""

    states, outputs = ("x",), ("x",)

    def __init__(self, params=None):
        self.params = params

    def get_params(self, deep=True):
        single = {f"params__{k}": v for k, v in (self.params or {}).items()} if deep else {}
        return {"params": self.params, **single}

    def set_params(self, **params):
        single = {k.removeprefix("params__"): v for k, v in params.items() if k != "params"}
        self.params = {**params.get("params", self.params), **single}
        return self

    def step(self, t, x, u, p, dt):
        return [p["a"] * x[0] + p["g"] * np.mean(np.asarray(u), axis=0)]

    def simulate(self, U, x0=None, t=None):
        x, out = 0.0 if x0 is None else float(np.ravel(x0)[0]), []
        for u in np.asarray(U, dtype=float):
            out.append(x)
            x = self.params["a"] * x + self.params["g"] * u.mean()
        return np.array(out)[:, None]


@parametrize_with_checks(
    [CalibratedSimulator(AnyInputs({"a": 0.5, "g": 1.0}))],
    expected_failed_checks=lambda estimator: EXPECTED,
    xfail_strict=True,
)
def test_sklearn_contract(estimator, check):
    check(estimator)


def decay(t, x, u, p):
    return [p["gain"] * u[0] - p["rate"] * x[0]]


def test_simulators_are_compared_in_a_search():
    def plant(**params):
        return ODESimulator(decay, states=["x"], inputs=["u"], outputs=["x"], params=params, dt=0.1)

    rng = np.random.default_rng(0)
    U = [np.repeat(rng.normal(size=8), 10)[:, None] for _ in range(4)]
    X, y, groups = stack_runs(U, [plant(gain=2.0, rate=0.5).simulate(u)[:, 0] for u in U])
    model = CalibratedSimulator(plant(gain=1.0, rate=1.0), ["gain"])
    with sklearn.config_context(enable_metadata_routing=True):
        search = GridSearchCV(model, {"simulator__params__rate": [0.5, 1.0]}, cv=GroupKFold(2)).fit(X, y, groups=groups)
    assert search.best_params_ == {"simulator__params__rate": 0.5}
    assert search.best_estimator_.params_["gain"] == pytest.approx(2.0, rel=1e-6)


def test_a_column_of_one_output_warns_as_elsewhere():
    X = np.sin(np.arange(40.0))[:, None]
    model = CalibratedSimulator(AnyInputs({"a": 0.5, "g": 1.0}))
    with pytest.warns(DataConversionWarning, match="column-vector y"):
        model.fit(X, AnyInputs({"a": 0.7, "g": 1.0}).simulate(X))
