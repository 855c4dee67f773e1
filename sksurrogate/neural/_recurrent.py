"""Recurrent networks (GRU, LSTM) of runs, trained through skorch on the free run."""

from __future__ import annotations

from functools import cache
from numbers import Integral, Real
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, _fit_context
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import check_is_fitted

from sksurrogate._dynamic import FreeRunMixin, lengthened
from sksurrogate.neural._settings import read_device
from sksurrogate.runs import Runs


class RecurrentRegressor(FreeRunMixin, BaseEstimator):
    """Recurrent network (GRU or LSTM) from the inputs to the outputs: a state-space model, which the paper does not treat.

    A small encoder turns the first rows of a run into the hidden state. After that only the inputs enter: outputs are never fed
    back. So the loss is the error of the free run, and a free run cannot diverge.

    Parameters
    ----------
    cell : {"gru", "lstm"}, default="gru"
    hidden_size : int, default=16
        Units of the hidden state.
    n_layers : int, default=1
    n_initial : int, default=5
        Rows of ``y0`` that the encoder sees, with their inputs.
    window : int, default=200
        Longer runs are trained in pieces of this many rows, each with an encoded state of its own.
    max_epochs : int, default=300
    batch_size : int, default=16
        Runs or pieces in a step.
    learning_rate : float, default=0.01
        Of Adam at the start; it falls to zero along a cosine.
    alpha : float, default=0.0
        Weight decay.
    init : "mean" or array (n_initial, n_outputs), default="mean"
        First rows where ``predict`` gets no ``y0``: mean of the training outputs.
    run : None, column name, int or "index"
        Where X says which run a row belongs to; ``groups`` wins.
    device : str, default="cpu"
        Of torch.
    net_params : dict, optional
        Further arguments of the skorch net, for example ``{"callbacks": [...]}``.
    random_state : int, RandomState or None

    Attributes
    ----------
    net_ : skorch.NeuralNet
        For standardised data; the first columns of the encoder are outputs, then inputs, row by row.
    loss_curve_ : list of float
        Mean squared error by epoch, in units of standardised outputs.
    free_run_rmse_ : float
        On the training runs.
    n_initial_ : int
    n_features_in_ : int

    Notes
    -----
    The cell sees u[t] and u[t-1] at row t. All randomness comes from ``random_state``; torch's own generator is left as
    it was.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 5.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> from sksurrogate.neural import RecurrentRegressor
    >>> X, y, groups = make_reactor_runs(8, 60, u_range=(0.1, 0.15), random_state=0)
    >>> model = RecurrentRegressor(hidden_size=8, max_epochs=5, random_state=0).fit(X, y, groups=groups)
    >>> model.predict(X, groups=groups).shape
    (480,)
    """

    _parameter_constraints: dict = {
        "cell": [StrOptions({"gru", "lstm"})],
        "hidden_size": [Interval(Integral, 1, None, closed="left")],
        "n_layers": [Interval(Integral, 1, None, closed="left")],
        "n_initial": [Interval(Integral, 1, None, closed="left")],
        "window": [Interval(Integral, 1, None, closed="left")],
        "max_epochs": [Interval(Integral, 1, None, closed="left")],
        "batch_size": [Interval(Integral, 1, None, closed="left")],
        "learning_rate": [Interval(Real, 0, None, closed="neither")],
        "alpha": [Interval(Real, 0, None, closed="left")],
        "init": [StrOptions({"mean"}), "array-like"],
        "run": [None, str, Integral],
        "device": [str],
        "net_params": [dict, None],
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        cell: str = "gru",
        hidden_size: int = 16,
        *,
        n_layers: int = 1,
        n_initial: int = 5,
        window: int = 200,
        max_epochs: int = 300,
        batch_size: int = 16,
        learning_rate: float = 0.01,
        alpha: float = 0.0,
        init: Any = "mean",
        run: Any = None,
        device: str = "cpu",
        net_params: Any = None,
        random_state: Any = None,
    ):
        self.cell = cell
        self.hidden_size = hidden_size
        self.n_layers = n_layers
        self.n_initial = n_initial
        self.window = window
        self.max_epochs = max_epochs
        self.batch_size = batch_size
        self.learning_rate = learning_rate
        self.alpha = alpha
        self.init = init
        self.run = run
        self.device = device
        self.net_params = net_params
        self.random_state = random_state

    @_fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any, groups: Any = None) -> RecurrentRegressor:
        """Train on the free run.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        n = self.n_initial_ = int(self.n_initial)
        runs = self._resolve(X, y, groups, reset=True, min_rows=n + 1)
        inputs = np.concatenate([run.X for run in runs])
        self.u_mean_, self.u_spread_ = inputs.mean(axis=0), inputs.std(axis=0)
        self.u_spread_[self.u_spread_ == 0] = 1.0
        pieces = []
        for run in runs:
            edges = np.arange(0, len(run) - n, max(self.window - n, 1))
            pieces += [(run.X[a : a + self.window], run.y[a : a + self.window]) for a in edges]
        data = self._sequences([u for u, _ in pieces], np.stack([part[:n] for _, part in pieces]))
        target = np.full((len(pieces), data["drive"].shape[1], len(self.y_mean_)), np.nan, dtype=np.float32)
        for r, (_, part) in enumerate(pieces):
            target[r, : len(part) - n] = (part[n:] - self.y_mean_) / self.y_spread_
        self._train(data, target)
        free = self._run_free([run.X for run in runs], np.stack([run.y[:n] for run in runs]))
        self._watch_training_runs(runs, free, "Lower learning_rate, or train longer.")
        errors = np.concatenate([part[n:] - run.y[n:] for part, run in zip(free, runs)])
        self.free_run_rmse_ = float(np.sqrt(np.mean(errors**2)))
        return self

    def predict(self, X: Any, y0: Any = None, groups: Any = None) -> np.ndarray:
        """Free run.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0 : array-like (n_initial, n_outputs) or (n_runs, n_initial, n_outputs), optional
            Outputs at the first rows of each run; without it ``init`` decides.
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)
        """
        check_is_fitted(self, "net_")
        runs = self._resolve(X, None, groups)
        out = self._run_free([run.X for run in runs], self._start_rows(y0, runs))
        self._refuse_far(runs, out, "Lower learning_rate.")
        return self._shaped(runs, out)

    # ---- parts ------------------------------------------------------------------------------------------------------
    def _ahead(self, runs: Runs, r: int, history: int) -> np.ndarray:
        run, slide = runs[r], np.lib.stride_tricks.sliding_window_view
        windows = list(slide(run.X, history, axis=0).transpose(0, 2, 1))
        first = slide(run.y, self.n_initial_, axis=0).transpose(0, 2, 1)[: len(windows)]
        return np.stack([found[-1] for found in self._run_free(windows, first)])

    def _sequences(self, inputs: list[np.ndarray], first: np.ndarray) -> dict[str, np.ndarray]:
        """What the network sees: first rows flat, and u[t], u[t-1] at the rows after them, padded to one length."""
        n = self.n_initial_
        longest = max(len(u) for u in inputs)
        U = (np.stack([lengthened(u, max(longest, n + 1)) for u in inputs]) - self.u_mean_) / self.u_spread_
        Y = (first - self.y_mean_) / self.y_spread_
        known = np.concatenate([Y, U[:, :n]], axis=2).reshape(len(U), -1)
        drive = np.concatenate([U[:, n:], U[:, n - 1 : -1]], axis=2)
        return {"known": known.astype(np.float32), "drive": drive.astype(np.float32)}

    def _train(self, data: dict[str, np.ndarray], target: np.ndarray) -> None:
        """Adam along a cosine."""
        import torch
        from skorch.callbacks import GradientNormClipping, LRScheduler

        classes = _classes()
        seed = int(check_random_state(self.random_state).randint(2**31))
        sizes = {"n_known": data["known"].shape[1], "n_drive": data["drive"].shape[2], "n_outputs": target.shape[2]}
        shape = {"cell": self.cell, "hidden_size": self.hidden_size, "n_layers": self.n_layers}
        callbacks = [
            ("clip", GradientNormClipping(1.0)),
            ("cosine", LRScheduler("CosineAnnealingLR", T_max=self.max_epochs)),
        ]
        settings: dict[str, Any] = {
            "criterion": classes["MaskedError"],
            "optimizer": torch.optim.AdamW,
            "optimizer__weight_decay": self.alpha,
            "lr": self.learning_rate,
            "max_epochs": self.max_epochs,
            "batch_size": self.batch_size,
            "iterator_train__shuffle": True,
            "train_split": None,
            "callbacks": callbacks,
            "verbose": 0,
            "device": read_device(self.device),
        }
        settings.update({f"module__{name}": value for name, value in {**sizes, **shape}.items()})
        settings.update(self.net_params or {})
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.net_ = classes["NeuralNet"](classes["Recurrent"], **settings).fit(data, target)
        self.loss_curve_ = [float(value) for value in self.net_.history[:, "train_loss"]]

    def _run_free(self, inputs: list[np.ndarray], first: np.ndarray) -> list[np.ndarray]:
        """Free runs of any lengths, their first rows as given."""
        import torch

        with torch.random.fork_rng(devices=[]):  # torch's data loader draws a number even where nothing is shuffled
            scaled = self.net_.predict(self._sequences(inputs, first))
        found = scaled.astype(float) * self.y_spread_ + self.y_mean_
        return [np.concatenate([f, part])[: len(u)] for f, part, u in zip(first, found, inputs)]


@cache
def _classes() -> dict[str, Any]:
    """The classes that derive from torch; torch is imported only when a network is fitted."""
    import torch
    from skorch import NeuralNet

    nn = torch.nn

    class Recurrent(nn.Module):
        """Encoder of the first rows, cell, linear head on the hidden state."""

        def __init__(self, n_known: int, n_drive: int, n_outputs: int, cell: str, hidden_size: int, n_layers: int):
            super().__init__()
            self.n_layers, self.hidden_size, self.n_states = n_layers, hidden_size, 2 if cell == "lstm" else 1
            width = n_layers * hidden_size * self.n_states
            self.encoder = nn.Sequential(
                nn.Linear(n_known, 2 * hidden_size), nn.Tanh(), nn.Linear(2 * hidden_size, width), nn.Tanh()
            )
            self.cell = (nn.LSTM if cell == "lstm" else nn.GRU)(n_drive, hidden_size, n_layers, batch_first=True)
            self.head = nn.Linear(hidden_size, n_outputs)

        def forward(self, known: Any, drive: Any) -> Any:
            start = self.encoder(known).view(len(known), self.n_states, self.n_layers, self.hidden_size)
            states = [start[:, k].transpose(0, 1).contiguous() for k in range(self.n_states)]
            hidden, _ = self.cell(drive, tuple(states) if self.n_states == 2 else states[0])
            return self.head(hidden)

    class MaskedError(nn.Module):
        """Mean squared error over the rows that are there."""

        def forward(self, found: Any, target: Any) -> Any:
            known = torch.isfinite(target)
            error = torch.where(known, found - torch.nan_to_num(target), torch.zeros_like(found))
            return (error**2).sum() / known.sum().clamp(min=1)

    found: dict[str, Any] = {"Recurrent": Recurrent, "MaskedError": MaskedError}
    for kind in found.values():  # so that nets pickle: the names are found through __getattr__ below
        kind.__module__, kind.__qualname__ = __name__, kind.__name__
    return {**found, "NeuralNet": NeuralNet}


def __getattr__(name: str) -> Any:
    if name in ("Recurrent", "MaskedError"):
        return _classes()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
