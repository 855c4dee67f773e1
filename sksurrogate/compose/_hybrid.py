"""A hybrid model: an imperfect simulator plus a learned correction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.linear_model import Ridge
from sklearn.metrics import r2_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from sklearn.utils.validation import check_is_fitted, validate_data

from sksurrogate.exceptions import SimulationDiverged
from sksurrogate.physics._simulator import describe
from sksurrogate.runs import Runs, resolve_runs

__all__ = ["HybridRegressor"]

#: Penalties and degrees that the default residual is chosen from, by the free run.
_PENALTIES = (1e-8, 1e-5, 1e-3, 1e-1)


class HybridRegressor(RegressorMixin, BaseEstimator):
    """Free run of a simulator plus a learned correction on lags of the deviation and the inputs.

    ``y_h[t] = y_s[t] + f(d[t-1], ..., d[t-n], u[t], ..., u[t-n])`` with ``d = y_h - y_s`` the correction's own past
    (the equation at the end of section 4.4 of the paper); y_s is the simulator's free run.

    Parameters
    ----------
    simulator : object with ``simulate(U, x0=None, t=None)``
    residual : regressor, optional
        Learns the correction from (n_samples, n_lags * n_outputs + (n_lags + 1) * n_inputs + n_outputs) features: past
        deviations, inputs, and the simulator's own output. Default: ridge on polynomials, degree and penalty chosen by
        the free run on every fourth training run, left out for that.
    form : {"output", "static", "series"}, default="output"
        "output": past deviations are features, as in the paper. "static": only inputs (with their lags) and the
        simulator's output are. "series": as "static", but ``residual`` learns y itself in place of the deviation.
    n_lags : int, default=5
        Past deviations and inputs.
    run : None, column name, int or "index"
        Where X says which run a row belongs to; ``groups`` wins.

    Attributes
    ----------
    residual_ : fitted regressor
    n_initial_ : int
        Rows of ``y0`` that ``predict`` takes.
    free_run_rmse_ : float
        On the training runs.
    n_features_in_ : int

    Notes
    -----
    Outside the range of the training data the correction fades: features are held within it, and the deviation within
    1.5 times its own range, so that a free run cannot run away.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 4.4 and Figure 8.

    Examples
    --------
    >>> from sksurrogate.compose import HybridRegressor
    >>> from sksurrogate.datasets import linear_reactor, make_reactor_runs
    >>> X, y, groups = make_reactor_runs(8, 150, random_state=0)
    >>> hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    >>> hybrid.score(X, y, groups=groups) > 0.99
    True
    """

    __metadata_request__fit = {"groups": True}
    __metadata_request__predict = {"groups": True, "y0": True}
    __metadata_request__score = {"groups": True}

    def __init__(self, simulator: Any, residual: Any = None, form: str = "output", *, n_lags: int = 5, run: Any = None):
        self.simulator = simulator
        self.residual = residual
        self.form = form
        self.n_lags = n_lags
        self.run = run

    def fit(self, X: Any, y: Any, groups: Any = None) -> HybridRegressor:
        """Fit the correction one step ahead on the measured deviation.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        if self.form not in ("output", "static", "series"):
            raise ValueError(f'form={self.form!r} is unknown: use "output", "static" or "series".')
        if not hasattr(X, "columns"):
            validate_data(self, X, y, multi_output=True, y_numeric=True, ensure_min_samples=2)
        runs = self._resolve(X, y, groups, min_rows=self.n_lags + 2)
        self.n_features_in_ = np.shape(X)[1]
        self.y_is_1d_ = runs.y_is_1d
        self.n_initial_ = self.n_lags
        measured = [run.y for run in runs]
        base = self._simulate(runs, [run.y[0] for run in runs])
        deviation = [a - b for a, b in zip(measured, base)]
        rows = [self._features(d, run.X, b) for d, run, b in zip(deviation, runs, base)]
        Phi, D = np.concatenate(rows), np.concatenate([d[self.n_lags :] for d in deviation])
        self.low_, self.high_ = Phi.min(axis=0), Phi.max(axis=0)
        reach = np.abs(D).max(axis=0)
        self.bound_ = 1.5 * reach + 1e-12
        candidates = [self.residual] if self.residual is not None else _defaults(Phi.shape[1])
        everything = list(range(len(runs)))
        chosen = candidates[0]
        if len(candidates) > 1:
            # Every fourth run judges the free run of what the others taught; few runs judge themselves.
            judges = everything[1::4] if len(runs) >= 4 else everything
            pupils = [r for r in everything if r not in judges] or everything
            errors = []
            for candidate in candidates:
                _, step = self._learn(candidate, rows, deviation, pupils)
                errors.append(self._free_run_error(runs, base, measured, step, judges))
            chosen = candidates[int(np.argmin(np.nan_to_num(errors, nan=np.inf)))]
        self.residual_, self._step = self._learn(chosen, rows, deviation, everything)
        self.free_run_rmse_ = float(np.sqrt(self._free_run_error(runs, base, measured, self._step, everything)))
        return self

    def predict(self, X: Any, y0: Any = None, groups: Any = None) -> np.ndarray:
        """Free run.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0 : array-like (n_lags, n_outputs) or (n_runs, n_lags, n_outputs), optional
            Outputs at the first rows of each run; without it the correction starts from no deviation.
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)
            The first ``n_lags`` rows of each run are ``y0`` where it is given.

        Raises
        ------
        SimulationDiverged
            The free run left the finite numbers.
        """
        check_is_fitted(self, "residual_")
        runs = self._resolve(X, None, groups)
        first = self._initial(y0, runs)
        base = self._simulate(runs, [f[0] if f is not None else None for f in first])
        n_out = base[0].shape[1]
        starts = [
            np.zeros((0, n_out)) if f is None else f[: len(run)] - b[: min(len(f), len(run))]
            for f, run, b in zip(first, runs, base)
        ]
        deviation = self._free_run([run.X for run in runs], base, starts, self._step)
        out = [b + d for b, d in zip(base, deviation)]
        for run, part in zip(runs, out):
            if not np.all(np.isfinite(part)):
                row = int(np.flatnonzero(~np.isfinite(part).all(axis=1))[0])
                raise SimulationDiverged(
                    f"the hybrid's free run left the finite numbers: run {run.label!r}, row {row}. Use more training runs, "
                    "a larger penalty in residual, or fewer lags.",
                    run=run.label,
                    row=row,
                )
        stacked = runs.stack(out)
        return stacked[:, 0] if self.y_is_1d_ else stacked

    def predict_one_step(self, X: Any, y: Any, groups: Any = None) -> np.ndarray:
        """One step ahead from measured outputs; the first ``n_lags`` rows of each run are nan."""
        check_is_fitted(self, "residual_")
        runs = self._resolve(X, y, groups)
        base = self._simulate(runs, [run.y[0] for run in runs])
        out = []
        for run, b in zip(runs, base):
            part = np.full(b.shape, np.nan)
            if len(run) > self.n_lags:
                part[self.n_lags :] = b[self.n_lags :] + self._step(self._features(run.y - b, run.X, b))
            out.append(part)
        stacked = runs.stack(out)
        return stacked[:, 0] if self.y_is_1d_ else stacked

    def score(self, X: Any, y: Any, sample_weight: Any = None, groups: Any = None) -> float:
        """R2 of the free run from the first rows of every run, those rows left out."""
        runs = self._resolve(X, y, groups)
        first = np.stack([_padded(run.y, self.n_lags) for run in runs])
        predicted = np.asarray(self.predict(X, y0=first, groups=groups)).reshape(runs.n_samples, -1)
        keep = np.zeros(runs.n_samples, bool)
        for run in runs:
            keep[min(run.start + self.n_lags, run.stop - 1) : run.stop] = True
        truth = runs.stack([run.y for run in runs])
        weight = None if sample_weight is None else np.asarray(sample_weight)[keep]
        return float(r2_score(truth[keep], predicted[keep], sample_weight=weight))

    # ---- parts ------------------------------------------------------------------------------------------------------
    def _resolve(self, X: Any, y: Any, groups: Any, min_rows: int = 1) -> Runs:
        return resolve_runs(
            X, y, groups=groups, run=self.run, dt=getattr(self.simulator, "dt", None), min_rows=min_rows
        )

    def _simulate(self, runs: Runs, first: Sequence[np.ndarray | None]) -> list[np.ndarray]:
        """Free runs of the simulator; states that are outputs start at the first measurement."""
        plant = describe(self.simulator)
        out = []
        for run, y in zip(runs, first):
            x0 = None
            places = plant.output_states if plant.states else None
            if y is not None and places is not None:
                x0 = plant.x0.copy()
                x0[list(places)] = y
            out.append(np.asarray(self.simulator.simulate(run.X, x0=x0)).reshape(len(run), -1))
        return out

    def _features(self, d: np.ndarray, U: np.ndarray, base: np.ndarray) -> np.ndarray:
        """Rows t = n_lags..: past deviations, inputs of now and before, the simulator's output."""
        n, rows = self.n_lags, len(d)
        past = [d[n - k : rows - k] for k in range(1, n + 1)]
        inputs = [U[n - k : rows - k] for k in range(n + 1)]
        return np.concatenate([*(past if self.form == "output" else []), *inputs, base[n:]], axis=1)

    def _free_run(
        self, U: Sequence[np.ndarray], base: Sequence[np.ndarray], starts: Sequence[np.ndarray], step: Any
    ) -> list[np.ndarray]:
        """Deviations of all runs abreast, (n_samples, n_outputs) each."""
        n, n_out = self.n_lags, base[0].shape[1]
        longest = max(len(b) for b in base)
        d = np.zeros((len(base), longest, n_out))
        Us = np.stack([np.pad(u, ((0, longest - len(u)), (0, 0)), mode="edge") for u in U])
        Bs = np.stack([np.pad(b, ((0, longest - len(b)), (0, 0)), mode="edge") for b in base])
        begun = np.array([min(len(s), n) for s in starts])
        for r, s in enumerate(starts):
            d[r, : begun[r]] = s[: begun[r]]
        for t in range(min(n, int(begun.min(initial=n))), longest):
            k = np.maximum(t - np.arange(1, n + 1), 0)
            j = np.maximum(t - np.arange(n + 1), 0)
            past = np.where((t - np.arange(1, n + 1) >= 0)[None, :, None], d[:, k], 0.0)
            past = past.reshape(len(d), -1)[:, : None if self.form == "output" else 0]
            phi = np.concatenate([past, Us[:, j].reshape(len(d), -1), Bs[:, t]], axis=1)
            new = np.clip(step(np.clip(phi, self.low_, self.high_)), -self.bound_, self.bound_)
            d[:, t] = np.where((t >= begun)[:, None], new, d[:, t])
        return [d[r, : len(b)] for r, b in enumerate(base)]

    def _learn(self, candidate: Any, rows: list, deviation: list, chosen: list[int]) -> tuple[Any, Any]:
        """A residual fitted one step ahead on some of the runs, and its prediction of the deviation."""
        Phi, D = np.concatenate([rows[r] for r in chosen]), np.concatenate([deviation[r][self.n_lags :] for r in chosen])
        target = D + (Phi[:, -D.shape[1] :] if self.form == "series" else 0.0)
        fitted = clone(candidate).fit(Phi, target if D.shape[1] > 1 else target[:, 0])
        step = _compiled(fitted)
        return fitted, _Deviation(step, D.shape[1]) if self.form == "series" else step

    def _free_run_error(self, runs: Runs, base: list, measured: list, step: Any, chosen: list[int]) -> float:
        """Mean square error of the free run on some of the runs."""
        base, measured = [base[r] for r in chosen], [measured[r] for r in chosen]
        starts = [y[: self.n_lags] - b[: self.n_lags] for y, b in zip(measured, base)]
        found = self._free_run([runs[r].X for r in chosen], base, starts, step)
        return float(np.mean(np.concatenate([(b + d - y) ** 2 for b, d, y in zip(base, found, measured)])))

    def _initial(self, y0: Any, runs: Runs) -> list[np.ndarray | None]:
        """First rows of every run."""
        if y0 is None:
            return [None] * len(runs)
        given = np.asarray(y0, dtype=float)
        if given.ndim == 1:
            given = given[:, None]
        if given.ndim == 2:
            given = np.repeat(given[None], len(runs), axis=0)
        if given.ndim != 3 or len(given) != len(runs):
            raise ValueError(
                f"y0 has shape {np.shape(y0)}, expected ({self.n_lags}, n_outputs) or ({len(runs)}, {self.n_lags}, n_outputs): "
                "the first rows of each run."
            )
        return list(given)


class _Deviation:
    """A predictor of the output as one of the deviation: what it adds to the simulator's output, the last features."""

    def __init__(self, step: Any, n_outputs: int):
        self.step, self.n_outputs = step, n_outputs

    def __call__(self, phi: np.ndarray) -> np.ndarray:
        return self.step(phi) - phi[:, -self.n_outputs :]


def _padded(y: np.ndarray, n: int) -> np.ndarray:
    """First n rows, the last repeated where there are fewer."""
    return y[np.minimum(np.arange(n), len(y) - 1)]


def _defaults(n_features: int) -> list[Any]:
    """Ridge on polynomials of degree 1, 2 and, for few features, 3."""
    degrees = [1, 2] + ([3] if n_features <= 14 else [])
    return [
        make_pipeline(
            StandardScaler(), PolynomialFeatures(degree, include_bias=False), StandardScaler(), Ridge(penalty)
        )
        for degree in degrees
        for penalty in _PENALTIES
    ]


def _compiled(residual: Any) -> Any:
    """The prediction of a fitted residual on (n_rows, n_features) as (n_rows, n_outputs); plain numpy for the default."""
    steps = list(getattr(residual, "steps", None) or [])
    kinds = [type(step).__name__ for _, step in steps]
    if kinds != ["StandardScaler", "PolynomialFeatures", "StandardScaler", "Ridge"]:
        return lambda phi: np.asarray(residual.predict(phi)).reshape(len(phi), -1)
    scale, poly, second, ridge = (step for _, step in steps)
    index = [np.repeat(np.arange(len(row)), row) for row in poly.powers_]
    degree = max(len(i) for i in index)
    table = np.full((degree, len(index)), poly.n_features_in_)
    for column, factors in enumerate(index):
        table[: len(factors), column] = factors
    coef = np.atleast_2d(ridge.coef_) / second.scale_
    intercept = np.atleast_1d(ridge.intercept_) - coef @ second.mean_

    def step(phi: np.ndarray) -> np.ndarray:
        z = np.concatenate([(phi - scale.mean_) / scale.scale_, np.ones((len(phi), 1))], axis=1)
        features = z[:, table[0]]
        for row in table[1:]:
            features = features * z[:, row]
        return features @ coef.T + intercept

    return step
