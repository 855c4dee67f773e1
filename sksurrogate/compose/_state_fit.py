"""Starts and stages of a state-space fit: subspace, output error, networks on pieces that grow."""

from __future__ import annotations

import numpy as np

from sksurrogate.kernels.state_evidence import fit_state_evidence
from sksurrogate.kernels.state_model import StateModel
from sksurrogate.kernels.state_space import StateFit, fit_output_error, simulate, start_states, subspace

#: Rows that a subspace start looks at.
SUBSPACE_ROWS = 100_000
#: Rows that are run from other initial states after every step of a fit.
GUARDED = 10_000
#: Rows of the pieces on which networks are fitted before whole runs.
PIECE_LENGTHS = (8, 24, 72)
#: Share of the penalty there: a linear model is enough for short pieces, and weights that the penalty has taken to zero
#: in both layers stay there.
LIGHT = 1e-2
#: Penalty beside the mean squared error from which the evidence begins.
FIRST_PENALTY = 1e-4


def fit_linear(
    U: list[np.ndarray], Y: list[np.ndarray], n_states: int, feedthrough: bool, max_iter: int, refine: bool
) -> StateFit:
    """Subspace starts with pasts of several lengths; the best free run is refined.

    A refined model grows no faster than a constant, or than its subspace start if that is unstable: free runs from the
    fitted initial states may hide an unstable mode, others do not.
    """
    n, m, o = n_states, U[0].shape[1], Y[0].shape[1]
    model = StateModel(n, m, o, (), feedthrough)
    rows, outputs, starts = np.concatenate(U), np.concatenate(Y), first_rows(U)
    candidates = []
    few = _few(U), _few(Y)
    for past in sorted({n + 1, 2 * n + 2, 10, 20}):
        found = subspace(*few, n, past, feedthrough)
        if found is not None:
            candidates.append(model.affine(*found))
    if not candidates:  # too short for a projection: slow decay, everything else at zero but the outputs of the states
        C = np.eye(o, n)
        candidates = [model.affine(0.8 * np.eye(n), np.zeros((n, m)), C, np.zeros((o, m)), np.zeros(n), np.zeros(o))]
    fits, trial = [], (np.concatenate(few[0]), np.concatenate(few[1]), first_rows(few[0]))
    for theta in candidates:
        # the free run is linear in the initial states: a fit with two steps finds them
        guard = _GrowsNoFaster(model, theta)
        fits.append(fit_output_error(model, theta, np.zeros((len(few[0]), n)), *trial, max_iter=2, accepts=guard))
    best = int(np.argmin([fit.cost for fit in fits]))
    if not refine:
        theta = candidates[best]
        padded, lengths = _padded(U), [len(u) for u in U]
        measured = np.full((len(U), max(lengths), o), np.nan)
        for r, part in enumerate(Y):
            measured[r, : len(part)] = part
        x0 = start_states(model, theta, padded, measured, np.zeros(n), 1e-8 * np.eye(n))
        return StateFit(theta, x0, simulate(model, theta, x0, rows, starts), np.nan, 0)
    x0 = np.zeros((len(U), n))
    x0[: len(few[0])] = fits[best].x0
    guard = _GrowsNoFaster(model, candidates[best])
    return fit_output_error(model, fits[best].theta, x0, rows, outputs, starts, max_iter=max_iter, accepts=guard)


def fit_networks(
    model: StateModel,
    linear: StateFit,
    U: list[np.ndarray],
    Y: list[np.ndarray],
    *,
    alpha: float | str,
    max_iter: int,
    n_starts: int,
    rng: np.random.RandomState,
) -> tuple[StateFit, float]:
    """Networks of random first layers and last layers at zero, added to the linear model; the fit and its penalty."""
    first = FIRST_PENALTY if isinstance(alpha, str) else float(alpha)
    plain = StateModel(model.n_states, model.n_inputs, model.n_outputs, (), model.feedthrough)
    rows, outputs, starts = np.concatenate(U), np.concatenate(Y), first_rows(U)
    # states of unit variance, so that the random layers see them as they see the inputs
    spread = linear.x.std(axis=0) + 1e-9
    scaled = linear.theta.copy()
    W, b = plain.f.parts(scaled[: plain.f.size])[:2]
    W[: model.n_states] *= spread[:, None]
    W /= spread
    b /= spread
    plain.g.parts(scaled[plain.f.size :])[0][: model.n_states] *= spread[:, None]
    fits = []
    for _ in range(n_starts):
        theta = []
        for block, flat in ((model.f, scaled[: plain.f.size]), (model.g, scaled[plain.f.size :])):
            part = np.zeros(block.size)
            for values, shape in zip(block.parts(part)[2:-2], block.shapes[2:-2]):
                values[...] = rng.normal(size=shape) / np.sqrt(shape[0])
            part[: len(flat)] = flat
            theta.append(part)
        started = np.concatenate(theta), linear.x / spread
        fits.append(_grow(model, *started, rows, outputs, starts, linear.cost, first, max_iter))
    best = min(fits, key=lambda fit: fit.cost)
    if not isinstance(alpha, str) or not np.isfinite(best.cost):
        return best, first
    return fit_state_evidence(model, best, rows, outputs, starts, first, _StaysNear(model, rows, starts))


def _grow(
    model: StateModel,
    theta: np.ndarray,
    x: np.ndarray,
    U: np.ndarray,
    Y: np.ndarray,
    starts: np.ndarray,
    plain_cost: float,
    alpha: float,
    max_iter: int,
) -> StateFit:
    """Fits to pieces of growing length: whole runs from a poor start have no useful slope."""
    longest, started, stays = (
        int(np.diff(np.r_[starts, len(U)]).max()),
        (theta, x[starts]),
        _StaysNear(model, U, starts),
    )
    for horizon in PIECE_LENGTHS:
        if 2 * horizon <= longest:
            edges = zip(starts, np.r_[starts[1:], len(U)])
            cuts = np.concatenate([np.arange(a, max(b - 1, a + 1), horizon) for a, b in edges])
            steps = max(max_iter // 2, 1)
            fit = fit_output_error(model, theta, x[cuts], U, Y, cuts, alpha=LIGHT * alpha, max_iter=steps, tol=1e-4)
            if not stays(fit.theta, fit.x):
                break
            theta, x = fit.theta, fit.x
    fit = fit_output_error(model, theta, x[starts], U, Y, starts, alpha=alpha, max_iter=max_iter, accepts=stays)
    if not fit.cost <= plain_cost:
        # pieces led away: whole runs from the linear model
        light = LIGHT * alpha
        fit = fit_output_error(model, *started, U, Y, starts, alpha=light, max_iter=max_iter, accepts=stays)
        fit = fit_output_error(model, fit.theta, fit.x0, U, Y, starts, alpha=alpha, max_iter=max_iter, accepts=stays)
    return fit


class _GrowsNoFaster:
    """Whether the spectral radius of a linear model is at most 1, or that of a first model where this is larger."""

    def __init__(self, model: StateModel, first: np.ndarray):
        self.model = model
        self.most = max(self._radius(first), 1.0)

    def __call__(self, theta: np.ndarray, x: np.ndarray) -> bool:
        return self._radius(theta) <= self.most

    def _radius(self, theta: np.ndarray) -> float:
        by_state = self.model.f.parts(theta[: self.model.f.size])[0][: self.model.n_states]
        return float(np.abs(np.linalg.eigvals(by_state)).max())


class _StaysNear:
    """Whether free runs from other initial states stay near the trajectory.

    A model may follow the training runs from their fitted initial states and diverge from any other.
    """

    def __init__(self, model: StateModel, U: np.ndarray, starts: np.ndarray):
        parts = _few([U[a:b] for a, b in zip(starts, np.r_[starts[1:], len(U)])], GUARDED)
        self.model, self.U, self.starts = model, np.concatenate(parts * 2), first_rows(parts * 2)
        self.last: np.ndarray | None = None  # the next runs are near these

    def __call__(self, theta: np.ndarray, x: np.ndarray) -> bool:
        mean, spread = x.mean(axis=0), x.std(axis=0)
        each = (len(self.starts) // 2, self.model.n_states)
        x0 = np.concatenate([np.broadcast_to(mean + side * spread, each) for side in (1.0, -1.0)])
        away = simulate(self.model, theta, x0, self.U, self.starts, self.last)
        near = bool(np.all(np.abs(away - mean) <= 100 * spread + 1.0))
        self.last = away if near else self.last
        return near


def _few(parts: list[np.ndarray], left: int = SUBSPACE_ROWS) -> list[np.ndarray]:
    """The first runs, with so many rows in all."""
    out = []
    for part in parts:
        if left <= 1:
            break
        out.append(part[:left])
        left -= len(part)
    return out


def first_rows(parts: list[np.ndarray]) -> np.ndarray:
    """First row of every run."""
    return np.r_[0, np.cumsum([len(part) for part in parts])[:-1]].astype(int)


def _padded(parts: list[np.ndarray]) -> np.ndarray:
    """(n_runs, n_longest, n_columns), the last row repeated."""
    longest = max(len(part) for part in parts)
    return np.stack([part[np.minimum(np.arange(longest), len(part) - 1)] for part in parts])


def cut_pieces(parts: list[np.ndarray], horizon: int) -> list[np.ndarray]:
    """Pieces of ``horizon`` rows; a last piece of one row joins the one before."""
    out = []
    for part in parts:
        edges = list(range(0, len(part), horizon))
        if len(edges) > 1 and len(part) - edges[-1] < 2:
            edges.pop()
        out += [part[a:b] for a, b in zip(edges, [*edges[1:], len(part)])]
    return out
