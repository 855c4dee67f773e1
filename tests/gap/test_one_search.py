"""One search for every kind of access: the same run over sets of effects, the same bounds of the parameters."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.effects._sensor import SensorDelay
from sksurrogate.gap.fit._build import build_problem, build_trajectory
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.search._related_forms import simpler_forms
from sksurrogate.gap.search._set_search import SetSearch
from sksurrogate.gap.search._trajectory_search import TrajectorySearch
from sksurrogate.gap.unnamed._ode_channels import OdeChannels
from sksurrogate.gap.unnamed._trajectory_channels import TrajectoryChannels
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe


def rates(t, x, u, p):
    return (p["gain"] * u[0] - x[0],)


def plant(shown=0.0):
    """A lag whose output shows a share of its input at once."""
    return ODESimulator(
        rates,
        states=["x"],
        inputs=["u"],
        outputs=["y"],
        output=lambda t, x, u, p: (x[0] + p["shown"] * u[0],),
        params={"gain": 1.0, "shown": shown},
        dt=0.1,
        x0=[0.0],
    )


class Outside:
    """The same plant through ``simulate`` alone."""

    inputs, outputs, dt = ("u",), ("y",), 0.1

    def __init__(self, inner):
        self.inner = inner

    def simulate(self, U, x0=None, t=None):
        return self.inner.simulate(U)


def problems(simulator, y=None, labels=("a", "b")):
    """Both backends over the same record."""
    rng = np.random.default_rng(0)
    U = [np.repeat(rng.uniform(-1, 1, 20), 5)[:, None] for _ in labels]
    Y = [simulator.simulate(u) if y is None else y(simulator.simulate(u)) for u in U]
    Y = [part + 0.01 * rng.normal(size=part.shape) for part in Y]
    record = Record.from_runs(U, Y, [0.1 * np.arange(len(u)) for u in U], 0.1)
    inside = describe(simulator)
    ode, smoothed = build_problem(PlantModel(inside), record, (), ("x",))
    return ode, build_trajectory(describe(Outside(simulator)), record, (), labels), smoothed


def test_both_kinds_of_access_are_searched_by_the_same_code():
    for name in ("one_more", "needed", "passes", "beam", "swap", "without", "ranked"):
        assert getattr(OdeSearch, name) is getattr(TrajectorySearch, name) is getattr(SetSearch, name)


def test_both_kinds_of_access_bound_parameters_alike():
    ode, trajectory, _ = problems(plant())
    effects = [SensorDelay("y", earliest=-0.3), CATALOGUE["sensor_gain"]("y")]
    for one, other in zip(ode.bounds(effects), trajectory.bounds(effects)):
        assert np.array_equal(one, other)
    assert trajectory.bounds(effects)[0][0] == -0.3  # the clock of a sensor may be ahead


def test_two_names_are_found_and_settled_through_either_access():
    ode, trajectory, smoothed = problems(plant(), lambda y: 1.3 * y + 0.4)
    library = [CATALOGUE[name]("y") for name in ("sensor_gain", "sensor_bias", "sensor_drift")]
    for search in (OdeSearch(ode, library, smoothed.x), TrajectorySearch(trajectory, library)):
        search.look_for_one()
        final = search.look_for_more()
        assert isinstance(final, Evidence)
        assert {effect.name for effect in final.effects} == {"sensor_gain", "sensor_bias"}
        values = dict(zip([e.name for e in final.effects], [final.candidate.theta_of(i)[0] for i in range(2)]))
        assert values["sensor_bias"] == pytest.approx(0.4, abs=0.01)


@pytest.mark.parametrize("n_runs", [2, 3])
@pytest.mark.parametrize("kind", ["ode", "trajectory"])
def test_a_law_that_begins_within_the_runs_is_listed_for_both_kinds_of_access(kind, n_runs):
    """Planted: the sensor adds 0.3 + 0.5 y from row 60 of 100 on, through one code for all channels."""
    late = (np.arange(100) >= 60)[:, None]
    ode, trajectory, smoothed = problems(plant(), lambda y: y + late * (0.3 + 0.5 * y), tuple(range(n_runs)))
    if kind == "ode":
        channels = OdeChannels(ode.fit((), np.zeros(0), smoothed.x))
    else:
        channels = TrajectoryChannels(trajectory.fit((), np.zeros(0)))
    found = channels.missing_term("y", "output").candidates
    offset, slope = (float(part.split("*")[0]) for part in found[0].split(" + "))
    assert "*y*(t > 6)" in found[0] and (offset, slope) == pytest.approx((0.3, 0.5), rel=0.1)


@pytest.mark.slow
def test_a_friction_with_an_offset_is_told_from_a_symmetric_one_beside_a_step():
    """Beside a symmetric friction a slow sine comes nearer than the step: the search goes another way."""
    rotor = ODESimulator(
        lambda t, x, u, p: [u[0] - p["c"] * x[0]],
        states=["speed"], inputs=["u"], outputs=["speed"], params={"c": 0.5}, dt=0.1, x0=[0.0],
    )  # fmt: skip
    inside, rng = describe(rotor), np.random.default_rng(3)
    library = [CATALOGUE[name]("speed", "speed") for name in ("stribeck_friction", "asymmetric_friction")]
    library += [CATALOGUE[name]("speed") for name in ("periodic_disturbance", "step_disturbance")]
    real = AugmentedSimulator(
        rotor,
        [library[1], library[3]],
        [{"level": 0.35, "offset": -0.25}, {"size": -0.3, "time": 24.0}],
    )
    U = np.repeat(rng.uniform(-2, 2, 40), 10)[:, None]
    y = real.simulate(U)
    record = Record.from_runs([U], [y + 0.01 * rng.normal(size=y.shape)], [0.1 * np.arange(len(U))], 0.1)
    problem, smoothed = build_problem(PlantModel(inside), record, (), ("speed",))
    search = OdeSearch(problem, library, smoothed.x)
    search.look_for_one()
    found = search.look_for_more()
    assert {effect.name for effect in found.effects} == {"asymmetric_friction", "step_disturbance"}
    assert found.left < 1.05


class _Refits(OdeSearch):
    """A search whose finer fits are known."""

    def polish(self, candidate):
        return candidate.finer

    def plausible(self, candidate):
        return candidate.sound

    def order(self, candidates):
        return lambda candidate: -candidate.fit.cost


def test_what_a_finer_fit_makes_implausible_does_not_stand():
    def one(cost, sound=True):
        return SimpleNamespace(fit=SimpleNamespace(cost=cost), sound=sound, finer=None)

    first, second = one(10.0), one(11.0)
    first.finer, second.finer = one(8.0, sound=False), one(9.0)
    search = _Refits.__new__(_Refits)
    assert search.best_polished([first, second]) is second.finer
    second.finer.sound = False
    assert search.best_polished([first, second]) is first.finer


def test_a_simpler_form_that_the_set_has_already_does_not_enter_twice():
    """Two memories at one place: where the second comes down to the first's form, it keeps its own."""
    lag, mode = CATALOGUE["hidden_relaxation"]("p", "p"), CATALOGUE["hidden_mode"]("p", "p")
    search = SimpleNamespace(library=[lag, mode])

    def forms(*effects):
        candidate = SimpleNamespace(effects=effects, keys=tuple(effect.key for effect in effects))
        return simpler_forms(search, candidate, len(effects) - 1, "hidden_relaxation")

    assert forms(mode) == [lag]
    assert forms(lag, mode) == []
