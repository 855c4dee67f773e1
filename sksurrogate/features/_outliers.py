"""Outliers within a run."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from sklearn.utils._param_validation import Interval, StrOptions

from sksurrogate.exceptions import DataError
from sksurrogate.features._clean import BaseCleaner, fill_gaps
from sksurrogate.runs import Runs

#: Median absolute deviation of a normal variable times this is its standard deviation.
MAD_TO_SIGMA = 1.4826
#: Windows that are worked on at a time.
WINDOWS_IN_BLOCK = 4096
#: A column that deviates less than this share of its range is taken for one without noise.
NOISELESS_COLUMN = 1e-9


def moving_line(x: np.ndarray, window: int) -> tuple[np.ndarray, np.ndarray]:
    """Robust straight line through the rows around each row, and the spread about it.

    In each window of w rows: slope = median of the differences over w // 2 rows, level and spread = median and median
    absolute deviation (as a standard deviation) of what the slope leaves. At the ends the nearest whole window serves.

    ``x`` (n_samples,).
    Returns (n_samples,).

    >>> moving_line(np.array([0.0, 1.0, 2.0, 9.0, 4.0, 5.0]), window=5)[0]
    array([0., 1., 2., 3., 4., 5.])
    """
    n = len(x)
    width = min(window, n)
    half = width // 2
    if half == 0:
        return x.copy(), np.zeros(n)
    places = np.arange(width)
    slopes, levels, spreads = (np.empty(n - width + 1) for _ in range(3))
    windows = sliding_window_view(x, width)
    for a in range(0, len(windows), WINDOWS_IN_BLOCK):
        part = windows[a : a + WINDOWS_IN_BLOCK]
        slope = np.median(part[:, half:] - part[:, :-half], axis=1) / half
        rest = part - slope[:, None] * places
        level = np.median(rest, axis=1)
        spread = MAD_TO_SIGMA * np.median(np.abs(rest - level[:, None]), axis=1)
        slopes[a : a + WINDOWS_IN_BLOCK], levels[a : a + WINDOWS_IN_BLOCK], spreads[a : a + WINDOWS_IN_BLOCK] = (
            slope,
            level,
            spread,
        )
    rows = np.arange(n)
    starts = np.clip(rows - half, 0, n - width)
    return levels[starts] + slopes[starts] * (rows - starts), spreads[starts]


class OutlierFilter(BaseCleaner):
    """Find single wrong readings by a robust moving line within each run, and replace them by nan or by an estimate.

    A value is an outlier when it lies further than ``threshold`` standard deviations from the line through the ``window``
    rows around it (slope and level by medians). The standard deviation is the greater of the one in that window and the
    usual one of the column, both from median absolute deviations, so that neither a steep stretch nor a quiet one is
    cut. A column that usually does not deviate at all (an input held for many samples) is not changed.

    Parameters
    ----------
    window : int, default=11
        Rows of the moving line, odd, at least 5; four times as long as the longest burst of wrong readings or more.
    threshold : float, default=5.0
        Standard deviations.
    fill : {"nan", "linear", "previous", "pchip", "line"}, default="nan"
        Replacement of an outlier: nan, the value that :class:`Interpolator` would give, or the line.
    add_indicator : bool, default=False
        Whether to append a column of 0 and 1 for each column that says what was an outlier.
    run : None, column name, int or "index", default=None
        Where X says which run a row belongs to; ``groups`` wins.
    keep_run : bool, default=False
        Whether the run column is handed on as the last column.

    Attributes
    ----------
    scale_ : ndarray (n_columns,)
        Usual standard deviation from the moving line, in units of the column.
    n_features_in_ : int
    feature_names_in_ : ndarray of str
        Where X is a frame.

    Notes
    -----
    Missing values may be there and stay as they are.

    References
    ----------
    Hampel, "The influence curve and its role in robust estimation", J. Am. Stat. Assoc. 69 (1974).

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.features import OutlierFilter
    >>> x = np.sin(0.1 * np.arange(50))
    >>> x[20] = 9.0
    >>> np.flatnonzero(np.isnan(OutlierFilter().fit_transform(x[:, None])))
    array([20])
    """

    _marked = "outlier"
    _parameter_constraints: dict = {
        "window": [Interval(Integral, 5, None, closed="left")],
        "threshold": [Interval(Real, 0, None, closed="neither")],
        "fill": [StrOptions({"nan", "linear", "previous", "pchip", "line"})],
        "add_indicator": ["boolean"],
        "run": [None, str, Integral],
        "keep_run": ["boolean"],
    }

    def __init__(
        self,
        window: int = 11,
        threshold: float = 5.0,
        *,
        fill: str = "nan",
        add_indicator: bool = False,
        run: Any = None,
        keep_run: bool = False,
    ):
        self.window = window
        self.threshold = threshold
        self.fill = fill
        self.add_indicator = add_indicator
        self.run = run
        self.keep_run = keep_run

    def _learn(self, runs: Runs) -> None:
        if self.window % 2 == 0:
            raise DataError(f"window={self.window} must be odd, so that a row has as many before as after it.")
        distances = np.concatenate([self._distance(run.X)[0] for run in runs])
        values = np.concatenate([run.X for run in runs])
        self.scale_ = np.zeros(values.shape[1])
        for j, (distance, x) in enumerate(zip(distances.T, values.T)):
            known = ~np.isnan(x)
            if known.any():
                scale = MAD_TO_SIGMA * np.median(distance[known])
                self.scale_[j] = scale if scale > NOISELESS_COLUMN * np.ptp(x[known]) else 0.0

    def _distance(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How far each value of a run lies from the line (nan where missing), the spread there, and the line."""
        lines = [moving_line(fill_gaps(x), self.window) for x in values.T]
        line, spread = (np.column_stack(columns) for columns in zip(*lines))
        return np.abs(values - line), spread, line

    def _mask(self, values: np.ndarray) -> np.ndarray:
        distance, spread, _ = self._distance(values)
        return (distance > self.threshold * np.maximum(spread, self.scale_)) & (self.scale_ > 0)

    def _repair(self, values: np.ndarray, mask: np.ndarray) -> np.ndarray:
        out = values.copy()
        if self.fill == "line":
            out[mask] = self._distance(values)[2][mask]
            return out
        out[mask] = np.nan
        if self.fill == "nan":
            return out
        for j, x in enumerate(out.T):
            out[mask[:, j], j] = fill_gaps(x, self.fill)[mask[:, j]]
        return out
