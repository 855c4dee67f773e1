"""Corrections of a simulator's output: on lags of the deviation and the inputs, static, or in series."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from sksurrogate._domain import Domain
from sksurrogate.compose._compiled import Deviation, compiled
from sksurrogate.compose._left_out import Piece
from sksurrogate.compose._linear_end import has_intercept
from sksurrogate.compose._network import agrees
from sksurrogate.compose._plant_path import training_substeps
from sksurrogate.compose._residual import LONGEST_STRETCH, FreeRunResidual
from sksurrogate.compose._residual_fit import FreeRunCorrection, cut, features, roll
from sksurrogate.compose._skip_net import SkipNet, as_skip_net, write_back
from sksurrogate.compose._starts import Starts, fitted_starts, plain_starts
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.shooting import levenberg_marquardt
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe, recorded, simulated, simulated_batch

#: Penalties and degrees that the default residual of the static forms is chosen from, by its free run.
_PENALTIES = (1e-8, 1e-5, 1e-3, 1e-1)


@dataclass(frozen=True, eq=False)
class Free:
    """Free runs: outputs, spread of the fitted maps, and the weight of the correction; one array per run."""

    y: list[np.ndarray]
    spread: list[np.ndarray]
    weight: list[np.ndarray]


def simulate_runs(
    simulator: Any,
    inputs: Sequence[np.ndarray],
    first: Sequence[np.ndarray | None],
    n_outputs: int,
    starts: Starts | None = None,
    x0: Sequence[np.ndarray] | None = None,
) -> list[np.ndarray]:
    """Free runs of the simulator (zeros without one).

    They start at ``x0``; without it where ``starts`` finds them from the first rows; else states that are outputs start
    at the first measurement, the others where the simulator starts.
    """
    if simulator is None:
        return [np.zeros((len(U), n_outputs)) for U in inputs]
    plant = describe(simulator)
    begins: Sequence[Any] = plain_starts(simulator, first) if x0 is None else x0
    given = [r for r, y in enumerate(first) if y is not None and len(y)]
    if x0 is None and starts is not None and given:
        found = starts(simulator, [inputs[r] for r in given], [first[r] for r in given])  # type: ignore[misc]
        begins = list(begins)
        for r, state in zip(given, found):
            begins[r] = state
    out = _simulated(simulator, plant, inputs, list(begins))
    if out and out[0].shape[1] != n_outputs:
        raise DataError(
            f"y has {n_outputs} columns, but the simulator gives {out[0].shape[1]} outputs: give y the outputs of the "
            "simulator, in its order."
        )
    return out


def _simulated(simulator: Any, plant: Any, inputs: Sequence[np.ndarray], starts: list[Any]) -> list[np.ndarray]:
    """Free runs of the simulator, at once where runs are of one length and it can."""
    if len(inputs) > 1 and len({len(U) for U in inputs}) == 1 and plant.states and callable(getattr(simulator, "simulate_batch", None)):  # fmt: skip
        X0 = np.stack([plant.x0 if x0 is None else x0 for x0 in starts])
        return list(simulated_batch(simulator, np.stack(inputs), X0))
    runs = (simulated(simulator, U, x0) for U, x0 in zip(inputs, starts))
    return [y.reshape(len(U), -1) for U, y in zip(inputs, runs)]


class OutputCorrection:
    """``y_h[t] = y_s[t] + f(d[t-1..t-n], u[t..t-n], y_s[t])``, ``d = y_h - y_s``; without d for "static" and "series".

    ``form`` {"output", "static", "series"}, ``loss`` {"one_step", "shooting"}.
    """

    #: It acts on the outputs.
    inside = False
    #: Whether initial states that no sensor shows are looked for.
    finds_starts = True
    _bases: dict[Piece, np.ndarray]
    domain: Domain
    #: Range of the measured outputs: a run that starts outside it is one that no data spoke of.
    outputs_seen: Domain
    #: Substeps of the simulator's right-hand side along the training runs; None: not known.
    n_sub: int | None = None
    #: How initial states are found from the first rows; None: states that are outputs start at the first row.
    starts: Starts | None

    def __init__(
        self, simulator: Any, residual: Any, form: str, loss: str, n_lags: int, fade: float, shrinkage: float, random_state: Any
    ):  # fmt: skip
        self.simulator, self.residual, self.form, self.loss = simulator, residual, form, loss
        self.n_lags, self.fade, self.shrinkage, self.random_state = n_lags, fade, shrinkage, random_state
        self.factor: np.ndarray | float = 1.0

    def fit(
        self, inputs: list[np.ndarray], measured: list[np.ndarray], before: OutputCorrection | None = None
    ) -> OutputCorrection:
        """Fit on runs; ``before``: a fitted correction to go on from."""
        self.n_outputs = measured[0].shape[1]
        asked = self.simulator is not None and self.finds_starts
        found = fitted_starts(self.simulator, inputs, measured, self.n_lags) if asked else None
        self.starts, at = found if found is not None else (None, None)
        base = simulate_runs(self.simulator, inputs, measured, self.n_outputs, x0=at)
        if self.simulator is not None:
            plant = describe(self.simulator, n_inputs=inputs[0].shape[1], n_outputs=self.n_outputs)
            plant = recorded(plant, inputs)
            rate = PlantModel(plant).derivative if plant.access == "rhs" else None
            self.n_sub = training_substeps(plant, rate, inputs, at or plain_starts(self.simulator, measured))
        deviation = [y - b for y, b in zip(measured, base)]
        known = [self.known(U, b) for U, b in zip(inputs, base)]
        self._taught = (known, deviation, base)
        self.outputs_seen = Domain.of(np.concatenate(measured), self.fade)
        self._fit_deviations(known, deviation, before)
        return self.judge(inputs, measured)

    def judge(self, inputs: list[np.ndarray], measured: list[np.ndarray]) -> OutputCorrection:
        """Set ``rmse``, the error of the free runs of the training data."""
        free = self.run(inputs, [y[: self.n_lags] for y in measured], spread=False)
        error = np.concatenate([(f - y)[self.n_lags :] for f, y in zip(free.y, measured)])
        self.rmse = np.sqrt(np.mean(error**2, axis=0))
        return self

    def keep(self, factor: np.ndarray, fade: float) -> None:
        """Multiply what is added to the simulator's outputs by ``factor`` (n_outputs,); fade it beyond ``fade``."""
        self.factor, self.domain = factor, replace(self.domain, fade=fade)
        self.__dict__.pop("_taught", None)

    def taught_on(self, inputs: Any, measured: Any, blocks: Sequence[tuple[int, int, int]]) -> OutputCorrection:
        """The same correction, fitted to rows (run, start, stop) of the runs that ``fit`` has simulated."""
        known, deviation, _ = self._taught
        other = OutputCorrection(
            self.simulator, self.residual, self.form, self.loss, self.n_lags, self.fade, self.shrinkage, self.random_state
        )  # fmt: skip
        other.n_outputs, other.starts, other._taught, other._bases = self.n_outputs, self.starts, self._taught, {}
        other.outputs_seen = Domain.of(np.concatenate([measured[r][a:b] for r, a, b in blocks]), self.fade)
        other._fit_deviations([known[r][a:b] for r, a, b in blocks], [deviation[r][a:b] for r, a, b in blocks], None)
        return other

    def along(self, run: int, start: int, stop: int) -> np.ndarray:
        """Features (n_rows, n_features) of measured rows of a run that ``fit`` has simulated, behind its first rows."""
        known, deviation, _ = self._taught
        return self._rows(deviation[run], known[run])[max(start - self.n_lags, 0) : stop - self.n_lags]

    def trust(self, first: np.ndarray | None) -> float:
        """Share of the correction that is left to a run with these first rows (None: unknown), by the correction's reach."""
        if first is None or not len(first) or self.simulator is None:
            return 1.0
        return float(replace(self.outputs_seen, fade=self.domain.fade).weight(first[: self.n_lags]).min())

    def errors_at(
        self, factors: np.ndarray, inputs: Sequence[np.ndarray], measured: Sequence[np.ndarray], pieces: Sequence[Piece]
    ) -> list[np.ndarray]:
        """Errors (n_factors, n_rows, n_outputs) of free runs of the pieces, where they are judged."""
        U = [inputs[piece.run][piece.start : piece.stop] for piece in pieces]
        y = [measured[piece.run][piece.start : piece.stop] for piece in pieces]
        first = [part[: self.n_lags] for part in y]
        base = self._bases_of(pieces, U, first)
        with np.errstate(over="ignore", invalid="ignore"):
            free = self._run(U, first, base, False)
        out = []
        for piece, f, b, part in zip(pieces, free.y, base, y):
            rows = slice(max(piece.judged - piece.start, self.n_lags), None)
            out.append((b - part)[rows] + factors[:, None, None] * (f - b)[rows])
        return out

    def _bases_of(self, pieces: Sequence[Piece], inputs: list, first: list) -> list[np.ndarray]:
        """Runs of the simulator over pieces, each simulated once; those from the start of a run are known."""
        known = self.starts is None  # then runs of the data start as ``predict`` does
        new = [k for k, piece in enumerate(pieces) if piece not in self._bases and not (known and piece.start == 0)]
        found = self._alone([inputs[k] for k in new], [first[k] for k in new]) if new else []
        self._bases.update({pieces[k]: base for k, base in zip(new, found)})
        whole = self._taught[2]
        return [self._bases[piece] if piece in self._bases else whole[piece.run][: piece.stop] for piece in pieces]

    def _fit_deviations(self, known: list, deviation: list, before: OutputCorrection | None) -> None:
        """Region, bounds and residual from the simulator's deviations."""
        phi = np.concatenate([self._rows(d, k) for d, k in zip(deviation, known)])
        target = np.concatenate([d[self.n_lags :] for d in deviation])
        self.domain = Domain.of(phi, self.fade)
        self.reach = np.sqrt(np.mean(target**2, axis=0))
        self.bound = 3.0 * np.abs(target).max(axis=0) + 1e-300
        self._learn(known, deviation, phi, target, before)

    def known(self, U: np.ndarray, base: np.ndarray) -> np.ndarray:
        """Inputs of now and before (the first row repeated before the start) and the simulator's output."""
        lags = np.maximum(np.arange(len(U))[:, None] - np.arange(self.n_lags + 1), 0)
        return np.concatenate([U[lags].reshape(len(U), lags.shape[1] * U.shape[1]), base], axis=1)

    def run(self, inputs: Sequence[np.ndarray], first: Sequence[np.ndarray | None], spread: bool = True) -> Free:
        """Free runs from the first rows (None: from no deviation); ``spread``: those of every map too."""
        return self._run(inputs, first, self._alone(inputs, first), spread)

    def _alone(self, inputs: Sequence[np.ndarray], first: Sequence[np.ndarray | None]) -> list[np.ndarray]:
        """Free runs of the simulator from the first rows."""
        first = [None if y is None else y[: self.n_lags] for y in first]
        return simulate_runs(self.simulator, inputs, first, self.n_outputs, self.starts)

    def _run(
        self, inputs: Sequence[np.ndarray], first: Sequence[np.ndarray | None], base: list[np.ndarray], spread: bool
    ) -> Free:
        """The same from known runs of the simulator."""
        known = [self.known(U, b) for U, b in zip(inputs, base)]
        longest = max(len(k) for k in known)
        stacked = np.stack([np.concatenate([k, np.repeat(k[-1:], longest - len(k), axis=0)]) for k in known], axis=1)
        started = np.array([0 if f is None else min(len(f), len(b), self.n_lags) for f, b in zip(first, base)])
        starts = np.zeros((self.n_lags, len(base), self.n_outputs))
        for r, (f, b) in enumerate(zip(first, base)):
            if f is not None and started[r]:
                starts[: started[r], r] = f[: started[r]] - b[: started[r]]
        d, weight = self._deviations(self.step, self.net, stacked, starts, started)
        deviates = np.zeros_like(d)
        if spread and len(self.members) > 1:
            every = [self._deviations(net, net, stacked, starts, started)[0] for net in self.members]
            deviates = np.std(every, axis=0)
        cut_off = [len(b) for b in base]
        trust = [self.trust(f) for f in first]
        return Free(
            [_kept(b, d[:n, r], self.factor * trust[r], started[r]) for r, (b, n) in enumerate(zip(base, cut_off))],
            [self.factor * trust[r] * deviates[:n, r] for r, n in enumerate(cut_off)],
            [trust[r] * weight[:n, r] for r, n in enumerate(cut_off)],
        )

    def one_step(self, inputs: list[np.ndarray], measured: list[np.ndarray]) -> list[np.ndarray]:
        """One step ahead from measured outputs; nan where the past is missing."""
        base = self._alone(inputs, measured)
        out = []
        for U, y, b in zip(inputs, measured, base):
            part = np.full(b.shape, np.nan)
            if len(U) > self.n_lags:
                phi = self._rows(y - b, self.known(U, b))
                part[self.n_lags :] = b[self.n_lags :] + self.factor * self.domain.weight(phi)[:, None] * self.step(phi)
            out.append(part)
        return out

    # ---- parts ------------------------------------------------------------------------------------------------------
    def _rows(self, d: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Features of rows n_lags.. of one run."""
        if self.form != "output":
            return known[self.n_lags :]
        return features(d[:, None], known[:, None], self.n_lags)[:, 0]

    def _learn(self, known: list, deviation: list, phi: np.ndarray, target: np.ndarray, before: Any) -> None:
        """The residual, its step as a plain function, and the maps it is made of."""
        self.net: SkipNet | None = None
        self.members: list[SkipNet] = []
        own = self.residual is None or isinstance(self.residual, FreeRunResidual)
        if own and self.form == "output":
            if before is not None and isinstance(before.fitted, FreeRunResidual):
                self.fitted: Any = before.fitted.go_on(known, deviation)
            else:
                # what the inputs' columns are: input after input, each of this age
                ages = np.concatenate(
                    [np.repeat(np.arange(self.n_lags + 1), self._n_inputs(known)), np.ones(self.n_outputs)]
                )
                default = FreeRunResidual(alpha=self.shrinkage, loss=self.loss, random_state=self.random_state)
                residual = default if self.residual is None else clone(self.residual)
                self.fitted = residual.fit_runs(known, deviation, ages, self.n_lags)
            self.net, self.members = self.fitted.net_, self.fitted.members_
            self.step: Callable[[np.ndarray], np.ndarray] = self.net
            return
        wanted = target + (phi[:, -self.n_outputs :] if self.form == "series" else 0.0)
        wanted = wanted if self.n_outputs > 1 else wanted[:, 0]
        self.fitted = clone(self.residual) if self.residual is not None else self._chosen(deviation, phi, wanted)
        self.fitted.fit(phi, wanted)
        if self.loss == "shooting" and self.residual is not None and self.form == "output":
            self._shoot(known, deviation, phi)
        step = compiled(self.fitted, phi)
        self.step = Deviation(step, self.n_outputs) if self.form == "series" else step

    def _n_inputs(self, known: list) -> int:
        return (known[0].shape[1] - self.n_outputs) // (self.n_lags + 1)

    def _shoot(self, known: list, deviation: list, phi: np.ndarray) -> None:
        """Go on from the one-step fit through the free run, for residuals whose slopes are known."""
        net = as_skip_net(self.fitted)
        if net is None or not agrees(net, self.fitted, phi):
            raise DataError(
                f'loss="shooting" needs slopes of the residual, and {type(self.fitted).__name__} gives none: use the default '
                'residual, a linear model, an MLPRegressor with one tanh or logistic layer (also behind a scaler), or loss="one_step".'
            )
        model = getattr(self.fitted, "steps", [(0, self.fitted)])[-1][1]
        penalty = np.where(net.groups >= 0, max(float(getattr(model, "alpha", 0.0)), 1e-10), 0.0)
        held = np.zeros(net.theta.size, bool)
        held[: net.skip.size] = net.hidden.size > 0  # a network has no linear part
        held[-self.n_outputs :] = not has_intercept(self.fitted)
        free = cut(known, deviation, self.n_lags, LONGEST_STRETCH, 4000)
        loss = FreeRunCorrection(free, np.where(held, 0.0, penalty), np.zeros(net.theta.size), held)
        net, _ = levenberg_marquardt(loss, net, 60, 1e-6)
        write_back(self.fitted, net)
        self.net = net

    def _chosen(self, deviation: list, phi: np.ndarray, wanted: np.ndarray) -> Any:
        """Ridge on polynomials, degree and penalty chosen on every fourth run."""
        lengths = [len(d) - self.n_lags for d in deviation]
        run_of_row = np.repeat(np.arange(len(lengths)), lengths)
        held = run_of_row % 4 == 1 if len(lengths) >= 4 else np.arange(len(phi)) % 4 == 1
        unit, best, chosen = StandardScaler().fit(wanted.reshape(len(wanted), -1)).scale_, np.inf, None
        for candidate in _defaults(phi.shape[1]):
            found = clone(candidate).fit(phi[~held], wanted[~held]).predict(phi[held])
            error = float(np.mean(((found - wanted[held]) / unit) ** 2))
            if chosen is None or error < best:
                best, chosen = error, candidate
        return clone(chosen)

    def _deviations(
        self, step: Any, net: SkipNet | None, known: np.ndarray, starts: np.ndarray, started: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Deviations (n_steps, n_runs, n_outputs) and the correction's weight (n_steps, n_runs)."""
        n, steps, runs = self.n_lags, *known.shape[:2]
        weight = np.ones((steps, runs))
        if self.form != "output":
            rows = known.reshape(steps * runs, -1)
            weight = self.domain.weight(rows).reshape(steps, runs)
            d = step(rows).reshape(steps, runs, -1) * weight[:, :, None]
            for r in range(runs):
                d[: started[r], r] = starts[: started[r], r]
            return d, weight
        if net is not None and steps > n and (started.min() == n or started.max() == 0):
            # without fading first: where nothing fades on the way, this is the answer
            ahead = 0 if started.min() == n else n  # rows of no deviation before the start
            padded = np.concatenate([known[:ahead], known])
            d = roll(net, padded, starts)
            if np.all(np.isfinite(d)) and np.all(np.abs(d) <= self.bound):
                phi = features(d, padded, n)
                phi = phi.reshape(-1, phi.shape[2])
                if np.all(self.domain.distance(phi) <= self.domain.fade):
                    return d[ahead:], weight
        return self._step_by_step(step, known, starts, started)

    def _step_by_step(
        self, step: Any, known: np.ndarray, starts: np.ndarray, started: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The same, one call per step, with fading and the bound on the deviation."""
        n, steps, runs = self.n_lags, *known.shape[:2]
        d, weight = np.zeros((steps + n, runs, self.n_outputs)), np.ones((steps, runs))
        for r in range(runs):  # n rows of no deviation come before the start
            d[n : n + started[r], r] = starts[: started[r], r]
        for t in range(int(started.min(initial=n)), steps):
            phi = np.concatenate([*(d[n + t - k] for k in range(1, n + 1)), known[t]], axis=1)
            w = self.domain.weight(phi)
            new = np.clip(w[:, None] * step(phi), -self.bound, self.bound)
            weight[t] = w
            d[n + t] = np.where((t >= started)[:, None], new, d[n + t])
        return d[n:], weight


def _kept(base: np.ndarray, d: np.ndarray, factor: np.ndarray | float, started: int) -> np.ndarray:
    """Outputs (n_samples, n_outputs): the first ``started`` rows are those given, then the share of the deviation."""
    y = base + factor * d
    y[:started] = base[:started] + d[:started]
    return y


def _defaults(n_features: int) -> list[Any]:
    """Ridge on polynomials of degree 1, 2 and, for few features, 3."""
    degrees = [1, 2] + ([3] if n_features <= 14 else [])
    return [
        make_pipeline(StandardScaler(), PolynomialFeatures(degree, include_bias=False), StandardScaler(), Ridge(alpha))
        for degree in degrees
        for alpha in _PENALTIES
    ]
