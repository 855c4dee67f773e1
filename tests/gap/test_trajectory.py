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


def test_a_parameter_and_other_initial_states_are_found_through_a_callable():
    from sksurrogate.physics import CallableSimulator

    def simulate(U, x0, p):
        y = np.zeros(len(U))
        y[0] = x0[0]
        for k in range(len(U) - 1):
            y[k + 1] = p["a"] * y[k] + p["b"] * U[k, 0]
        return y

    plant = CallableSimulator(simulate, inputs=["u"], outputs=["y"], params={"a": 0.9, "b": 0.1}, dt=0.1, x0=[0.0])
    rng = np.random.default_rng(2)
    U = np.repeat(rng.uniform(-1, 1, 60), 5)[:, None]
    groups = np.repeat([0, 1, 2], 100)
    true = {"a": 0.87, "b": 0.1}
    Y = np.concatenate([simulate(U[groups == run], [0.5 * run], true) for run in range(3)])
    report = (
        GapDiagnoser(plant, effects=["parameter_error", "sensor_bias", "sensor_gain"], random_state=0)
        .fit(U, Y + 0.003 * rng.normal(size=Y.shape), groups=groups)
        .report_
    )
    assert [(e.name, e.location) for e in report.effects] == [("parameter_error", "a")]
    low, high = report.effects[0].intervals["relative_error"]
    assert low < 0.87 / 0.9 - 1 < high


def test_a_table_of_outputs_is_enough_for_sensors():
    from sksurrogate.physics import TableSimulator

    X, y, groups = measured(0.0, 3)
    table = TableSimulator(X, y, groups=groups, inputs=["u"], outputs=["y"], dt=0.1)
    rng = np.random.default_rng(4)
    report = (
        GapDiagnoser(table, effects=["sensor_gain", "sensor_bias", "input_gain"], random_state=0)
        .fit(X, 1.2 * y + 0.005 * rng.normal(size=y.shape), groups=groups)
        .report_
    )
    assert report.effects[0].name == "sensor_gain" and "input_gain" in report.untestable
