"""Ctrl-C at any moment: what is known by then stays, and prints, or nothing was known yet and the interrupt passes on."""

import pickle
import warnings

import numpy as np
import pytest

from sksurrogate.datasets import make_reactor_runs, reactor_rhs
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

X, y, groups = make_reactor_runs(3, 60, noise=0.02, random_state=0)
NAMES = ["parameter_error", "sensor_bias", "input_lag"]


class Calls:
    """Counts calls of the right-hand side and interrupts at one of them."""

    count = 0
    at: float = np.inf


def counting_rhs(t, x, u, p):
    Calls.count += 1
    if Calls.count == Calls.at:
        raise KeyboardInterrupt
    return reactor_rhs(t, x, u, p)


def diagnose(at):
    """A diagnosis that is interrupted at a call."""
    Calls.count, Calls.at = 0, at
    params = {"flow": 2.0, "feed": 4.0, "second": 70.0, "first": 1000.0}
    simulator = ODESimulator(counting_rhs, states=["y"], inputs=["u"], outputs=["y"], params=params, dt=0.02, x0=[4.0])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        diagnoser = GapDiagnoser(simulator, effects=NAMES, n_jobs=1, random_state=0).fit(X, y, groups=groups)
    return diagnoser, [str(w.message) for w in said]


@pytest.fixture(scope="module")
def calls():
    """How many calls an undisturbed diagnosis makes."""
    diagnoser, _ = diagnose(np.inf)
    assert diagnoser.report_.complete
    return Calls.count


@pytest.mark.parametrize("share", [0.002, 0.05, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 0.97])
def test_an_interrupt_at_any_moment(share, calls):
    try:
        diagnoser, said = diagnose(max(1, int(share * calls)))
    except KeyboardInterrupt:
        assert share < 0.5, "an interrupt late in the work must not lose it"
        return
    finally:
        Calls.at = np.inf
    report = diagnoser.report_
    assert not report.complete
    assert any("interrupt" in message.lower() for message in said)
    assert "interrupted" in str(report) and "Interrupted" in report.to_html()
    assert report.verdict in ("none", "explained", "partial", "unknown")
    assert str(pickle.loads(pickle.dumps(report))) == str(report)
    found = diagnoser.augmented_.simulate(X[groups == 0], x0=y[:1])
    assert np.isfinite(found).all()
