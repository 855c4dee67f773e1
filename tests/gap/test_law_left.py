"""What is left through ``simulate`` alone is a law where a formula repeats it, and none where it is a disturbance."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sksurrogate.gap.fit._build import build_trajectory
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.unnamed._channel import Place
from sksurrogate.gap.unnamed._trajectory_channels import TrajectoryChannels, law_left
from sksurrogate.kernels.record import Record
from sksurrogate.physics import BaseSimulator
from sksurrogate.physics._simulator import describe

DT, N, RUNS, NOISE = 0.1, 150, 4, 0.01


class Lag(BaseSimulator):
    """A first-order lag of its input, of which nothing but its runs is known."""

    def __init__(self):
        self.inputs, self.outputs, self.dt, self.hold, self.params = ("u",), ("y",), DT, "zero", {}

    def simulate(self, U, x0=None, t=None):
        return lfilter([0.0, 0.1], [1.0, -0.9], np.asarray(U)[:, 0])[:, None]


def left(acting, shaken=0.0):
    """The law at the input that the simulator leaves of a plant whose input acts as a function of itself; the gap over the noise."""
    rng = np.random.default_rng(0)
    U = [np.repeat(rng.uniform(-1, 1, N // 10), 10)[:, None] for _ in range(RUNS)]
    force = [lfilter([shaken], [1.0, -0.9], rng.normal(size=(N, 1)), axis=0) for _ in range(RUNS)]
    Y = [Lag().simulate(acting(u) + f) + NOISE * rng.normal(size=(N, 1)) for u, f in zip(U, force)]
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    problem = build_trajectory(describe(Lag(), n_inputs=1, n_outputs=1, dt=DT), record, (), range(RUNS))
    null = estimate_noise(problem.fit((), np.zeros(0)), problem.first_noise())
    gap = np.sqrt(null.fit.cost / record.n_values - 1.0)
    return law_left(TrajectoryChannels(null.candidate), Place("u", "input", 0.0), gap, 0.1), gap


def test_a_square_at_the_input_is_a_law_of_the_size_of_the_gap():
    law, gap = left(lambda u: u + 0.4 * u**2)
    assert gap > 3.0
    assert (law.location, law.kind, law.variable) == ("u", "input", "u")
    assert law.gain > 100.0 and law.probability > 0.99
    assert law.size == pytest.approx(1.0, abs=0.05) and law.spread < 0.05


def test_a_coloured_disturbance_is_no_law():
    law, gap = left(lambda u: u, shaken=0.1)
    assert gap > 3.0
    assert law.gain < 10.0 and law.size < 0.3
