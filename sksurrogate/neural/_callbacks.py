"""Callbacks of scikit-learn 1.9 (progress bars, scores on the way, a stop by the user); older versions have none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sksurrogate.neural._network import Layers
from sksurrogate.neural._problems import Rows

try:
    from sklearn.callback import CallbackSupportMixin, with_callbacks
except ImportError:  # scikit-learn 1.8

    class CallbackSupportMixin:  # type: ignore[no-redef]
        """Stands in for the mixin of scikit-learn 1.9."""

    def with_callbacks(method: Callable) -> Callable:
        """Stands in for the decorator of scikit-learn 1.9."""
        return method


class Tasks:
    """Reports a fit, and each of its steps, to the callbacks of an estimator.

    ``X, y``: as given to fit: some callbacks score on them.
    ``rows``: scaling, with which layers are written for raw inputs.
    """

    def __init__(self, estimator: Any, X: Any, y: Any, rows: Rows):
        self.estimator, self.X, self.y, self.rows = estimator, X, y, rows
        self.context = estimator._init_callback_context(max_subtasks=None)
        self.context.call_on_fit_task_begin(estimator=estimator, X=X, y=y)

    @classmethod
    def of(cls, estimator: Any, X: Any, y: Any, rows: Rows) -> Tasks | None:
        """None where the estimator has no callbacks: no cost then."""
        return cls(estimator, X, y, rows) if getattr(estimator, "_skl_callbacks", None) else None

    def step(self, layers: Layers) -> bool:
        """One step is done; True when a callback wants to stop."""
        rows = self.rows
        raw = layers.unscaled(rows.mean, rows.scale, rows.shift, rows.gain)
        task = self.context.subcontext(task_name="step")
        task.call_on_fit_task_begin(estimator=self.estimator, X=self.X, y=self.y)
        fitted = {"_layers": raw, "coefs_": list(raw.weights), "intercepts_": list(raw.biases)}
        return bool(
            task.call_on_fit_task_end(
                estimator=self.estimator, X=self.X, y=self.y, reconstruction_attributes=lambda: fitted
            )
        )

    def end(self) -> None:
        """The fit is done."""
        self.context.call_on_fit_task_end(estimator=self.estimator, X=self.X, y=self.y)
