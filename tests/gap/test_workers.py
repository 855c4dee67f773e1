"""Fits side by side: asked for by ``n_jobs`` or by joblib's own setting, with the same answer."""

import io
import re
import socket

import joblib
import numpy as np
import pytest

from sksurrogate._parallel import _interrupts
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.exceptions import SimulatorError
from sksurrogate.gap import GapDiagnoser, _begin
from sksurrogate.physics import CallableSimulator, ODESimulator


def printed(report):
    """The terminal page without when it was made and how long it took."""
    return re.sub(r"date:\s+\S+\s+[0-9:]+;\s+time\s+taken:\s+[0-9.]+\s+s", "", str(report))


def test_joblibs_setting_spreads_the_fits_and_changes_no_answer(monkeypatch):
    X, y, groups = make_reactor_runs(4, 80, noise=0.02, random_state=0)
    diagnoser = GapDiagnoser(
        make_reactor(second=80.0), effects=["parameter_error", "sensor_bias", "input_lag"], random_state=0
    )
    here = printed(diagnoser.fit(X, y, groups=groups).report_)
    asked = []

    def spy(n_jobs, **options):
        asked.append(joblib.effective_n_jobs(n_jobs))
        return _interrupts.workers(n_jobs, **options)

    monkeypatch.setattr("sksurrogate.gap.search._expander.workers", spy)
    assert printed(diagnoser.fit(X, y, groups=groups).report_) == here and not asked
    with joblib.parallel_config("threading", n_jobs=2):
        assert printed(diagnoser.fit(X, y, groups=groups).report_) == here
    assert asked and set(asked) == {2}
    assert np.isfinite(diagnoser.report_.shrink.fraction)


class Connected:
    """Answers through one connection: with two processes on it, each could read the other's answer."""

    def __init__(self, pair):
        self.pair = pair

    def __call__(self, U, x0=None, t=None):
        self.pair[0].sendall(np.ascontiguousarray(U, dtype=float))
        return 2.0 * np.frombuffer(self.pair[1].recv(8 * len(U), socket.MSG_WAITALL)).reshape(-1, 1)


def test_a_simulator_behind_a_connection_is_asked_by_one_process():
    U = np.random.default_rng(0).normal(size=(60, 1))
    ends = socket.socketpair()
    simulator = CallableSimulator(Connected(ends), inputs=["u"], outputs=["y"])
    with pytest.raises(SimulatorError, match=r"n_jobs=2: the simulator holds something.*socket.*leave out n_jobs"):
        GapDiagnoser(simulator, effects=["sensor_bias"], n_jobs=2).fit(U, 2.0 * U + 0.5)
    noise = 0.01 * np.random.default_rng(1).normal(size=U.shape)
    report = GapDiagnoser(simulator, effects=["sensor_bias"], random_state=0).fit(U, 2.0 * U + 0.5 + noise).report_
    assert [effect.name for effect in report.effects] == ["sensor_bias"]
    for end in ends:
        end.close()


class Kept(Connected):
    """Leaves its connection out of a pickle, as a cache asks for: a fork has it all the same."""

    def __getstate__(self):
        return {}


class Port(io.RawIOBase):
    """As a serial port, which can be pickled."""


OPEN = socket.socket()
OPEN.close()


def reads_a_global(t, x, u, p):
    OPEN.fileno()
    return (u[0] - p["k"] * x[0],)


def right_hand_side(handle):
    def rhs(t, x, u, p):
        assert handle is not None
        return (u[0] - p["k"] * x[0],)

    return rhs


@pytest.mark.parametrize(
    ("rhs", "apart"),
    [
        (right_hand_side("nothing that is open"), True),
        (right_hand_side(Connected([OPEN])), False),
        (right_hand_side(Kept([OPEN])), False),
        (right_hand_side(Port()), False),
        (reads_a_global, False),
    ],
    ids=["plain", "connection", "left out of a pickle", "port", "global"],
)
def test_no_second_process_is_made_beside_equations_behind_a_connection(rhs, apart, monkeypatch):
    asked = []

    class Watched(_begin.WorkerProcess):
        def __init__(self, known=(), apart=True, later=False):
            asked.append(apart)
            super().__init__(known, apart=False)

    monkeypatch.setattr(_begin, "WorkerProcess", Watched)
    plant = ODESimulator(rhs, states=["v"], inputs=["u"], outputs=["v"], params={"k": 1.0}, dt=0.1)
    U = np.repeat(np.random.default_rng(0).normal(size=10), 6)[:, None]
    y = plant.simulate(U) + 0.5 + 0.01 * np.random.default_rng(1).normal(size=U.shape)
    GapDiagnoser(plant, effects=["sensor_bias"], random_state=0).fit(U, y)
    assert asked and set(asked) == {apart}


def test_a_port_that_can_be_pickled_does_not_travel():
    plant = CallableSimulator(right_hand_side(Port()), inputs=["u"], outputs=["y"])
    with pytest.raises(
        SimulatorError, match=r"n_jobs=2: the simulator holds something.*Port is open.*leave out n_jobs"
    ):
        GapDiagnoser(plant, effects=["sensor_bias"], n_jobs=2).fit(np.ones((9, 1)), np.arange(9.0))
