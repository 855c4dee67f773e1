"""Fits side by side: asked for by ``n_jobs`` or by joblib's own setting, with the same answer."""

import re

import joblib
import numpy as np

from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.gap import GapDiagnoser


def printed(report):
    """The terminal page without when it was made and how long it took."""
    return re.sub(r"date:\s+\S+\s+[0-9:]+;\s+time\s+taken:\s+[0-9.]+\s+s", "", str(report))


def test_joblibs_setting_spreads_the_fits_and_changes_no_answer(monkeypatch):
    X, y, groups = make_reactor_runs(4, 80, noise=0.02, random_state=0)
    diagnoser = GapDiagnoser(
        make_reactor(second=80.0), effects=["parameter_error", "sensor_bias", "input_lag"], random_state=0
    )
    here = printed(diagnoser.fit(X, y, groups=groups).report_)
    asked = []

    def spy(**options):
        asked.append(joblib.effective_n_jobs(options["n_jobs"]))
        return joblib.Parallel(**options)

    monkeypatch.setattr("sksurrogate.gap.search._expander.Parallel", spy)
    assert printed(diagnoser.fit(X, y, groups=groups).report_) == here and not asked
    with joblib.parallel_config("threading", n_jobs=2):
        assert printed(diagnoser.fit(X, y, groups=groups).report_) == here
    assert asked and set(asked) == {2}
    assert np.isfinite(diagnoser.report_.shrink.fraction)
