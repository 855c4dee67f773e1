"""A kink has a width on a real plant: it is fitted where the data show it, carried, said, and asked of no form without one."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
from sksurrogate.effects._smooth import KINK_SHARPNESS
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.render._code import code_of
from sksurrogate.gap.search._kink_width import rounded
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, RUNS = 0.05, 200, 3
LEVEL, WIDTH, NOISE = 0.5, 0.15, 0.003


def cart(friction):
    return ODESimulator(
        lambda t, x, u, p: [x[1], u[0] - 2.0 * x[0] - 0.2 * x[1] - friction(x[1])],
        dt=DT, x0=[0.0, 0.0], states=["place", "speed"], inputs=["force"], outputs=["place"], params={},
    )  # fmt: skip


NOMINAL = cart(lambda v: 0.0 * v)
COULOMB = CATALOGUE["coulomb_friction"]("speed", "speed")


def recorded(plant, noise=NOISE):
    rng = np.random.default_rng(1)
    U = [np.repeat(rng.uniform(-2.5, 2.5, N // 20), 20)[:, None] for _ in range(RUNS)]
    return U, [np.reshape(plant.simulate(u), (N, 1)) + noise * rng.normal(size=(N, 1)) for u in U]


def friction_fitted(plant, noise=NOISE):
    """The set with the friction, fitted to a plant."""
    U, Y = recorded(plant, noise)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    known = describe(NOMINAL, n_inputs=1, n_outputs=1, dt=DT)
    problem, smoothed = build_problem(PlantModel(known), record, (), ("speed",))
    return problem.fit((COULOMB,), np.array([LEVEL]), smoothed.x)


@pytest.fixture(scope="module")
def fitted():
    """A plant whose friction has a width, and one whose friction jumps."""
    round_one = friction_fitted(cart(lambda v: LEVEL * np.tanh(v / WIDTH)))
    return round_one, friction_fitted(AugmentedSimulator(NOMINAL, [COULOMB], [(LEVEL,)]))


@pytest.mark.slow
def test_a_narrow_width_is_found_between_that_of_numerics_and_the_first_wider_one():
    candidate = friction_fitted(cart(lambda v: LEVEL * np.tanh(v / 0.02)), NOISE / 6)
    best = rounded(candidate, price=10.0)
    assert best.model.bind(best.fit.theta[:, None]).widths == pytest.approx([0.02], rel=0.25)
    assert best.fit.cost < 0.5 * candidate.fit.cost


def test_the_width_is_that_of_the_plant(fitted):
    candidate, _ = fitted
    best = rounded(candidate, price=10.0)
    assert best.problem.numerics.rounded
    assert best.model.bind(best.fit.theta[:, None]).widths == pytest.approx([WIDTH], rel=0.25)
    assert best.fit.theta == pytest.approx([LEVEL], rel=0.02)
    sharp, wide = (float(np.sqrt(np.mean(one.residual**2))) for one in (candidate, best))
    assert wide < 1.05 * NOISE < 1.3 * NOISE < sharp


def test_a_jump_stays_a_jump(fitted):
    _, candidate = fitted
    assert rounded(candidate, price=10.0) is candidate


def test_the_price_decides(fitted):
    candidate, _ = fitted
    assert rounded(candidate, price=1e6) is candidate


def test_a_form_without_a_kink_has_no_width(fitted):
    candidate, _ = fitted
    loss = candidate.problem.fit((CATALOGUE["linear_loss"]("speed", "speed"),), np.array([0.1]), candidate.fit.x)
    assert rounded(loss, price=0.0) is loss


@pytest.mark.slow
def test_it_is_carried_saved_and_said(tmp_path):
    U, Y = recorded(cart(lambda v: LEVEL * np.tanh(v / WIDTH)))
    groups = np.repeat(np.arange(RUNS), N)
    found = GapDiagnoser(NOMINAL, effects=["coulomb_friction", "linear_loss"], n_jobs=1, random_state=0)
    found.fit(np.concatenate(U), np.concatenate(Y), groups=groups)
    report, carried = found.report_, found.augmented_
    assert [effect.name for effect in report.effects] == ["coulomb_friction"]
    assert carried.sharpness == report.sharpness < KINK_SHARPNESS
    assert any("smooth turn" in note for note in report.notes)
    assert f"sharpness={report.sharpness:.3g}"[:13] in code_of(report)
    rms = np.sqrt(np.mean([(np.reshape(carried.simulate(u), (N, 1)) - y) ** 2 for u, y in zip(U, Y)]))
    assert rms < 1.15 * NOISE
    save_augmented(carried, tmp_path / "found.json")
    assert load_augmented(NOMINAL, tmp_path / "found.json").sharpness == pytest.approx(carried.sharpness)
