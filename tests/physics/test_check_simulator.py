"""Our simulators pass; broken ones are given why."""

import numpy as np
import pytest

from sksurrogate.datasets import linear_reactor, make_reactor
from sksurrogate.physics import CallableSimulator, ControlSimulator, StepSimulator, TableSimulator
from sksurrogate.testing import check_simulator


def _step(t, x, u, p, dt):
    return [0.9 * x[0] + u[0]]


def _double(U):
    return 2 * U


def test_our_simulators_pass():
    check_simulator(make_reactor(), 0.15 + np.zeros((20, 1)), [5.0])
    check_simulator(linear_reactor())
    check_simulator(StepSimulator(_step, states=["x"], inputs=["u"], outputs=["x"]))
    check_simulator(CallableSimulator(_double, inputs=["u"]))
    U = np.arange(8.0)[:, None]
    check_simulator(TableSimulator(U, U), U)


def test_a_control_system_passes():
    control = pytest.importorskip("control")
    check_simulator(ControlSimulator(control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]]), dt=0.1))


def _adds_up(U, x0=None, t=None, kept={}):  # noqa: B006
    array = kept.setdefault(len(U), np.zeros_like(U))
    array += U
    return array


class Broken:
    inputs = ("u",)

    def __init__(self, run):
        self.simulate = run


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (lambda U, x0=None, t=None: U[:, 0], "expected .12, n_outputs"),
        (lambda U, x0=None, t=None: np.full(U.shape, np.nan), "not finite"),
        (lambda U, x0=None, t=None: U - U.mean(), "after row k"),
        (lambda U, x0=None, t=None: U * np.random.default_rng().normal(), "same call"),
        (_adds_up, "same call"),
        (lambda U, x0=None, t=None: np.multiply(U, 2, out=U), "wrote into U"),
    ],
)
def test_broken_simulators_are_told_why(run, message):
    with pytest.raises(AssertionError, match=message):
        check_simulator(Broken(run))
