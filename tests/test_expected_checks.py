"""A third party's check_estimator passes with the failures that are declared."""

import numpy as np
import pandas as pd
import pytest
from sklearn.utils._param_validation import validate_parameter_constraints
from sklearn.utils.estimator_checks import check_estimator

from sksurrogate.features import LagEmbedding, SplineFeatures
from sksurrogate.gap import GapDiagnoser
from sksurrogate.linear import LaggedLinearRegressor, PCRRegressor
from sksurrogate.physics import ODESimulator
from sksurrogate.testing import expected_failed_checks


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("estimator", [LaggedLinearRegressor(), LagEmbedding()], ids=repr)
def test_check_estimator_passes_with_the_declared_failures(estimator):
    declared = expected_failed_checks(estimator)
    done = check_estimator(estimator, expected_failed_checks=declared, on_fail="raise", on_skip=None)
    assert len(done) > 20
    assert {one["check_name"] for one in done if one["status"] == "xfail"} <= set(declared)


def test_estimators_without_time_declare_nothing():
    assert expected_failed_checks(PCRRegressor()) == expected_failed_checks(SplineFeatures()) == {}


def test_a_diagnoser_keeps_the_habits_of_scikit_learn():
    plant = ODESimulator(lambda t, x, u, p: [u[0] - x[0]], states=["y"], inputs=["u"], outputs=["y"], params={}, dt=0.1)
    rng = np.random.default_rng(0)
    X = pd.DataFrame({"u": np.repeat(rng.normal(size=12), 10)})
    y = plant.simulate(X.to_numpy()) + 0.3 + 0.01 * rng.normal(size=(120, 1))
    diagnoser = GapDiagnoser(plant, effects=["sensor_bias"], random_state=0, n_jobs=1).fit(X, y)
    assert diagnoser.n_features_in_ == 1 and list(diagnoser.feature_names_in_) == ["u"]
    settings = diagnoser.get_params(deep=False)
    known = {name: settings[name] for name in GapDiagnoser._parameter_constraints}
    validate_parameter_constraints(GapDiagnoser._parameter_constraints, known, "GapDiagnoser")
    with pytest.raises(ValueError, match="tolerance"):
        validate_parameter_constraints(GapDiagnoser._parameter_constraints, {**known, "tolerance": 2.0}, "GapDiagnoser")
