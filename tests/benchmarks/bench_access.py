"""What does a diagnosis take through simulators of other packages?

    python tests/benchmarks/bench_access.py [NAME ...]

A spring without its quadratic drag (two states, 4 runs of 300 rows, 1 % noise), written as equations on arrays and in the other ways in
which people have simulators. One line each: the answer, processor seconds, and these over the seconds of the equations. FMUs are
in ``bench_fmu_parity.py``.
"""

import argparse
import time
import warnings

import casadi as ca
import control
import numpy as np

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import CasadiSimulator, ControlSimulator, ODESimulator

PARAMS = {"k": 4.0, "c": 0.3}
NAMES = {"states": ["q", "v"], "inputs": ["u"], "outputs": ["q"], "params": PARAMS, "dt": 0.05}


def on_arrays(t, x, u, p):
    """All points at once."""
    return x[1], u[0] - p["k"] * x[0] - p["c"] * x[1]


def of_one_point(t, x, u, p):
    """The same with branches, for one point."""
    force = max(u[0], -100.0)
    if x[1] > 0:
        return [x[1], force - p["k"] * x[0] - p["c"] * x[1]]
    return [x[1], force - p["k"] * x[0] - p["c"] * x[1]]


def filled(t, x, u, p):
    """A vector that is filled entry by entry."""
    dx = np.zeros(2)
    dx[0] = x[1]
    dx[1] = u[0] - p["k"] * x[0] - p["c"] * x[1]
    return dx


def by_matrices(t, x, u, p):
    """A matrix of parameters."""
    return np.array([[0.0, 1.0], [-p["k"], -p["c"]]]) @ x + np.array([[0.0], [1.0]]) @ u


def nonlinear_system(outputs=None):
    """Of python-control; without a function for the outputs these are both states."""
    names = ["q", "v"] if outputs is None else ["q"]
    rates = lambda t, x, u, params: [x[1], u[0] - params["k"] * x[0] - params["c"] * x[1]]  # noqa: E731
    return control.nlsys(rates, outputs, inputs=["u"], states=["q", "v"], outputs=names, params=PARAMS, name="plant")


def interconnected():
    """The same system behind a gain of one."""
    plant, gain = (
        nonlinear_system(lambda t, x, u, params: [x[0]]),
        control.ss([], [], [], [[1.0]], inputs=["u"], outputs=["f"], name="gain"),
    )
    return control.interconnect(
        [gain, plant],
        connections=[["plant.u", "gain.f"]],
        inplist=["gain.u"],
        outlist=["plant.q"],
        inputs=["u"],
        outputs=["q"],
    )


def casadi_function(kind):
    """Of CasADi's scalar or matrix symbols."""
    x, u, p = kind.sym("x", 2), kind.sym("u"), kind.sym("p", 2)
    return ca.Function("f", [x, u, p], [ca.vertcat(x[1], u - p[0] * x[0] - p[1] * x[1])], ["x", "u", "p"], ["dx"])


def systems():
    """Name -> simulator."""
    linear = control.ss(
        [[0, 1], [-4, -0.3]], [[0], [1]], [[1, 0]], [[0]], states=["q", "v"], inputs=["u"], outputs=["q"]
    )
    return {
        "equations on arrays": ODESimulator(on_arrays, **NAMES),
        "equations for one point": ODESimulator(of_one_point, **NAMES),
        "equations that fill a vector": ODESimulator(filled, **NAMES),
        "equations with matrices": ODESimulator(by_matrices, **NAMES),
        "python-control, linear": ControlSimulator(linear, dt=0.05),
        "python-control, nonlinear": ControlSimulator(
            nonlinear_system(lambda t, x, u, params: [x[0]]), dt=0.05, params=PARAMS
        ),
        "python-control, states as outputs": ControlSimulator(nonlinear_system(), dt=0.05, params=PARAMS),
        "python-control, interconnected": ControlSimulator(interconnected(), dt=0.05, params=PARAMS),
        "CasADi, SX": CasadiSimulator(casadi_function(ca.SX), **NAMES),
        "CasADi, MX": CasadiSimulator(casadi_function(ca.MX), **NAMES),
    }


def main():
    """Run the cases that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    asked = parser.parse_args().names
    warnings.simplefilter("ignore")
    made, rng = systems(), np.random.default_rng(0)
    plant = AugmentedSimulator(
        made["equations on arrays"], [CATALOGUE["quadratic_drag"]("v", "v")], [{"coefficient": 0.8}]
    )
    U = np.repeat(rng.uniform(-3, 3, (4, 20)), 15, axis=1)
    q = np.concatenate([plant.simulate(u[:, None]) for u in U])
    v = np.concatenate([plant.simulate_states(u[:, None])[0][:, 1:2] for u in U])
    noisy = [y + 0.01 * y.std() * rng.normal(size=y.shape) for y in (q, v)]
    groups, first = np.repeat(np.arange(4), 300), None
    for name, simulator in made.items():
        if asked and name not in asked:
            continue
        Y = noisy[0] if len(simulator.outputs) == 1 else np.concatenate(noisy, axis=1)
        started = time.process_time()
        report = GapDiagnoser(simulator, random_state=0, n_jobs=1).fit(U.reshape(-1, 1), Y, groups=groups).report_
        seconds = time.process_time() - started
        first = first or seconds
        found = ", ".join(f"{effect.name}@{effect.location}" for effect in report.effects)
        print(f"{name}: {report.verdict}, {found}; {seconds:.1f} s, {seconds / first:.1f}", flush=True)


if __name__ == "__main__":
    main()
