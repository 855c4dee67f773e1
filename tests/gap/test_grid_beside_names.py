"""Readings of a coarse display beside a named effect: the grid is said, with its step."""

import numpy as np

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N, RUNS, RATE, DRAG, STEP = 0.1, 200, 3, 0.5, 0.2, 0.05


def test_a_grid_that_nothing_named_explains_is_a_note_beside_names():
    names = {"states": ["x"], "inputs": ["u"], "outputs": ["x"], "dt": DT}
    tank = ODESimulator(lambda t, x, u, p: (u[0] - p["rate"] * x[0],), params={"rate": RATE}, **names)
    plant = ODESimulator(lambda t, x, u, p: (u[0] - RATE * x[0] - DRAG * x[0] * abs(x[0]),), params={}, **names)
    rng = np.random.default_rng(0)
    runs = [np.repeat(rng.uniform(-1.0, 2.0, N // 10), 10)[:, None] for _ in range(RUNS)]
    y = np.concatenate([STEP * np.round((plant.simulate(u) + 0.003 * rng.normal(size=(N, 1))) / STEP) for u in runs])
    diagnoser = GapDiagnoser(tank, effects=["quadratic_drag"], random_state=0, n_jobs=1)
    report = diagnoser.fit(np.concatenate(runs), y[:, 0], groups=np.repeat(range(RUNS), N)).report_
    assert (report.verdict, report.reasons.rule) == ("partial", "grid_beside_names")
    assert any("'x' stand on steps of 0.05" in note for note in report.notes)
