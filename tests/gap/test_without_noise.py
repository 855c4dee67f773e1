"""Records without noise, as another simulator makes them: what the numerics leave has no name, and a rounding is still seen."""

import numpy as np
from scipy.integrate import solve_ivp

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT = 0.05


def spring():
    def rhs(t, x, u, p):
        return x[1], u[0] - p["k"] * x[0] - p["c"] * x[1]

    return ODESimulator(
        rhs, states=["q", "v"], inputs=["u"], outputs=["q", "v"], params={"k": 2.0, "c": 0.4}, dt=DT, x0=[0, 0]
    )


def recorded(force, runs, samples, held):
    """Levels of the input, each ``held`` for some samples, exact states of a spring with one force more, and runs."""
    rng, U, Y = np.random.default_rng(0), [], []
    for _ in range(runs):
        u = np.repeat(rng.uniform(-2, 2, samples // held + 1), held)[:samples]
        states = [rng.uniform(-1, 1, 2)]
        for level in u[:-1]:
            made = solve_ivp(
                lambda t, x, level=level: [x[1], level - 2 * x[0] - 0.4 * x[1] + force(x)],
                (0.0, DT), states[-1], rtol=1e-9, atol=1e-11, max_step=DT,
            )  # fmt: skip
            states.append(made.y[:, -1])
        U.append(u[:, None])
        Y.append(states)
    return np.concatenate(U), np.concatenate(Y), np.repeat(np.arange(runs), samples)


def test_what_the_numerics_leave_beside_an_effect_has_no_name():
    """Seen before: an exchange of 1e-6, named with a probability of 0.99."""
    U, y, groups = recorded(lambda x: -1.5 * x[0] ** 3, 6, 300, 20)
    report = GapDiagnoser(spring(), random_state=0, n_jobs=1).fit(U, y, groups=groups).report_
    assert report.verdict == "explained"
    assert [effect.name for effect in report.effects] == ["cubic_stiffness"]
    assert abs(report.effects[0].params["coefficient"] - 1.5) < 1e-3


def test_a_rounding_is_named_where_it_is_all_that_is_there():
    """The data neither show nor exclude a law beside it: that is nothing against the name (a probability of 0.59 before)."""
    U, y, groups = recorded(lambda x: 0.0, 5, 200, 16)
    y[:, 0] = 0.05 * np.round(y[:, 0] / 0.05)
    report = GapDiagnoser(spring(), random_state=0, n_jobs=1).fit(U, y, groups=groups).report_
    assert report.verdict == "explained"
    (found,) = report.effects
    assert (found.name, found.location) == ("sensor_quantization", "q") and found.probability > 0.95
