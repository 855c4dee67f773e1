"""An effect that was rejected for a law in its place is told where it closes clearly more on runs left out than the law that is found."""

import numpy as np
import pytest

from sksurrogate import GapDiagnoser, ODESimulator
from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.gap.decide._ode_access import OdeAccess
from sksurrogate.gap.decide._posterior import Posterior


def carriage(t, x, u, p):
    return [x[1], (u[0] - p["d"] * x[1] - p["k"] * x[0]) / p["m"]]


@pytest.fixture
def every_name_is_rejected(monkeypatch):
    """As where a law, linear along the measured path, is likelier than the effect."""

    def weigh(self, final):
        self.search.final = self.search.fitted_null
        return Posterior((), None, rejected=final)

    monkeypatch.setattr(OdeAccess, "weigh", weigh)


def diagnosed(effect, value):
    """Of a carriage that has the effect, four runs."""
    nominal = ODESimulator(
        carriage,
        states=["position", "speed"],
        inputs=["force"],
        outputs=["position", "speed"],
        params={"m": 1.0, "d": 0.4, "k": 2.0},
        dt=0.05,
    )
    plant, rng = AugmentedSimulator(nominal, [effect], [value]), np.random.default_rng(0)
    U = [np.repeat(rng.uniform(-2.0, 2.0, size=(20, 1)), 10, axis=0) for _ in range(4)]
    Y = [plant.simulate(u) + rng.normal(scale=0.004, size=(200, 2)) for u in U]
    runs = np.repeat(np.arange(4), 200)
    return (
        GapDiagnoser(nominal, random_state=0, n_jobs=1).fit(np.concatenate(U), np.concatenate(Y), groups=runs).report_
    )


def test_where_no_law_of_the_signals_does_as_much(every_name_is_rejected):
    """The limited speed of an actuator is no function of its command."""
    report = diagnosed(CATALOGUE["rate_limit"]("force"), {"limit": 6.0})
    assert report.verdict == "unknown"
    assert not report.effects
    (note,) = (note for note in report.notes if "It is not named" in note)
    assert note.startswith("Rate limit at force (limit 6.0")
    assert float(note.split("closes ")[1].split(" %")[0]) > 90.0


def test_not_where_the_law_closes_as_much(every_name_is_rejected):
    """A cubic spring is a function of the position, and a formula says it."""
    report = diagnosed(CATALOGUE["cubic_stiffness"]("speed", "position"), {"coefficient": 3.0})
    assert report.verdict == "unknown"
    assert not report.effects
    assert report.missing_term.law.certified
    assert not any("It is not named" in note for note in report.notes)
