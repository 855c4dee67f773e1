"""Checks of scikit-learn that estimators of time series cannot pass, with the reason."""

from __future__ import annotations

from typing import Any

from sksurrogate._dynamic import FreeRunMixin
from sksurrogate.features._lag import LagEmbedding
from sksurrogate.features._outliers import OutlierFilter
from sksurrogate.linear._lagged import LaggedLinearRegressor
from sksurrogate.physics._calibrate import CalibratedSimulator

#: Check -> why it does not hold where rows are in time order.
IN_TIME_ORDER = {
    "check_methods_sample_order_invariance": "rows are in time order: the past of a row is the rows before it",
    "check_methods_subset_invariance": "a subset of the rows has another past",
}


def expected_failed_checks(estimator: Any) -> dict[str, str]:
    """Checks that an estimator of this package fails by design, for scikit-learn's ``check_estimator``.

    Parameters
    ----------
    estimator : estimator

    Returns
    -------
    dict of str
        Name of the check -> reason; empty where it passes all.

    Examples
    --------
    >>> from sklearn.utils.estimator_checks import check_estimator
    >>> from sksurrogate.linear import LaggedLinearRegressor
    >>> from sksurrogate.testing import expected_failed_checks
    >>> model = LaggedLinearRegressor()
    >>> _ = check_estimator(model, expected_failed_checks=expected_failed_checks(model), on_skip=None)  # doctest: +SKIP
    >>> sorted(expected_failed_checks(model))
    ['check_methods_sample_order_invariance', 'check_methods_subset_invariance']
    """
    time_aware = (FreeRunMixin, LagEmbedding, LaggedLinearRegressor, OutlierFilter, CalibratedSimulator)
    return dict(IN_TIME_ORDER) if isinstance(estimator, time_aware) else {}
