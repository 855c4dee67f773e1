"""What the check does to readings, and the formulae of its sensors."""

import numpy as np
import pytest

from sksurrogate.blind._equations import battery_voltage, rlc_circuit
from sksurrogate.blind._readings import spoiled

SHAPE, NOISE = (6, 4000, 2), np.array([0.1, 3.0])


def spoil(arm, seed=0):
    return spoiled(np.random.default_rng(seed), arm, np.zeros(SHAPE), NOISE)


def test_spikes_are_rare_large_and_of_both_signs():
    spikes = spoil("spikes") / NOISE
    hit = spikes != 0
    # A share of 0.02 of 48 000 readings: five deviations of a binomial.
    assert hit.mean() == pytest.approx(0.02, abs=5 * np.sqrt(0.02 * 0.98 / hit.size))
    assert 5.0 <= np.abs(spikes[hit]).min() < 6.0 and 49.0 < np.abs(spikes[hit]).max() <= 50.0
    assert abs(np.mean(np.sign(spikes[hit]))) < 5 / np.sqrt(hit.sum())


def test_heavy_tails_replace_the_noise_they_are_drawn_beside():
    rng = np.random.default_rng(0)
    rng.standard_t(3, size=SHAPE)
    white = NOISE * rng.normal(size=SHAPE)  # the same draws in the same order
    tails = (spoil("tails") + white) / NOISE
    heavy = np.random.default_rng(0).standard_t(3, size=SHAPE) / np.sqrt(3.0)  # deviation of t(3): sqrt(3)
    np.testing.assert_allclose(tails, heavy, atol=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_a_trend_or_offsets_are_of_one_sensor(seed):
    found = spoil("trends", seed) / NOISE
    moved = np.any(found != 0, axis=(0, 1))
    assert moved.sum() == 1
    one = found[..., int(np.argmax(moved))]
    steps = np.diff(one, axis=1)
    assert np.abs(one).max() <= 8.0
    if np.ptp(steps) < 1e-9 and steps[0, 0] != 0:  # a line through zero in the middle, of at least two deviations
        np.testing.assert_allclose(one, -one[:, ::-1], atol=1e-9)
        assert np.abs(one).max() >= 2.0
    else:
        np.testing.assert_allclose(steps, 0.0, atol=1e-12)
        assert len(np.unique(one)) == len(one)


def test_no_other_arm_touches_the_readings():
    assert not spoil("one").any()


def test_the_open_circuit_is_odd_about_half_charge():
    p, d = {"r0": 0.05}, np.linspace(0, 0.5, 6)
    up, down = (battery_voltage(0.0, (0.5 + s * d, 0.1, 0.2), (2.0,), p)[0] for s in (1, -1))
    np.testing.assert_allclose(up + down, 2 * (3.7 - 0.05 * 2.0 - 0.3))
    assert np.all(np.diff(up) > 0)


def test_the_energy_of_a_circuit_is_what_comes_in_less_what_the_resistor_takes():
    p = {"resistance": 2.0, "capacitance": 0.5, "inductance": 0.3}
    q, i, u = 0.7, -1.3, 4.0
    dq, di = rlc_circuit(0.0, (q, i), (u,), p)
    assert q / p["capacitance"] * dq + p["inductance"] * i * di == pytest.approx(u * i - p["resistance"] * i**2)
