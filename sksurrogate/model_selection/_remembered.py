"""Fits that are kept on disk, so that a search that was killed goes on where it was."""

from __future__ import annotations

from os import PathLike
from typing import Any

from sklearn.base import BaseEstimator, MetaEstimatorMixin, _fit_context, clone
from sklearn.utils import get_tags
from sklearn.utils._param_validation import HasMethods
from sklearn.utils.metaestimators import available_if
from sklearn.utils.validation import check_is_fitted, check_memory

from sksurrogate._fingerprint import fingerprint


def _fit(value: str, estimator: Any, X: Any, y: Any, how: dict[str, Any]) -> Any:
    """A fitted estimator; what joblib keeps, under the ``value`` of estimator and ``how``."""
    return estimator.fit(X, y, **how)


def _has(name: str) -> Any:
    """The wrapped estimator has the method."""

    def check(self: Any) -> bool:
        getattr(self.estimator_ if hasattr(self, "estimator_") else self.estimator, name)
        return True

    return check


class Remembered(MetaEstimatorMixin, BaseEstimator):
    """A predictor whose fits are kept on disk: the same estimator and data are fitted once.

    If a search is interrupted, for example by a power cut or a cluster's time limit, start it again with the same line: finished
    fits are read, the others are made. An estimator is the same if its parameters are, together with the code of functions and of
    your own classes in them, their closures and the globals that they read. (Transformers are kept by scikit-learn's
    ``Pipeline(memory=...)``.)

    Parameters
    ----------
    estimator : estimator with ``predict``
        Give it a ``random_state`` where it draws numbers: one draw is remembered.
    memory : str, path or joblib.Memory, optional
        Folder of the fits. They are pickles, so no one else should be able to write there. None: nothing is kept.

    Attributes
    ----------
    estimator_ : estimator
        The fitted one. All its other attributes, ``coef_`` for example, are there too.

    Examples
    --------
    >>> import tempfile
    >>> from sklearn.linear_model import Ridge
    >>> from sklearn.model_selection import GridSearchCV
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> from sksurrogate.model_selection import Remembered
    >>> X, y, runs = make_reactor_runs(3, 40, random_state=0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     search = GridSearchCV(Remembered(Ridge(), folder), {"estimator__alpha": [0.1, 1.0]}).fit(X, y)
    ...     again = GridSearchCV(Remembered(Ridge(), folder), {"estimator__alpha": [0.1, 1.0]}).fit(X, y)   # reads
    >>> bool(search.best_score_ == again.best_score_)
    True
    """

    _parameter_constraints = {
        "estimator": [HasMethods(["fit", "predict"])],
        "memory": [None, str, PathLike, HasMethods(["cache"])],
    }

    def __init__(self, estimator: Any, memory: Any = None):
        self.estimator = estimator
        self.memory = memory

    @_fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any = None, groups: Any = None, **fit_params: Any) -> Remembered:
        """Fit, or read the fit of the same parameters and data.

        Parameters
        ----------
        X : array-like (n_samples, n_features)
        y : array-like, optional
        groups : array-like (n_samples,), optional
            Handed on where it is given.
        **fit_params
            Handed on.

        Returns
        -------
        self

        Raises
        ------
        DataError
            ``memory`` is given, and the estimator holds something without a value, a connection for example.
        """
        how = {**({} if groups is None else {"groups": groups}), **fit_params}
        memory = check_memory(str(self.memory) if isinstance(self.memory, PathLike) else self.memory)
        estimator = clone(self.estimator)
        if self.memory is None:
            self.estimator_ = estimator.fit(X, y, **how)
        else:  # joblib alone knows a function by its name: that of an edited file would pass for the one before
            value = fingerprint((estimator, how), "with memory=, estimator")
            self.estimator_ = memory.cache(_fit, ignore=["estimator", "how"])(value, estimator, X, y, how)
        return self

    def __getattr__(self, name: str) -> Any:
        """Learned attributes of the wrapped estimator."""
        if name.startswith("__") or not name.endswith("_") or "estimator_" not in vars(self):
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")
        return getattr(vars(self)["estimator_"], name)

    def __sklearn_is_fitted__(self) -> bool:
        return "estimator_" in vars(self)

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        inner = get_tags(self.estimator)
        for part in ("estimator_type", "target_tags", "classifier_tags", "regressor_tags"):
            setattr(tags, part, getattr(inner, part))
        tags.input_tags, tags.non_deterministic = inner.input_tags, inner.non_deterministic
        return tags

    def _ask(self, method: str, *args: Any, **how: Any) -> Any:
        """A method of the fitted estimator."""
        check_is_fitted(self)
        return getattr(self.estimator_, method)(*args, **{k: v for k, v in how.items() if v is not None})

    @property
    def run(self) -> Any:
        """Where the wrapped estimator reads the run of a row."""
        return getattr(self.estimator, "run", None)

    def predict(self, X: Any, y0: Any = None, groups: Any = None) -> Any:
        """As the wrapped estimator does.

        Parameters
        ----------
        X : array-like (n_samples, n_features)
        y0, groups : array-like, optional
            Handed on where they are given.

        Returns
        -------
        ndarray
        """
        return self._ask("predict", X, y0=y0, groups=groups)

    @available_if(_has("score"))
    def score(self, X: Any, y: Any = None, sample_weight: Any = None, groups: Any = None) -> float:
        """As the wrapped estimator does.

        Parameters
        ----------
        X : array-like (n_samples, n_features)
        y : array-like, optional
        sample_weight, groups : array-like (n_samples,), optional

        Returns
        -------
        float
        """
        return self._ask("score", X, y, sample_weight=sample_weight, groups=groups)
