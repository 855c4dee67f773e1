"""Re-tuned parameters and formulae as they are reported: closed forms of shares, errors and of the choice among equals."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.gap.decide._retuning import parameter_errors, retuned_table
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE
from sksurrogate.gap.unnamed._formula_fit import ranked_laws


def test_parameters_that_moved_share_what_re_tuning_closes():
    params = {
        "k": -2.0,
        "c": 0.0,
        "m": 5.0,
    }  # a factor exp(phi), a sum where the nominal value is 0, a third that stays
    phi, half = np.array([np.log(1.5), 0.3, 0.01]), np.array([0.1, 0.2, 0.05])
    table = retuned_table(params, list(params), phi, phi - half, phi + half)
    assert table.column("moved") == [True, True, False]
    k, c = parameter_errors(table, 0.9)
    assert (k.name, k.location, k.share, c.location, c.share) == ("parameter_error", "k", 0.45, "c", 0.45)
    assert k.params["relative_error"] == pytest.approx(0.5) and c.params["relative_error"] == pytest.approx(0.3)
    low, high = k.intervals["relative_error"]
    assert (low, high) == pytest.approx((1.5 * np.exp(-0.1) - 1.0, 1.5 * np.exp(0.1) - 1.0))
    assert c.intervals["relative_error"] == pytest.approx((0.1, 0.5))


@dataclass(frozen=True, eq=False)
class Law:
    """As much of a fitted law as the order asks for."""

    found: SimpleNamespace
    price: float
    location: str = "x"
    kind: str = "state"


def ordered(*laws):
    """Numbers of laws (log likelihood, price, parameters, location), best first."""
    fits = [Law(SimpleNamespace(candidate=SimpleNamespace(value=v, n_parameters=n)), p, *at) for v, p, n, *at in laws]
    search = SimpleNamespace(
        ranked=lambda candidates, base: candidates, judged=Judged(fits), order=lambda some: lambda one: one.value
    )
    found = ranked_laws(search, SimpleNamespace(candidate=None), fits)
    return [next(k for k, law in enumerate(fits) if law.found is one.found) for one in found]


class Judged(dict):
    """Evidence by the identity of a candidate."""

    def __init__(self, fits):
        super().__init__({id(law.found.candidate): law.found for law in fits})

    def __getitem__(self, candidate):
        return super().__getitem__(id(candidate))


def test_of_laws_as_likely_the_one_with_the_fewest_parameters_is_first():
    near, far = 20.0 - 0.9 * NATS_THAT_SETTLE, 20.0 - 1.1 * NATS_THAT_SETTLE
    assert ordered((20.0, 0.0, 3), (near, 0.0, 2), (10.0, 0.0, 1)) == [1, 0, 2]
    assert ordered((20.0, 0.0, 3), (far, 0.0, 2), (10.0, 0.0, 1)) == [0, 1, 2]
    assert ordered((25.0, 10.0, 1), (22.0, 0.0, 2)) == [1, 0]  # what a formula costs counts
    assert ordered((20.0, 0.0, 2, "x"), (20.0 + 1e-9, 0.0, 2, "u")) == [0, 1]  # twin places: the first one
