"""A simulator that is not finite along the data is named by state, run, row and time, whoever asks."""

import numpy as np
import pytest

from sksurrogate.compose import HybridRegressor
from sksurrogate.exceptions import SimulatorError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.kernels.record import Record
from sksurrogate.physics import CalibratedSimulator, ODESimulator, StepSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._not_finite import not_finite_along
from sksurrogate.physics._simulator import describe


def root(t, x, u, p):
    return [u[0] - p["k"] * np.sqrt(x[0])]


NAMES = {"states": ["level"], "inputs": ["flow"], "outputs": ["level"], "params": {"k": 1.0}, "dt": 0.1}
tank = ODESimulator(root, **NAMES, x0=[1.0])
U = np.repeat(np.random.default_rng(0).uniform(0.5, 1.5, 12), 5)[:, None]
groups = np.repeat(["a", "b"], 30)
level = np.concatenate([tank.simulate(U[groups == g])[:, 0] for g in "ab"])
PLACE = r"state 'level' is not finite in 60 of 60 samples along the data, first in run {}, t = 0, from level = -\d"


@pytest.mark.parametrize(
    ("estimator", "run"),
    [
        (CalibratedSimulator(tank, params=["k"]), "'a', row 0"),
        (HybridRegressor(tank, form="dynamics"), "number 0, row 0"),
        (HybridRegressor(tank, form="input"), "number 0, row 0"),
        (GapDiagnoser(tank, effects=["sensor_bias"]), "'a', row 0"),
    ],
    ids=["calibrated", "dynamics", "input", "gap"],
)
def test_the_place_is_named(estimator, run):
    with (
        np.errstate(invalid="ignore"),
        pytest.raises(SimulatorError, match=PLACE.format(run) + r".*offset of the outputs.*np\.maximum"),
    ):
        estimator.fit(U, level - 6.0, groups=groups)


@pytest.mark.parametrize("row", [0, 29, 30, 47])
def test_one_sample_is_enough_and_is_found(row):
    spike = np.where(np.arange(60) == row, -1.0, level)
    record = Record.from_runs([U[:30], U[30:]], [spike[:30, None], spike[30:, None]], 2 * [0.1 * np.arange(30)], 0.1)
    found = not_finite_along(PlantModel(describe(tank)), record, ["a", "b"])
    where = f"first in run {'ab'[row // 30]!r}, row {row % 30}, t = {0.1 * (row % 30):g}, from level = -1, flow = "
    assert "not finite in 1 of 60 samples" in found and where in found
    assert "first in run number" in not_finite_along(PlantModel(describe(tank)), record)
    diagnoser = GapDiagnoser(tank, effects=["sensor_bias"])
    if 0 < row % 30 < 29:  # neighbours on both sides show that the reading is wrong: it is taken out, and said
        assert [(fault.kind, fault.location) for fault in diagnoser.fit(U, spike, groups=groups).report_.data] == [
            ("spikes", "level")
        ]
        return
    with pytest.raises(SimulatorError, match=rf"first in run .{'ab'[row // 30]}., row {row % 30}, t = "):
        diagnoser.fit(U, spike, groups=groups)


def test_an_output_and_a_step_are_named_too():
    def step(t, x, u, p, dt):
        return [x[0] + dt * u[0] / x[0]]

    def log(t, x, u, p):
        return [np.log(x[0])]

    record = Record.from_runs([U[:30]], [np.zeros((30, 1))], [0.1 * np.arange(30)], 0.1)
    stepped = StepSimulator(step, **NAMES, x0=[1.0])
    assert not_finite_along(PlantModel(describe(stepped)), record).startswith("state 'level' is not finite in 30 of 30")
    shown = ODESimulator(lambda t, x, u, p: [u[0]], **NAMES | {"outputs": ["seen"]}, output=log, x0=[-1.0])
    assert not_finite_along(PlantModel(describe(shown)), record).startswith("output 'seen' is not finite in 30 of 30")
    fine = ODESimulator(lambda t, x, u, p: [u[0] - x[0]], **NAMES, x0=[1.0])
    assert not_finite_along(PlantModel(describe(fine)), record) == ""
