"""What left-out runs say about a hybrid's correction: the share of it that is kept, and how far it reaches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.compose._left_out import LeftOut
from sksurrogate.compose._support import SHARES, Support, block_powers, supported

#: Reach of a correction beyond its data, as a share of their range: hardly any, and as much again.
SHORTEST, LONGEST = 0.1, 1.0
#: Shares of the squared error of every left-out block that a correction may leave. With the first it follows the plant, not the data,
#: and reaches as far as any; with the second, half of the error, it reaches as far as one block went.
LEFT_ANYWHERE, LEFT_ONCE = 0.1, 0.25


@dataclass(frozen=True, eq=False)
class CorrectionReport:
    """Errors of free runs on left-out runs (blocks of one or two runs), and the share of the correction that is kept.

    Attributes
    ----------
    shrinkage : ndarray (n_outputs,)
        Share of the correction that is kept, from 0 (the simulator alone) to 1.
    fade : float
        Share of the range of the data by which a feature may leave it before the correction fades.
    simulator_rmse, whole_rmse, rmse : ndarray (n_outputs,)
        Of the simulator alone, of the whole correction, and of the share that is kept; nan where nothing was left out.
    gain, standard_error : float
        Share of the simulator's squared error on left-out runs that the kept share removes, mean over outputs, and its
        standard error; nan without a simulator.
    n_blocks : int
        Blocks that the standard errors are made of; 0 where the record is too short to leave any out.
    sentence : str
    """

    shrinkage: np.ndarray
    fade: float
    simulator_rmse: np.ndarray
    whole_rmse: np.ndarray
    rmse: np.ndarray
    gain: float
    standard_error: float
    n_blocks: int
    sentence: str

    def __str__(self) -> str:
        return self.sentence


def keep_supported(
    correction: Any,
    inputs: Sequence[np.ndarray],
    measured: Sequence[np.ndarray],
    names: Sequence[str],
    fade: float | None,
) -> CorrectionReport:
    """Leave runs out, keep the share of the correction that they support, and say so.

    ``correction``: its ``keep`` is called.
    ``inputs, measured`` (n_samples, n_inputs | n_outputs): the training runs.
    ``names``: of the outputs.
    ``fade``: None: the first of :func:`reaches` whose condition the correction meets.
    """
    o = measured[0].shape[1]
    left_out = LeftOut(correction, inputs, measured)
    if not left_out.fitted:
        correction.keep(np.zeros(o), SHORTEST if fade is None else fade)
        correction.judge(inputs, measured)
        nothing = np.full(o, np.nan)
        return CorrectionReport(np.zeros(o), correction.domain.fade, nothing, nothing, nothing, 0.0, 0.0, 0, _TOO_SHORT)
    size = np.maximum(np.std(np.concatenate(measured), axis=0), 1e-300)
    judged = _judged_inside if correction.inside else _judged_outside
    for reach_beyond, most_left in reaches(left_out.departures(correction)) if fade is None else [(fade, np.inf)]:
        best = judged(left_out, reach_beyond, size)
        if best.worst <= most_left:
            break
    place = [int(np.argmin(np.abs(best.factors - support.factor))) for support in best.supports]
    kept = best.factors[place]
    changed = np.any(kept < 1.0) or best.fade != correction.domain.fade
    correction.keep(kept, best.fade)
    if changed:
        correction.judge(inputs, measured)
    chosen = best.rmse[place, np.arange(o)]
    sentence = " ".join(
        _sentence(name, *numbers) for name, *numbers in zip(names, kept, best.rmse[0], best.rmse[-1], chosen)
    )
    n_blocks = best.supports[0].n_blocks
    error = float(np.mean([support.standard_error for support in best.supports]))
    return CorrectionReport(
        kept, best.fade, best.rmse[0], best.rmse[-1], chosen, best.closed, error, n_blocks, sentence
    )


@dataclass(frozen=True, eq=False)
class _Judged:
    """Shares of the correction at one reach: support of every output, RMSE (n_factors, n_outputs), and what is worst.

    ``worst``: the largest share of a block's squared error that the whole correction leaves.
    """

    factors: np.ndarray
    fade: float
    supports: list[Support]
    rmse: np.ndarray
    worst: float

    @property
    def closed(self) -> float:
        """Gain, mean over outputs."""
        return float(np.mean([support.closed for support in self.supports]))


def reaches(departures: np.ndarray) -> list[tuple[float, float]]:
    """Reaches of a correction beyond its data, farthest first, each with the share of a block's squared error that it may leave.

    As far as two left-out blocks have gone beyond the data of the others, a correction may act in any case: one block does not
    show how errors vary from block to block. As far as one has gone, it must halve the error of every block. Farther out there
    are no data, and only a correction that follows the plant may act.

    ``departures`` (n_blocks,): see :meth:`LeftOut.departures`.

    >>> import numpy as np
    >>> reaches(np.array([0.0, 0.4, 0.2, 0.0]))
    [(1.0, 0.1), (0.4, 0.25), (0.2, inf)]
    """
    second, first = np.clip(np.sort(np.append(departures, [0.0, 0.0]))[-2:], SHORTEST, LONGEST).tolist()
    # of equal reaches the least strict condition stands
    return list({LONGEST: LEFT_ANYWHERE, first: LEFT_ONCE, second: np.inf}.items())


def _judged_outside(left_out: LeftOut, fade: float, size: np.ndarray) -> _Judged:
    """A share for every output."""
    power, rmse = _power(left_out.errors(SHARES, fade), left_out)
    supports = [supported(power[:, :, j], SHARES) for j in range(len(size))]
    return _Judged(SHARES, fade, supports, rmse, _worst(np.sum(power / size**2, axis=2)))


def _judged_inside(left_out: LeftOut, fade: float, size: np.ndarray) -> _Judged:
    """One share for all outputs: none, half or all of the term, each simulated."""
    factors = np.array([0.0, 0.5, 1.0])
    power, rmse = _power(left_out.errors(factors, fade), left_out)
    total = np.sum(power / size**2, axis=2)
    return _Judged(factors, fade, [supported(total, factors)] * len(size), rmse, _worst(total))


def _worst(power: np.ndarray) -> float:
    """The largest share that the whole correction leaves of a block, ``power`` (n_factors, n_blocks).

    A block in which the simulator errs less than on average counts as an average one: there is little to gain.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        left = power[-1] / np.maximum(power[0], np.mean(power[0]))
    return float(np.max(left)) if np.all(np.isfinite(left)) else np.inf


def _power(errors: list[np.ndarray], left_out: LeftOut) -> tuple[np.ndarray, np.ndarray]:
    """Squared errors of blocks (n_factors, n_blocks, n_outputs), and RMSE (n_factors, n_outputs)."""
    power = block_powers(errors, left_out.ends, [len(U) for U in left_out.inputs])
    return power, np.sqrt(power.sum(axis=1) / sum(error.shape[1] for error in errors))


def reach(fade: float | str) -> float:
    """``fade`` as a number: "evidence" as far as it goes while nothing has been left out."""
    return LONGEST if fade == "evidence" else float(fade)


def surrogate_alone(
    correction: Any, inputs: Sequence[np.ndarray], measured: Sequence[np.ndarray], judged: bool
) -> CorrectionReport:
    """Without a simulator all is kept; ``judged``: its error on left-out runs is measured."""
    o, fade = measured[0].shape[1], correction.domain.fade
    errors = LeftOut(correction, inputs, measured).errors(np.ones(1)) if judged else []
    every = np.concatenate([error[0] for error in errors]) if errors else np.empty((0, o))
    every = every[np.isfinite(every).all(axis=1)]
    rmse = np.sqrt(np.mean(every**2, axis=0)) if len(every) else np.full(o, np.nan)
    correction.keep(np.ones(o), fade)
    return CorrectionReport(np.ones(o), fade, np.full(o, np.nan), rmse, rmse, np.nan, np.nan, 0, _NO_SIMULATOR)


_NO_SIMULATOR = "There is no simulator to fall back on: the surrogate is used as it is."
_TOO_SHORT = (
    "The runs are too short to leave blocks out, so nothing supports a correction: the simulator is used alone. "
    "Give longer runs, or fewer lags (n_lags)."
)


def _sentence(name: str, share: float, simulator: float, whole: float, kept: float) -> str:
    """One output."""
    numbers = f"simulator {simulator:.3g}, whole correction {whole:.3g}"
    if share == 0.0:
        return f"{name}: left-out runs do not support the correction (RMSE: {numbers}); the simulator is used alone."
    if share == 1.0:
        return f"{name}: left-out runs support the whole correction (RMSE: {numbers})."
    return (
        f"{name}: left-out runs support {100 * share:.0f} % of the correction (RMSE: {numbers}, kept share {kept:.3g})."
    )
