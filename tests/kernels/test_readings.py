"""Spikes and flat stretches against paths that are sharp by themselves."""

import numpy as np
import pytest

from sksurrogate.kernels.readings import flat_stretches, out_of_reach, predicted_by_neighbours, spikes

SD, N = 0.01, 1000


def paths():
    rng = np.random.default_rng(0)
    k = np.arange(N)
    return {
        "smooth": np.sin(0.03 * k) + 0.3 * np.sin(0.11 * k),
        "kinks": np.abs(np.sin(0.07 * k)),
        "steps": np.repeat(rng.normal(size=N // 20), 20),
        "square": np.sign(np.sin(0.21 * k)),
        "white": rng.normal(size=N),
        "rest and jump": np.where(k < 500, 0.0, np.sin(0.05 * (k - 500)) + 1.0),
    }


@pytest.mark.parametrize("name", paths())
@pytest.mark.parametrize("seed", range(3))
def test_what_a_plant_does_suddenly_is_no_spike(name, seed):
    y = paths()[name] + SD * np.random.default_rng(seed).normal(size=N)
    assert spikes(y, SD) == []


@pytest.mark.parametrize("name", ["smooth", "kinks"])
def test_spikes_are_found_where_they_are(name):
    rng = np.random.default_rng(1)
    y = paths()[name] + SD * rng.normal(size=N)
    rows = np.sort(rng.choice(np.arange(10, N - 10, 15), 20, replace=False))
    y[rows] += rng.choice([-1, 1], 20) * rng.uniform(20, 50, 20) * SD
    found = np.concatenate([np.arange(s.start, s.stop) for s in spikes(y, SD)])
    assert np.isin(rows, found).mean() >= 0.9
    assert np.isin(found, rows).mean() >= 0.9


@pytest.mark.parametrize("length", [1, 2, 3])
def test_a_spike_takes_as_many_readings_as_are_off(length):
    y = paths()["smooth"] + SD * np.random.default_rng(2).normal(size=N)
    y[300 : 300 + length] += 0.8
    assert [(s.start, s.stop) for s in spikes(y, SD)] == [(300, 300 + length)]
    assert spikes(y, SD)[0].size == pytest.approx(0.8, abs=6 * SD)


def test_spikes_do_not_depend_on_unit_zero_or_direction_of_time():
    y = paths()["smooth"] + SD * np.random.default_rng(3).normal(size=N)
    y[[200, 640]] += [0.5, -0.4]
    rows = [(s.start, s.stop) for s in spikes(y, SD)]
    assert rows == [(200, 201), (640, 641)]
    assert [(s.start, s.stop) for s in spikes(1e6 * y + 3e6, 1e6 * SD)] == rows
    assert [(N - s.stop, N - s.start) for s in spikes(y[::-1], SD)][::-1] == rows


def test_a_cubic_is_predicted_exactly():
    k = np.arange(30.0)
    y = 0.02 * k**3 - k**2 + 3.0
    np.testing.assert_allclose(predicted_by_neighbours(y), y, atol=1e-10)


def test_a_sensor_that_stands_still_is_found():
    y = paths()["smooth"] + SD * np.random.default_rng(4).normal(size=N)
    y[400:470] = y[400]
    assert [(s.start, s.stop) for s in flat_stretches(y, SD)] == [(400, 470)]


def test_a_stretch_at_another_level_is_found():
    rng = np.random.default_rng(5)
    y = paths()["smooth"] + SD * rng.normal(size=N)
    y[400:430] = -3.0 + SD * rng.normal(size=30)
    assert [(s.start, s.stop) for s in flat_stretches(y, SD)] == [(400, 430)]


def test_rest_saturation_and_grids_are_no_flat_stretches():
    noise = SD * np.random.default_rng(6).normal(size=N)
    k = np.arange(N)
    assert flat_stretches(np.minimum(np.sin(0.03 * k) + noise, 0.8), SD) == []  # left and entered without a jump
    assert flat_stretches(np.round((np.sin(0.03 * k) + noise) / 0.05) * 0.05, SD) == []
    assert flat_stretches(np.where(k < 300, 0.0, np.sin(0.03 * (k - 300))) + noise, SD) == []


def test_readings_that_no_plant_gives_are_out_of_reach():
    rng = np.random.default_rng(7)
    y = paths()["smooth"] + SD * rng.normal(size=N)
    assert not out_of_reach(y).any()
    wrong = np.zeros(N, bool)
    wrong[rng.choice(N, N // 5, replace=False)] = True
    np.testing.assert_array_equal(out_of_reach(np.where(wrong, -9999.0, y)), wrong)  # a code for "no reading"
    one = np.isin(np.arange(N), [0, 70, N - 1])
    np.testing.assert_array_equal(out_of_reach(np.where(one, 1e9, y) * (1 + one * np.arange(N))), one)


def test_a_plant_that_wakes_or_runs_away_is_within_reach():
    k = np.arange(N)
    at_rest = SD * np.random.default_rng(8).normal(size=N)
    assert not out_of_reach(at_rest + np.where(k % 100 < 10, 1e3 * (1.0 + 0.01 * k), 0.0)).any()
    assert not out_of_reach(np.exp(0.05 * k)).any()
    assert not out_of_reach(np.where(k % 100 < 10, 1.0, 0.0)).any()
