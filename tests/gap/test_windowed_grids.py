"""A converter that fails during the runs: from then on, until then, or in between, readings stand on a grid."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N, RUNS, STEP = 0.25, 240, 4, 0.2


def tank(loss=0.0):
    return ODESimulator(
        lambda t, x, u, p: [u[0] - p["outflow"] * np.sqrt(np.maximum(x[0], 0.01)) - loss * x[0]],
        states=["level"], inputs=["pump"], outputs=["level"], params={"outflow": 1.0}, dt=DT, x0=[1.0],
    )  # fmt: skip


def recorded(first, last, missing=0.0, loss=0.0):
    """A tank whose level is read in steps from one age of the runs until another; X, y, groups and the simulator."""
    rng = np.random.default_rng(1)
    ages, groups = np.tile(np.arange(N), RUNS), np.repeat(np.arange(RUNS), N)
    X = np.repeat(rng.uniform(0.5, 2.0, RUNS * N // 20), 20)[:, None]
    y = np.concatenate([tank(loss).simulate(X[groups == run]) for run in range(RUNS)])
    y = y + 0.005 * rng.normal(size=y.shape)
    on = (ages >= first) & (ages < last)
    y[on] = STEP * np.round(y[on] / STEP) + 0.005 * rng.normal(size=(on.sum(), 1))
    y[rng.random(len(y)) < missing] = np.nan
    return tank(), X, y, groups


@pytest.mark.parametrize(
    ("first", "last", "missing", "times"),
    [(130, N, 0.0, {"onset": 130}), (0, 90, 0.0, {"end": 90}), (70, 190, 0.0, {"onset": 70, "end": 190}),
     (130, N, 0.2, {"onset": 130})],
    ids=["from", "until", "between", "from, a fifth missing"],
)  # fmt: skip
def test_the_part_is_found(first, last, missing, times):
    simulator, X, y, groups = recorded(first, last, missing)
    report = GapDiagnoser(simulator, n_jobs=1, random_state=0).fit(X, y, groups=groups).report_
    assert report.verdict == "explained"
    assert [(effect.name, effect.location) for effect in report.effects] == [("sensor_quantization", "level")]
    found = dict(report.effects[0].params)
    assert found.pop("step") == pytest.approx(STEP, rel=1e-2)
    assert found.keys() == times.keys()
    assert all(abs(found[name] - DT * age) < 2 * DT for name, age in times.items())


def test_steps_throughout_have_no_part():
    simulator, X, y, groups = recorded(0, N)
    report = GapDiagnoser(simulator, n_jobs=1, random_state=0).fit(X, y, groups=groups).report_
    assert [(effect.name, list(effect.params)) for effect in report.effects] == [("sensor_quantization", ["step"])]


def test_beside_a_loss_in_a_file_of_five_decimals():
    """The decimals are a fine grid of all readings, and no reason to leave the coarse one out; nor are readings before it spikes."""
    simulator, X, y, groups = recorded(130, N, loss=0.15)
    y[np.tile(np.arange(N) >= 130, RUNS)] = STEP / 2 * np.round(y[np.tile(np.arange(N) >= 130, RUNS)] / (STEP / 2))
    report = GapDiagnoser(simulator, n_jobs=1, random_state=0).fit(X, np.round(y, 5), groups=groups).report_
    assert report.verdict == "explained"
    assert sorted(effect.name for effect in report.effects) == ["linear_loss", "sensor_quantization"]
    assert all(len(fault.rows) < 0.01 * len(y) for fault in report.data)
