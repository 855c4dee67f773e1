"""The smallest and the largest value that each parameter of an estimator takes."""

from numbers import Integral

import pytest
from sklearn.utils._param_validation import Interval, InvalidParameterError, validate_parameter_constraints

from sksurrogate.compose import HybridRegressor, RecursivePredictor
from sksurrogate.features import (
    FourierFeatures,
    GaussianFeatures,
    HeavisideFeatures,
    Interpolator,
    OutlierFilter,
    SplineFeatures,
)
from sksurrogate.gap import GapDiagnoser
from sksurrogate.linear import NonlinearBasisRegressor, PCRRegressor, PenalizedRegressor, SparseRegressor
from sksurrogate.neural import FNNRegressor
from sksurrogate.physics import CalibratedSimulator

TINY = 1e-9
#: Values that are taken, and values just beyond that are not.
COUNT, COUNT_OR_ZERO, SIZE, SIZE_OR_ZERO, SHARE = (
    ([1, 9], [0, -1]),
    ([0, 9], [-1]),
    ([TINY, 1e9], [0.0, -TINY]),
    ([0.0, 1e9], [-TINY]),
    ([TINY, 1 - TINY], [0.0, 1.0]),
)
BOUNDS = {
    CalibratedSimulator: {"confidence": SHARE, "max_iter": COUNT},
    FNNRegressor: {
        "hidden_layer_sizes": COUNT, "alpha": SIZE_OR_ZERO, "learning_rate": SIZE, "batch_size": COUNT, "max_epochs": COUNT,
        "n_starts": COUNT, "tol": SIZE_OR_ZERO, "validation_fraction": SHARE, "n_iter_no_change": COUNT,
        "closeness": SIZE_OR_ZERO, "slope": SIZE_OR_ZERO, "curvature": SIZE_OR_ZERO, "momentum": ([0.0, 1 - TINY], [-TINY, 1.0]),
    },
    FourierFeatures: {"n_harmonics": COUNT, "period": SIZE},
    GapDiagnoser: {"tolerance": SHARE, "time_limit": SIZE, "clock_offset": SIZE_OR_ZERO},
    GaussianFeatures: {"centers": COUNT, "width": SIZE},
    HeavisideFeatures: {"thresholds": COUNT},
    HybridRegressor: {"n_lags": COUNT, "shrinkage": SIZE_OR_ZERO, "fade": SIZE_OR_ZERO},
    Interpolator: {"max_gap": COUNT},
    NonlinearBasisRegressor: {
        "n_basis": COUNT, "degree": COUNT, "alpha": SIZE_OR_ZERO, "n_starts": COUNT, "max_iter": COUNT,
    },
    OutlierFilter: {"window": ([5, 9], [4]), "threshold": SIZE},
    PCRRegressor: {"block_size": COUNT, "n_components": ([1, 9, TINY, 1 - TINY], [0, 0.0, 1.0])},
    PenalizedRegressor: {"block_size": COUNT, "alpha": SIZE_OR_ZERO},
    RecursivePredictor: {
        "input_lags": COUNT_OR_ZERO, "output_lags": COUNT_OR_ZERO, "horizon": COUNT, "alpha": SIZE_OR_ZERO,
        "stability": SIZE_OR_ZERO, "n_starts": COUNT,
    },
    SparseRegressor: {"block_size": COUNT, "threshold": SIZE_OR_ZERO, "max_terms": COUNT_OR_ZERO},
    SplineFeatures: {"n_knots": ([2, 9], [1]), "degree": COUNT_OR_ZERO},
}  # fmt: skip
CASES = [(kind, name, *values) for kind, bounds in BOUNDS.items() for name, values in bounds.items()]


@pytest.mark.parametrize(
    "kind, name, taken, refused", CASES, ids=[f"{kind.__name__}-{name}" for kind, name, *_ in CASES]
)
def test_a_parameter_ends_where_it_should(kind, name, taken, refused):
    constraints = {name: kind._parameter_constraints[name]}
    for value in taken:
        validate_parameter_constraints(constraints, {name: value}, kind.__name__)
    for value in refused:
        with pytest.raises(InvalidParameterError, match=f"The '{name}' parameter of {kind.__name__} must be"):
            validate_parameter_constraints(constraints, {name: value}, kind.__name__)


@pytest.mark.parametrize("kind", BOUNDS, ids=lambda kind: kind.__name__)
def test_every_parameter_with_bounds_is_in_the_list(kind):
    bounded = {
        name
        for name, constraints in kind._parameter_constraints.items()
        if isinstance(constraints, list) and any(isinstance(c, Interval) for c in constraints)
    }
    assert set(BOUNDS[kind]) == bounded
    whole = {
        name
        for name in bounded
        if any(isinstance(c, Interval) and c.type is Integral for c in kind._parameter_constraints[name])
    }
    for name in whole - {"n_components"}:
        with pytest.raises(InvalidParameterError, match=name):
            validate_parameter_constraints({name: kind._parameter_constraints[name]}, {name: 1.5}, kind.__name__)
