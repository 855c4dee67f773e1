"""Sets that leave the same to a law: it is asked for once."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap._begin import build_problem
from sksurrogate.gap.decide import _contenders
from sksurrogate.gap.decide._contenders import judged_law
from sksurrogate.gap.decide._laws_asked import leaves_the_same
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe


@pytest.fixture(scope="module")
def tank():
    """A level that stays above zero and falls by 0.1 more a unit of time than the simulator says: sets that may say so, fitted."""

    def rhs(t, x, u, p):
        return [u[0] - p["outflow"] * x[0]]

    simulator = ODESimulator(rhs, states=["level"], inputs=["pump"], outputs=["level"], params={"outflow": 0.5}, dt=0.2)
    rng = np.random.default_rng(0)
    U = [np.repeat(rng.uniform(1.0, 2.0, 10), 20)[:, None] for _ in range(3)]
    y = [simulator.simulate(u - 0.1, x0=[2.0]) + 0.01 * rng.normal(size=(200, 1)) for u in U]
    record = Record.from_runs(U, y, [0.2 * np.arange(200)] * 3, 0.2)
    plant = describe(simulator, n_inputs=1, n_outputs=1, dt=0.2)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("level",))
    names = {"constant_bias": None, "coulomb_friction": "level", "linear_loss": "level"}
    sets = {
        name: problem.fit((CATALOGUE[name](*(("level", on) if on else ("level",))),), np.full(1, 0.05), smoothed.x)
        for name, on in names.items()
    }
    found = {name: estimate_noise(one, problem.first_noise()) for name, one in sets.items()}
    evidence = {id(one.candidate): one.log_likelihood for one in found.values()}
    search = SimpleNamespace(
        x=record.y.copy(), gap_over_noise=10.0, tolerance=0.1, laws=[], evidence=lambda one: evidence[id(one)]
    )
    return search, found


def test_a_friction_at_a_level_that_keeps_its_sign_leaves_the_same_as_a_constant_and_a_loss_does_not(tank):
    search, found = tank
    constant, friction, loss = (one.candidate for one in found.values())
    assert leaves_the_same(search, constant, constant) and leaves_the_same(search, constant, friction)
    assert not leaves_the_same(search, constant, loss) and not leaves_the_same(search, constant, None)


def test_a_law_is_asked_for_once_beside_sets_that_leave_the_same_to_it(tank, monkeypatch):
    search, found = tank
    noise, asked, of_old = (found["constant_bias"].noise,), [], _contenders.law_along
    monkeypatch.setattr(
        _contenders, "law_along", lambda *question: asked.append(question[1].candidate) or of_old(*question)
    )
    laws = {name: judged_law(search, one, one.candidate, along=False, noises=noise) for name, one in found.items()}
    assert laws["coulomb_friction"] is laws["constant_bias"] and laws["linear_loss"] is not laws["constant_bias"]
    assert set(map(id, asked)) == {id(found[name].candidate) for name in ("constant_bias", "linear_loss")}
    search.laws.clear()  # two ways to one number
    alone = judged_law(
        search, found["coulomb_friction"], found["coulomb_friction"].candidate, along=False, noises=noise
    )
    assert alone.total == pytest.approx(laws["constant_bias"].total, abs=0.1)
