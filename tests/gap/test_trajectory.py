"""A simulator with ``simulate`` alone: input and sensor effects are named, the rest is listed as untestable."""

import numpy as np

from sksurrogate.gap import GapDiagnoser


class FirstOrder:
    """A callable plant without names, states or right-hand side."""

    inputs, outputs, dt = ("u",), ("y",), 0.1

    def simulate(self, U, x0=None, t=None):
        y = np.zeros(len(U))
        for k in range(len(U) - 1):
            y[k + 1] = y[k] + (1 - np.exp(-0.1)) * (U[k, 0] - y[k])
        return y[:, None]


def measured(bias, seed):
    rng = np.random.default_rng(seed)
    U = np.repeat(rng.uniform(-1, 1, 80), 5)[:, None]
    groups = np.repeat([0, 1], 200)
    Y = np.concatenate([FirstOrder().simulate(U[groups == run]) for run in (0, 1)])
    return U, Y + bias + 0.005 * rng.normal(size=Y.shape), groups


def test_a_sensor_bias_is_named():
    X, y, groups = measured(0.2, 0)
    diagnoser = GapDiagnoser(FirstOrder(), random_state=0).fit(X, y, groups=groups)
    report = diagnoser.report_
    assert report.verdict == "explained"
    assert report.effects[0].name == "sensor_bias"
    low, high = report.effects[0].intervals["value"]
    assert low < 0.2 < high
    assert "coulomb_friction" in report.untestable and report.notes
    again = diagnoser.augmented_.simulate(X[groups == 0])
    assert abs(float(np.mean(again - FirstOrder().simulate(X[groups == 0]))) - 0.2) < 0.01


def test_no_gap_gets_none():
    X, y, groups = measured(0.0, 1)
    report = GapDiagnoser(FirstOrder(), random_state=0).fit(X, y, groups=groups).report_
    assert report.verdict == "none" and report.effects == []
