"""Pieces of a run: an actuator remembers what came before them."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.exceptions import DataError
from sksurrogate.gap.fit._record_parts import blocked, excerpt
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

ACTUATORS = {"input_lag": 0.7, "input_delay": 0.35, "rate_limit": 1.3, "input_backlash": 0.2, "input_gain": 1.5}


def acting(record, effect, value, hold):
    """Inputs that act on an integrator: means, half rises and values at the samples."""
    plant = ODESimulator(
        lambda t, x, u, p: (u[0],), states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1, hold=hold
    )
    model = AugmentedModel(
        PlantModel(describe(plant)), [effect] if effect else [], [], record, n_sub=2, scale=np.ones(1)
    )
    bound = model.bind(np.full((len(effect.parameters) if effect else 0, 1), value))
    return [part for part in (bound._mean, bound._half, bound.shown) if part is not None]


def steps(n_runs, rows=120):
    rng = np.random.default_rng(0)
    U = [np.repeat(2.0 + rng.uniform(-1, 1, rows // 12), 12)[:, None] for _ in range(n_runs)]
    return Record.from_runs(U, [np.zeros((rows, 1))] * n_runs, [0.1 * np.arange(rows)] * n_runs, 0.1)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
@pytest.mark.parametrize("before", [None, 0.0])
@pytest.mark.parametrize("name", ACTUATORS)
def test_pieces_get_what_the_whole_run_gets_there(name, before, hold):
    whole = steps(2)
    kind = CATALOGUE[name]
    effect = kind("u") if name == "input_gain" else kind("u", before=before)
    blocks = blocked(whole)
    assert len(blocks.starts) == 4
    for pieces in ([0, 1, 2, 3], [1], [0, 3], [1, 2]):
        rows = np.concatenate([np.arange(*blocks.spans[k]) for k in pieces])
        for part, all_of_it in zip(
            acting(blocks.select(pieces), effect, ACTUATORS[name], hold), acting(whole, effect, ACTUATORS[name], hold)
        ):
            np.testing.assert_allclose(part, all_of_it[..., rows], rtol=0, atol=1e-12)


def test_the_plain_input_of_a_piece_ramps_to_what_follows():
    whole = steps(1)
    blocks = blocked(whole)
    for part, all_of_it in zip(acting(blocks.select([1]), None, 0.0, "foh"), acting(whole, None, 0.0, "foh")):
        np.testing.assert_array_equal(part, all_of_it[..., slice(*blocks.spans[1])])


def test_what_was_before_a_run_was_not_before_a_piece_from_within_it():
    """Of an excerpt of a long record what came before its pieces is not kept: they begin at their own first value."""
    whole = steps(1, 12_000)
    part, _ = excerpt(whole, 3000)
    begun = part.recorded_starts
    assert part.whole_starts.tolist() == [True] + [False] * (len(begun) - 1) and len(begun) > 1
    shown = acting(part, CATALOGUE["input_lag"]("u", before=0.0), 0.7, "zoh")[-1][0, 0]
    np.testing.assert_allclose(shown[begun], np.r_[0.0, part.u[0, begun[1:]]], atol=1e-12)


def test_other_inputs_of_a_piece_are_in_its_history():
    """What acts on a cut record with other inputs is what acts on these, cut."""
    whole, effect = steps(2), CATALOGUE["input_lag"]("u")
    changed = acting(blocked(whole).with_inputs(3.0 * whole.u), effect, 0.7, "zoh")
    for part, scaled in zip(changed, acting(whole, effect, 0.7, "zoh")):
        np.testing.assert_allclose(part, 3.0 * scaled, rtol=1e-12)


@pytest.mark.parametrize("before", [np.nan, np.inf, "0", True, [0.5], np.array(0.5)], ids=repr)
def test_what_was_before_a_run_is_a_number(before):
    plant = ODESimulator(lambda t, x, u, p: (u[0],), states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1)
    with pytest.raises(DataError, match=r"before=.*expected a finite number"):
        AugmentedSimulator(plant, [CATALOGUE["input_delay"]("u", before=before)], [(0.2,)]).simulate(np.ones((5, 1)))
    with pytest.raises(DataError, match=r"earliest=.*expected a finite number"):
        AugmentedSimulator(plant, [CATALOGUE["sensor_delay"]("x", earliest=before)], [(0.2,)]).simulate(np.ones((5, 1)))
