"""Two inputs that reach each other's motor: as couplings of inputs, or as losses that an input drives, the plant is the same."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N, RUNS, CROSS = 0.1, 300, 3, 0.14
RATES = np.array([5.0, 4.0])
MODEL = ODESimulator(
    lambda t, x, u, p: (p["a"] * (u[0] - x[0]), p["b"] * (u[1] - x[1])),
    states=["roll", "pitch"], inputs=["lat", "lon"], outputs=["roll", "pitch"], params={"a": 5.0, "b": 4.0}, dt=DT,
)  # fmt: skip


@pytest.mark.slow
def test_both_couplings_are_certain_though_two_losses_do_the_same():
    rng = np.random.default_rng(0)
    U = np.repeat(rng.normal(size=(RUNS, N // 10, 2)), 10, axis=1)
    acting = U @ np.array([[1.0, CROSS], [-CROSS, 1.0]])  # lat - 0.14 lon, lon + 0.14 lat
    Y = np.zeros_like(U)
    for k in range(N - 1):
        Y[:, k + 1] = acting[:, k] + (Y[:, k] - acting[:, k]) * np.exp(-RATES * DT)
    noisy = Y + 0.02 * np.std(Y) * rng.standard_normal(Y.shape)
    groups = np.repeat(range(RUNS), N)
    report = (
        GapDiagnoser(MODEL, n_jobs=1, random_state=0).fit(U.reshape(-1, 2), noisy.reshape(-1, 2), groups=groups).report_
    )
    found = {(e.name, e.location, e.variable): e for e in report.effects}
    assert report.verdict == "explained" and set(found) == {
        ("input_coupling", "lat", "lon"),
        ("input_coupling", "lon", "lat"),
    }
    assert all(effect.probability > 0.9 for effect in found.values())
    assert found["input_coupling", "lat", "lon"].params["coefficient"] == pytest.approx(-CROSS, rel=0.03)
    assert found["input_coupling", "lon", "lat"].params["coefficient"] == pytest.approx(CROSS, rel=0.03)
    assert any("cannot tell linear loss at" in note for note in report.notes)
