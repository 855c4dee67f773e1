"""The bar of the generic correction: kept where left-out runs support it, the simulator elsewhere."""

from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.neighbors import KNeighborsRegressor

from sksurrogate.compose import HybridRegressor
from sksurrogate.datasets import linear_reactor, make_reactor, make_reactor_runs
from sksurrogate.gap.decide._generic_correction import generic_correction
from sksurrogate.gap.render._waterfall import closed, waterfall
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.kernels.record import Record

FOLD = np.arange(6) % 2


def reactor_record(noise):
    X, y, groups = make_reactor_runs(6, 80, noise=noise, random_state=0)
    runs = [groups == k for k in range(6)]
    times = [0.02 * np.arange(80)] * 6
    return Record.from_runs([X[rows] for rows in runs], [y[rows][:, None] for rows in runs], times, 0.02)


def simulated(simulator, record):
    ends = record.starts + record.lengths
    parts = [simulator.simulate(record.u[:, a:b].T, x0=record.y[:, a]) for a, b in zip(record.starts, ends)]
    return np.concatenate(parts).T


def test_a_gap_is_closed_and_noise_is_not_learned():
    record = reactor_record(0.02)
    found = generic_correction(linear_reactor(), None)(record, FOLD)
    before = simulated(linear_reactor(), record) - record.y
    assert np.std(found - record.y) < 0.5 * np.std(before)  # learned from three short runs
    record = reactor_record(0.3)
    found = generic_correction(make_reactor(), None)(record, FOLD)
    before = simulated(make_reactor(), record) - record.y
    assert np.std(found - record.y) < 1.02 * np.std(before)


def test_a_correction_of_your_own_predicts_as_it_does_alone():
    record, own = reactor_record(0.02), HybridRegressor(linear_reactor(), KNeighborsRegressor(3), "static", n_lags=2)
    found = generic_correction(linear_reactor(), own)(record, FOLD)
    test = np.isin(record.run_of_row, np.flatnonzero(FOLD == 0))
    fitted = own.fit(record.u[:, ~test].T, record.y[0, ~test], groups=record.run_of_row[~test])
    first = np.stack([record.y[:, a : a + 2].T for a in record.starts[FOLD == 0]])
    expected = fitted.predict(record.u[:, test].T, y0=first, groups=record.run_of_row[test])
    np.testing.assert_allclose(found[0, test], expected, rtol=1e-12)


def test_of_a_piece_of_a_few_rows_all_are_given():
    whole = reactor_record(0.02)
    pieces = whole.cut(np.union1d(whole.starts, [37, 40, 203]))
    found = generic_correction(linear_reactor(), None)(pieces, np.array([0, 0, 0, 1, 0, 0, 1, 0, 1]))
    np.testing.assert_array_equal(found[:, 37:40], whole.y[:, 37:40])
    assert np.isfinite(found).all() and np.std(found - whole.y) < 0.2 * np.std(whole.y)


def test_what_makes_left_out_runs_worse_is_called_no_help():
    shrink = SimpleNamespace(
        before=0.1, after=0.02, floor=0.01, after_retuning=0.2, after_correction=0.05, after_law=np.nan
    )
    labels = [label for label, _ in waterfall(SimpleNamespace(shrink=shrink, effects=["friction"], law=None))]
    assert labels == [
        "simulator",
        "re-tuned parameters alone (no help)",
        "generic correction",
        "with the effects",
        "noise",
    ]


@pytest.mark.parametrize(
    ("effects", "retuned", "said"),
    [(["lag"], [], "Closed: "), (["lag"], ["k"], "Closed: "), ([], ["k"], "Closed by re-tuning: "), ([], [], None)],
)
def test_what_is_closed_is_said_where_something_closes_it(effects, retuned, said):
    shrink = Shrink(0.5, 0.1, 0.02, 0.8, (0.7, 0.9), fraction_power=0.96)
    report = SimpleNamespace(shrink=shrink, effects=effects, retuned=retuned, certified_law=None)
    lines = closed(report)
    assert len(lines) == (said is not None)
    if said:
        assert lines[0].startswith(said) and "90 % interval 70.0 to 90.0 %" in lines[0]
