"""How far the gap shrinks on runs left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sksurrogate.gap.results._table import EMPTY, Table


@dataclass(frozen=True)
class Shrink:
    """How far the gap shrinks, free run on runs left out of the choice of the names and of the fit of their parameters.

    One fold of runs after another is left out (six at most; blocks where there are fewer than three runs). The other runs
    choose among the sets of as many effects that were fitted to all runs, by their own share of the likelihood, and keep the
    names unless another set gains over them what an effect must gain over none; parameters are refitted to them, and the fold is simulated, with initial states fitted there.
    Which sets were fitted, the noise and the number of effects come from all runs: to certify these too keep runs back from
    ``fit`` and simulate them with ``diagnoser.augmented_``.

    Attributes
    ----------
    before, after, floor : float
        RMSE of the free run, each output divided by its standard deviation.
    fraction : float
        ``1 - gap_after / gap_before`` with ``gap = sqrt(max(rmse^2 - floor^2, 0))``; nan without a gap.
    interval : (float, float)
        90 %.
    by_output : Table
        output, before, after, floor in units of the output, and fraction.
    after_retuning, fraction_retuning : float
        The same when the simulator's parameters are re-tuned and nothing else.
    after_correction, fraction_correction : float
        The same with the generic learned correction.
    fraction_power : float
        The same as ``fraction`` in energy, ``1 - gap_after^2 / gap_before^2``.
    measurable : bool
        False where the gap is not clearly above the floor.
    same_names : float
        Share of the folds whose other runs choose the same effects, up to those that no data here tell apart; nan where
        nothing is named.
    after_law, fraction_law, fraction_power_law : float
        The same with the law without a name of ``missing_term.law`` beside what is named, or in the place of what is not
        certain; nan where none was looked for.
    """

    before: float
    after: float
    floor: float
    fraction: float
    interval: tuple[float, float]
    by_output: Table = EMPTY
    after_retuning: float = np.nan
    fraction_retuning: float = np.nan
    after_correction: float = np.nan
    fraction_correction: float = np.nan
    fraction_power: float = np.nan
    measurable: bool = True
    same_names: float = np.nan
    after_law: float = np.nan
    fraction_law: float = np.nan
    fraction_power_law: float = np.nan


#: After an early interrupt.
NOT_KNOWN = Shrink(np.nan, np.nan, np.nan, np.nan, (np.nan, np.nan))
