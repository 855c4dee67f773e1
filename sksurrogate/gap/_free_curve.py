"""A law that no name carries: a free curve of one signal in one balance, judged along the free run.

The smoothed force of a disturbance follows the states that it pushes, and a law of the states is easily seen in it. The free
run knows nothing of the disturbance: a curve of its states, of the inputs or of their recent past is a regressor like any
other, and its likelihood under coloured noise is compared with that of no curve.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.gap._evidence import columns
from sksurrogate.gap._problem import Problem, Rival
from sksurrogate.gap._project import project_starts
from sksurrogate.gap._unknown import memory
from sksurrogate.kernels.banded import recursion_band, solve_recursion
from sksurrogate.kernels.disturbance import Disturbance, fit_noise

__all__ = ["FreeCurve", "free_curve"]

#: Knots of a piecewise linear curve, at equal shares of the samples.
KNOTS = 8
#: Gain under the noise of the rival, which takes a law for a force, from which the noise is fitted anew beside the curve.
SUSPICIOUS = -15.0


@dataclass(frozen=True)
class FreeCurve:
    """The likeliest free curve.

    Attributes
    ----------
    location, variable : str
        Balance, and the signal of which it is a curve ("q and its past" where a memory is likelier).
    gain : float
        ``2 (L_with - L_without) - k ln N - 2 ln M`` for k knots, N values and M curves tried.
    moved : float
        RMS of what it moves the free run by, over the noise, initial states and parameters having followed.
    deviation : float
        The same over the deviation of the output (the worst output).
    """

    location: str
    variable: str
    gain: float
    moved: float
    deviation: float


def free_curve(problem: Problem, rival: Rival) -> FreeCurve | None:
    """The likeliest curve of one signal in one balance on top of a rival; None where none can be judged."""
    r, J, precision, pull = columns(problem, rival)
    D, noise = problem.disturbance(rival), rival.noise
    if noise is None or not (np.isfinite(J).all() and np.isfinite(D.A).all() and np.isfinite(D.C).all()):
        return None
    band = recursion_band(np.ascontiguousarray(D.A.transpose(1, 2, 0)), problem.record.starts)
    forms = list(shapes(problem, rival))
    curves = [
        (name, variable, F)
        for b, name in enumerate(problem.balances)
        for variable, f in forms
        if np.isfinite(F := response(problem, D, band, b, f)).all()
    ]
    known, size = np.concatenate([r[:, None], J], axis=1), problem.record.y.size
    try:
        none, alone, rank = _explained(D.gram(known, noise)[0], precision, pull)
        found = []
        for (name, variable, F), G in zip(curves, D.gram_each(known, [F for _, _, F in curves], noise)):
            drop, theta, k = _explained(G, *_free(precision, pull, F))
            found.append((drop - none - (k - rank) * np.log(size), name, variable, F, theta))
    except np.linalg.LinAlgError:  # a path along which no noise can be followed
        return None
    if not found:
        return None
    gain, name, variable, F, theta = max(found, key=lambda one: one[0])
    gain -= 2.0 * np.log(len(found))
    if gain > SUSPICIOUS:
        gain = max(gain, _gain(problem, rival, F) - 2.0 * np.log(len(found)))
    theta[: J.shape[1]] -= alone
    moved = np.einsum("okt,k->ot", np.concatenate([J, F], axis=1), theta) / problem.sd[:, None]
    J_x = problem.linearised(rival).J_x[:, rival.model.free_states] / problem.sd[:, None, None]
    rms = np.sqrt(np.mean(project_starts(moved[None], J_x, problem.record.starts)[0] ** 2, axis=1))
    spread = np.maximum(np.std(problem.record.y, axis=1), 1e-300) / problem.sd
    return FreeCurve(name, variable, float(gain), float(np.sqrt(np.mean(rms**2))), float(np.max(rms / spread)))


def shapes(problem: Problem, rival: Rival) -> Iterator[tuple[str, np.ndarray]]:
    """Signals of the free run with the functions whose sums are curves of them: hats (n_knots, n_samples), then the past."""
    path = rival.fit.x[: len(problem.plant.states)]
    signals = np.concatenate([path, problem.record.u])
    past = memory(problem.record, path).T.reshape(-1, *signals.shape)
    for i, (name, z) in enumerate(zip([*problem.plant.states, *problem.plant.inputs], signals)):
        knots = np.unique(np.quantile(z, np.linspace(0.0, 1.0, KNOTS)))
        if np.ptp(z) > 1e-9 * max(float(np.max(np.abs(z))), 1e-300) and len(knots) > 1:
            yield name, np.stack([np.interp(z, knots, hat) for hat in np.eye(len(knots))])
            yield f"{name} and its past", np.concatenate([z[None], past[:, i]])


def response(problem: Problem, D: Disturbance, band: np.ndarray, b: int, f: np.ndarray) -> np.ndarray:
    """What forces (k, n_samples) in balance b move the outputs by, to first order: (n_outputs, k, n_samples)."""
    push = np.zeros((D.n, len(f), D.n_samples))
    push[:, :, 1:] = (D.B[:, :, b].T[:, None] * f)[:, :, :-1]
    push[:, :, problem.record.starts] = 0.0
    with np.errstate(all="ignore"):
        return np.einsum("toi,ikt->okt", D.C, solve_recursion(band, push))


def _free(precision: np.ndarray, pull: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The prior of known parameters, and none on those of a curve."""
    return np.r_[precision, np.zeros(F.shape[1])], np.r_[pull, np.zeros(F.shape[1])]


def _explained(G: np.ndarray, precision: np.ndarray, pull: np.ndarray) -> tuple[float, np.ndarray, int]:
    """From the Gram of residual and columns: what the columns explain (twice the log likelihood), their weights, the rank."""
    if len(G) == 1:
        return 0.0, np.zeros(0), 0
    H, g = G[1:, 1:] + np.diag(precision), G[1:, 0] + pull
    scale = np.sqrt(np.maximum(np.diag(H), 1e-150))
    theta, _, rank, _ = np.linalg.lstsq(H / np.outer(scale, scale), g / scale, rcond=1e-8)
    return float(g / scale @ theta), theta / scale, int(rank)


def _gain(problem: Problem, rival: Rival, F: np.ndarray) -> float:
    """``2 (L_with - L_without) - k ln N``, the noise fitted anew on both sides: it had taken the law for a force."""
    r, J, precision, pull = columns(problem, rival)
    D, noise = problem.disturbance(rival), rival.noise
    assert noise is not None
    quiet = replace(noise, sigma=problem.sd, force=1e-3 * problem.force_unit(), coloured=1e-2 * problem.sd)

    def likelihood(J: np.ndarray, precision: np.ndarray, pull: np.ndarray) -> float:
        fits = (
            fit_noise(D, r, start, problem.force_unit(), J, precision, pull, caps=problem.caps)
            for start in (noise, quiet)
        )
        return max(fit[1] for fit in fits)

    free = _free(precision, pull, F)
    with_curve = likelihood(np.concatenate([J, F], axis=1), *free)
    return 2.0 * (with_curve - likelihood(J, precision, pull)) - F.shape[1] * np.log(r.size)
