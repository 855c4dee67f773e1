"""Withheld laws: the plant follows their equations, and a formula is scored against them."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sksurrogate.blind import draw
from sksurrogate.blind._cases import _beyond
from sksurrogate.blind._law_score import effect_r2, law_score
from sksurrogate.blind._laws import GROUPS, WITHHELD, family
from sksurrogate.blind._march import march
from sksurrogate.blind._plants import PLANTS
from sksurrogate.blind._truths import KINDS, Truth


def test_groups_hold_every_law_once_and_their_shares_add_up():
    names = [name for group, _ in GROUPS for name in group]
    assert sorted(names) == sorted(WITHHELD) and sum(share for _, share in GROUPS) == 1.0
    assert not set(names) & set(KINDS) and family("law_sine") is WITHHELD["law_sine"]


@pytest.mark.parametrize("name", ["law_late_square", "law_late_tanh"])
def test_a_law_of_the_recent_past_is_a_filter_and_a_term(name):
    """Against scipy, with the filter written out; it has settled at the first value."""
    plant = PLANTS["oscillator"]
    params = {"size": -0.4, "scale": 0.5, "time_constant": 0.3}
    U, X0 = np.full((1, 40, 1), 0.7), np.array([[0.3, 0.2]])
    found = march(plant, U, X0, [Truth(name, "velocity", "velocity", params)], substeps=12).states[0]

    def rhs(t, z):
        x, w = z[:2], z[2]
        term = -0.4 * (w**2 if name == "law_late_square" else np.tanh(w / 0.5))
        dx = np.array([float(v) for v in plant.rhs(t, x, U[0, 0], dict(plant.params))])
        return [dx[0], dx[1] + term, (x[1] - w) / 0.3]

    times = plant.dt * np.arange(40)
    want = solve_ivp(rhs, (0, times[-1]), [0.3, 0.2, 0.2], t_eval=times, rtol=1e-9, atol=1e-10).y
    np.testing.assert_allclose(found.T, want[:2], rtol=1e-4, atol=1e-5)


@pytest.mark.slow
def test_a_case_goes_beyond_its_range_and_is_scored_there():
    case = draw("law", 90001)
    plain = np.array(
        [case.question.simulator.simulate(U, x0=x) for U, x in zip(case.question.X_test, case.question.x0_test)]
    )
    truth = case.truths[0]
    term = {"shapes": list(WITHHELD[truth.name].marks[:1]), "drivers": (truth.variable or truth.location).split("*")}
    law = {"text": "f", "location": truth.location, "kind": "state", "certified": True, "terms": [term]}
    answer = {"law": law, "predicted": case.y_test, "predicted_far": case.y_far}
    row = law_score(case, answer)
    assert row["law_r2"] == 1.0 and row["law_place"] and row["law_structure"]
    assert law_score(case, {**answer, "predicted": plain})["law_r2"] == pytest.approx(0.0, abs=1e-9)
    assert not law_score(case, {**answer, "law": None})["law_structure"]
    if case.y_far is not None:
        assert np.ptp(case.question.X_far) > 1.3 * np.ptp(case.question.X_test) and row["law_r2_far"] == 1.0
    assert set(case.facts["truths"][0]) >= {"name", "params"} and case.facts["noise"] in (0.01, 0.02)


def test_half_of_an_effect_has_three_quarters_of_its_power():
    y = np.arange(4.0).reshape(1, 4, 1)
    assert effect_r2(0 * y, 0.5 * y, y, np.ones(1)) == pytest.approx(0.75)


@pytest.mark.parametrize("positive", [True, False])
def test_runs_beyond_lie_half_as_far_out_again_about_their_centre(positive):
    plant = next(one for one in PLANTS.values() if one.positive is positive)
    rng = np.random.default_rng(0)
    X, x0 = 0.1 * rng.uniform(size=(2, 40, len(plant.inputs))), 0.1 * rng.uniform(size=(2, len(plant.states)))
    X_far, x0_far, y_far = _beyond(plant, X, x0, (), [0])
    for near, far in ((X, X_far), (x0, x0_far)):
        about = near.reshape(-1, near.shape[-1]).mean(axis=0) if not positive else 0.0
        np.testing.assert_allclose(far - about, 1.5 * (near - about), atol=1e-12)
    np.testing.assert_allclose(y_far, march(plant, X_far, x0_far, (), substeps=12).outputs[..., [0]])
