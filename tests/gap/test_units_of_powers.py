"""A power law is found in any unit of its signal, and its coefficient known as well."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._coordinates import coordinates_of
from sksurrogate.physics import ODESimulator


def found(size, exponent):
    """The effect that is named of a level of a size, which falls by a power of it."""
    n, rng = 200, np.random.default_rng(0)

    def plant(loss):
        return ODESimulator(
            lambda t, x, u, p: (size * u[0] - 0.3 * x[0] - loss(x[0]),),
            states=["p"], inputs=["u"], outputs=["p"], params={}, dt=0.1,
        )  # fmt: skip

    real = plant(lambda x: 0.8 * size * np.sign(x) * np.abs(x / size) ** exponent)
    U = [np.repeat(rng.uniform(0.3, 3, 20), 10)[:, None] for _ in range(3)]
    Y = [real.simulate(u, x0=[size]).reshape(n, 1) + 0.005 * size * rng.normal(size=(n, 1)) for u in U]
    diagnoser = GapDiagnoser(plant(lambda x: 0 * x), effects=["power_law"], random_state=0, n_jobs=1)
    report = diagnoser.fit(np.vstack(U), np.vstack(Y), groups=np.repeat(np.arange(3), n)).report_
    assert report.verdict == "explained"
    return report.effects[0]


@pytest.mark.parametrize("exponent", [0.6, 3.75, 6.0])
def test_the_unit_of_the_signal_changes_nothing(exponent):
    one, other = found(1.0, exponent), found(1e5, exponent)
    assert one.params["exponent"] == pytest.approx(exponent, rel=0.005)
    assert other.params["exponent"] == pytest.approx(one.params["exponent"], rel=1e-4)
    in_its_unit = other.params["coefficient"] * 1e5 ** (other.params["exponent"] - 1.0)
    assert in_its_unit == pytest.approx(one.params["coefficient"], rel=1e-3)
    low, high = other.intervals["coefficient"]
    assert (
        0 < low < other.params["coefficient"] < high
    )  # the exponent's error makes the coefficient's large, not its sign uncertain


def test_coordinates_are_undone_and_have_the_slopes_of_their_differences():
    law, loss = CATALOGUE["power_law"]("p", "p"), CATALOGUE["linear_loss"]("p", "p")
    signals = {"p": np.full(3, 20.0)}
    steps = coordinates_of([loss, law], [slice(0, 1), slice(1, 3)].__getitem__, signals)
    theta = np.array([0.3, 2e-3, 1.7, 0.1])
    z = steps.of(theta)
    assert z == pytest.approx([0.3, 2e-3 * 20.0**1.7, 1.7, 0.1])
    assert steps.theta(z) == pytest.approx(theta)
    moved = np.stack([steps.of(theta + 1e-7 * e) - z for e in np.eye(4)], axis=1) / 1e-7
    assert steps.slopes(theta) == pytest.approx(moved, rel=1e-4)


def test_coordinates_that_are_allowed_stay_to_the_last_digit():
    law = CATALOGUE["power_law"]("p", "p")
    steps = coordinates_of([law], [slice(0, 2)].__getitem__, {"p": np.full(3, 1e5)})
    z = np.array([0.123456789, 2.3456789])
    assert np.array_equal(steps.within(lambda theta: theta, z), z)
    nearest = steps.within(lambda theta: np.minimum(theta, [np.inf, 2.0]), z)
    assert nearest[1] == 2.0
