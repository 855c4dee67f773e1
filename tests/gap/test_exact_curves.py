"""Dry and viscous friction of one speed: at the noise together, far from it with one alone, both are named with their sizes."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N, RUNS, PARTS, MASS, SPRING, DRY, VISCOUS = 0.02, 300, 4, 50, 2.0, 30.0, 2.45, 0.45
BLOCK = ODESimulator(
    lambda t, x, u, p: (x[1], (u[0] - SPRING * x[0]) / p["mass"]),
    states=["x", "v"], inputs=["force"], outputs=["x"], params={"mass": MASS}, dt=DT,
)  # fmt: skip


def pushed(force):
    """Positions (n_runs, N) of blocks that stick where the force does not move them, by semi-implicit Euler in short steps."""
    x, v, h, out = np.zeros(len(force)), np.zeros(len(force)), DT / PARTS, np.empty(force.shape)
    for k in range(force.shape[1]):
        out[:, k] = x
        for _ in range(PARTS):
            free = v + h * (force[:, k] - SPRING * x) / MASS
            v = np.sign(free) * np.maximum(np.abs(free) - h * DRY, 0.0) / (1.0 + h * VISCOUS)
            x = x + h * v
    return out


@pytest.fixture(scope="module")
def report():
    rng = np.random.default_rng(0)
    force = np.repeat(rng.uniform(-25.0, 25.0, (RUNS, N // 15)), 15, axis=1)
    y = pushed(force) + 0.004 * rng.standard_normal(force.shape)
    diagnoser = GapDiagnoser(
        BLOCK, effects=["coulomb_friction", "linear_loss", "quadratic_drag"], random_state=0, n_jobs=1
    )
    return diagnoser.fit(force.reshape(-1, 1), y.ravel(), groups=np.repeat(range(RUNS), N)).report_


def test_both_frictions_are_named_with_their_sizes(report):
    found = {effect.name: next(iter(effect.params.values())) for effect in report.effects}
    assert report.verdict == "explained" and set(found) == {"coulomb_friction", "linear_loss"}
    assert found["coulomb_friction"] == pytest.approx(DRY, rel=0.02)
    assert found["linear_loss"] == pytest.approx(VISCOUS, rel=0.05)


def test_no_width_of_the_kink_stands_for_the_viscous_part(report):
    assert not any("kink" in note for note in report.notes)
