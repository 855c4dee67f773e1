"""The gap of a case is what initial states, and parameters where asked, cannot close."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.blind import _gap
from sksurrogate.blind._cases import draw
from sksurrogate.blind._excite import inputs, operating_log
from sksurrogate.blind._gap import INTEGRATOR_SUBSTEPS, gap_beyond
from sksurrogate.blind._march import march
from sksurrogate.blind._plants import PLANTS


@pytest.fixture
def experiment():
    plant = PLANTS["two_rooms"]
    U = inputs(np.random.default_rng(0), plant, "steps", 2, 120)
    X0 = draw("none", 3, plant=plant).starts[:1].repeat(2, axis=0)
    return plant, U, X0


def test_other_initial_states_are_no_gap(experiment):
    plant, U, X0 = experiment
    outputs = march(plant, U, X0 + 0.3, substeps=INTEGRATOR_SUBSTEPS).outputs
    unit = 0.01 * outputs.reshape(-1, outputs.shape[-1]).std(axis=0)
    assert gap_beyond(plant, U, X0, outputs, unit) < 1e-3


def test_other_parameters_are_a_gap_until_they_are_free(experiment):
    plant, U, X0 = experiment
    moved = replace(plant, params={name: 1.03 * value for name, value in plant.params.items()})
    outputs = march(moved, U, X0, substeps=INTEGRATOR_SUBSTEPS).outputs
    unit = 0.01 * outputs.reshape(-1, outputs.shape[-1]).std(axis=0)
    assert gap_beyond(plant, U, X0, outputs, unit) > 0.3
    assert gap_beyond(plant, U, X0, outputs, unit, retune=True) < 1e-2


def test_a_neighbour_that_diverges_ends_the_search(experiment, monkeypatch):
    plant, U, X0 = experiment
    outputs = march(plant, U, X0 + 0.3, substeps=INTEGRATOR_SUBSTEPS).outputs
    unit, pushed = np.ones(outputs.shape[-1]), _gap._pushed

    def diverging(*given):
        followed = pushed(*given)
        followed[-1, :, -1] = np.inf
        return followed

    monkeypatch.setattr(_gap, "_pushed", diverging)
    plain = march(plant, U, X0, substeps=INTEGRATOR_SUBSTEPS).outputs
    assert gap_beyond(plant, U, X0, outputs, unit) == pytest.approx(np.sqrt(np.mean((outputs - plain) ** 2)))


def test_an_output_that_is_not_measured_does_not_count(experiment):
    plant, U, X0 = experiment
    outputs = march(plant, U, X0, substeps=INTEGRATOR_SUBSTEPS).outputs
    unit = np.ones(outputs.shape[-1])
    outputs[..., 0] += np.arange(outputs.shape[1])  # a drift that no initial state makes
    assert gap_beyond(plant, U, X0, outputs, unit) > 1
    unit[0] = np.inf
    assert gap_beyond(plant, U, X0, outputs, unit) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_drawn_gaps_are_at_least_four_times_the_noise(seed):
    assert draw("effect", seed).facts["gap_over_noise"] >= 4.0


@pytest.mark.parametrize("seed", range(5))
def test_a_log_holds_its_levels_and_moves_on_by_ramps(seed):
    log = operating_log(np.random.default_rng(seed), 400)
    assert len(log) == 400 and np.abs(log).max() < 2.0 and np.ptp(log[:10]) == 0.0
    assert np.mean(np.diff(log) == 0) > 0.5 > np.mean(np.abs(np.diff(log)) > 0.3)
