"""The column that says which run a row belongs to, kept beside the features."""

from __future__ import annotations

import numpy as np

from sksurrogate.exceptions import DataError
from sksurrogate.runs import Runs


def kept_run(runs: Runs) -> np.ndarray:
    """Label of the run of every row, (n_samples,); nan outside of runs.

    Raises :class:`~sksurrogate.exceptions.DataError` where a label is not a number.
    """
    labels = np.full(runs.n_samples, np.nan)
    for run in runs:
        try:
            labels[run.start : run.stop] = float(run.label)
        except (TypeError, ValueError):
            raise DataError(
                f"keep_run=True, and run {run.label!r} is not a number, as the columns beside it are. Number the runs, for example by "
                "pandas.factorize(column)[0], or leave the column out (keep_run=False) and give groups to the next step."
            ) from None
    return labels
