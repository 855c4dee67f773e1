"""Plants without inputs, and signals that never move."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.exceptions import DataError, SimulatorError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import CalibratedSimulator, ODESimulator

EFFECTS = ["quadratic_drag", "linear_loss", "exchange", "constant_bias", "input_bias", "cubic_stiffness"]
GROUPS = np.repeat([0, 1], 150)


def swing(drag=0.0, inputs=()):
    def rhs(t, x, u, p):
        return x[1], -4.0 * x[0] - p["c"] * x[1] - p["drag"] * x[1] * abs(x[1])

    params = {"c": 0.1, "drag": drag}
    return ODESimulator(
        rhs, states=["q", "v"], inputs=list(inputs), outputs=["q"], params=params, dt=0.05, x0=[1.0, 0.0]
    )


@pytest.fixture(scope="module")
def readings():
    runs = [swing(0.3).simulate(np.zeros((150, 0)), x0=[a, 0.0]) for a in (1.0, 0.5)]
    return np.vstack(runs) + 0.003 * np.random.default_rng(0).normal(size=(300, 1))


def names(diagnoser):
    return [(e.name, e.location, e.variable) for e in diagnoser.report_.effects]


def test_a_plant_without_inputs_needs_no_dummy(readings):
    diagnoser = GapDiagnoser(swing(), effects=EFFECTS, random_state=0, n_jobs=1).fit(None, readings, groups=GROUPS)
    assert names(diagnoser) == [("quadratic_drag", "v", "v")]
    again = diagnoser.augmented_.simulate(np.zeros((150, 0)), x0=diagnoser.initial_states_[0])
    np.testing.assert_allclose(again, readings[:150], atol=0.02)
    for X in (None, np.zeros((300, 0))):
        found = CalibratedSimulator(swing(), ["drag", "c"]).fit(X, readings[:, 0], groups=GROUPS)
        assert found.params_["drag"] == pytest.approx(0.3, abs=0.02)


@pytest.mark.slow
def test_an_input_that_never_moves_drives_no_candidate(readings):
    plant = swing(inputs=["room"])
    diagnoser = GapDiagnoser(plant, effects=EFFECTS, random_state=0, n_jobs=1)
    diagnoser.fit(np.full((300, 1), 20.0), readings, groups=GROUPS)
    assert names(diagnoser) == [("quadratic_drag", "v", "v")]
    assert not any("room" in (row["location"], row["variable"]) for row in diagnoser.report_.ranking)
    asked = [CATALOGUE["exchange"]("v", "room"), *EFFECTS]
    diagnoser = GapDiagnoser(plant, effects=asked, random_state=0, n_jobs=1)
    diagnoser.fit(np.full((300, 1), 20.0), readings, groups=GROUPS)
    rows = {(row["name"], row["variable"]) for row in diagnoser.report_.ranking if row["variable"] == "room"}
    assert rows == {("exchange", "room")}  # what is asked for by place stays


def test_what_cannot_be_diagnosed_is_said_at_once(readings):
    with pytest.raises(DataError, match=r"never moves in column 'q': it is 1 in all rows.*leave the output out"):
        GapDiagnoser(swing()).fit(None, np.where(readings > 0, 1.0, np.nan), groups=GROUPS)
    with pytest.raises(SimulatorError, match=r"X has 0 columns, but the simulator has 1 inputs \['u'\]"):
        GapDiagnoser(swing(inputs=["u"])).fit(None, readings, groups=GROUPS)
