"""The step of a quantizer from its readings alone: found whatever the model, and not where there is none."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, Probe
from sksurrogate.effects._lattice import LEAST, coherence, lattice_steps, likely_steps, shows_steps
from sksurrogate.effects._onset import starting


def signal(seed, n=1200):
    rng = np.random.default_rng(seed)
    t = np.arange(n)
    return sum(rng.normal() * np.sin(w * t + rng.uniform(0, 6)) for w in rng.uniform(0.005, 0.2, 6)), rng


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("offset", [0.0, 40.0, -300.0])
def test_the_step_is_found_so_that_its_multiples_are_the_readings(seed, offset):
    """Far from 0 the multiples of a slightly different step are the same few readings, nearly."""
    y, rng = signal(seed)
    step = float(np.ptp(y)) / rng.uniform(4, 25)
    for noise in (0.0, 0.05):
        rounded = step * np.round((offset + y) / step)
        (found,) = lattice_steps(rounded + noise * step * rng.normal(size=len(y)))
        assert abs(found - step) < 0.03 * step
        assert np.max(np.abs(rounded - found * np.round(rounded / found))) < 0.2 * step


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("counts", [150, 380])
def test_one_step_more_or_fewer_up_to_the_readings_is_told_apart(seed, counts):
    """The readings span 20 steps, so that the lattice of one step more is a twentieth of a step off at their ends."""
    y, rng = signal(seed)
    step = float(np.ptp(y)) / 20.0
    rounded = step * np.round(counts + y / step) + 0.02 * step * rng.normal(size=len(y))
    assert lattice_steps(rounded)[0] == pytest.approx(step, rel=0.2 / counts)


@pytest.mark.parametrize("seed", range(12))
def test_a_smooth_signal_has_none(seed):
    y, rng = signal(seed)
    assert lattice_steps(5.0 + y) == []
    assert lattice_steps(y + 0.02 * np.std(y) * rng.normal(size=len(y))) == []


def test_a_constant_signal_and_a_short_one_have_none():
    assert lattice_steps(np.full(100, 3.0)) == []
    assert lattice_steps(np.arange(5.0)) == []


def test_steps_that_would_show_in_the_readings_are_no_other_starts():
    """Of a known noise: only steps near it, and steps of which the readings span hardly one."""
    y = 3.0 + np.sin(np.linspace(0, 30, 2000))
    quantization, rest = CATALOGUE["sensor_quantization"](), (1.0, 0.1, 200.0, np.array([0]))
    steps = [np.array(quantization.starts(Probe(None, y, *rest, noise=noise)))[:, 0] for noise in (0.0, 0.01)]
    assert set(steps[1]) < set(steps[0])
    of_large = np.array(quantization.starts(Probe(None, 1000.0 * y, *rest)))[:, 0]
    np.testing.assert_allclose(of_large, 1000.0 * steps[0])  # all of them where the noise is not known
    assert all(step <= 0.08 or step >= np.ptp(y) / 1.7 for step in steps[1])
    assert np.any(steps[1] < 0.08) and np.any(steps[1] > np.ptp(y) / 1.7)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("offset, counts", [(0.0, 60), (0.0, 400), (30.0, 150)])
def test_a_step_far_below_the_noise_is_told_by_the_slope_of_the_likelihood(seed, offset, counts):
    """The rounding is a third of the noise: no reading shows it, all together do."""
    y, rng = signal(seed)
    u = offset + y
    step = float(np.max(np.abs(u))) / counts
    slope = step * np.round(u / step) - u + 0.9 * step * rng.normal(size=len(u))
    found = np.array(likely_steps(u, slope))
    assert np.min(np.abs(found / step - 1.0)) < 0.2 / counts
    assert len(found) < 40


@pytest.mark.parametrize("name", ["state_saturation", "input_saturation", "sensor_saturation", "overflow"])
def test_a_limit_that_cut_off_a_few_peaks_only_is_tried(name):
    y, _ = signal(0)
    x = y - np.min(y) + 1.0
    effect = CATALOGUE[name]("place", "other") if name == "overflow" else CATALOGUE[name]("place")
    probe = Probe(v=x, x=x, rate=1.0, dt=0.1, duration=10.0, starts=np.array([0]))
    depths = (np.max(x) - np.array([start[0] for start in effect.starts(probe)])) / np.ptp(x)
    assert np.any((depths > 0.0) & (depths < 0.003))
    assert np.all(depths > 0.0)


def test_forty_readings_crowd_at_the_multiples_of_some_step_by_chance():
    t = np.linspace(0.0, 2.6, 40)
    steps = 1.0 / np.linspace(1.0 / 0.5, 1.0 / 0.02, 20000)
    chances = 0
    for seed in range(20):
        y = 35.0 - 4.9 * t**2 + 0.03 * np.random.default_rng(seed).normal(size=len(t))
        chances += bool(np.any(coherence(y, steps) > LEAST))
        assert not np.any(shows_steps(y, steps))
        assert not lattice_steps(y)
    assert chances > 10


@pytest.mark.parametrize("span", [("onset",), ("onset", "end")])
def test_a_step_that_part_of_the_readings_show_is_tried_in_windows(span):
    """As readings show it whatever the simulator says, beside the steps that would not be seen."""
    y = 5.0 + np.sin(np.arange(1000) / 17)
    y[300:] = 0.25 * np.round(y[300:] / 0.25)
    late = starting(CATALOGUE["sensor_quantization"]("y"), span)
    starts = np.array(late.starts(Probe(None, y, 0.0, 0.1, 100.0, np.array([0]), noise=0.01)))
    near = starts[np.abs(starts[:, 0] - 0.25) < 0.25 / 40]
    assert len(np.unique(near[:, 1])) > 5 and near[:, 1].min() < 30.0 < near[:, 1].max()
