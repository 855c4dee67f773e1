"""Values and intervals of named effects are in one range; a fault of the record in words."""

import numpy as np
import pytest

from sksurrogate.effects._disturbance import PeriodicDisturbance
from sksurrogate.gap.decide._estimates import reported
from sksurrogate.gap.results._data_faults import DataFault
from sksurrogate.gap.results._table import Table


@pytest.mark.parametrize("amplitude", [1.5, -1.5])
@pytest.mark.parametrize("phase", [-9.0, -3.3, 0.4, 3.0, 8.0])
def test_every_value_lies_in_its_interval_and_is_the_same_effect(amplitude, phase):
    effect, theta = PeriodicDisturbance("speed"), np.array([amplitude, 2.0, phase])
    params, intervals = reported(effect, theta, theta - [0.1, 0.2, 0.3], theta + [0.2, 0.1, 0.4])
    for name, width in zip(params, (0.3, 0.3, 0.7)):
        low, high = intervals[name]
        assert low < params[name] < high and high - low == pytest.approx(width)
    assert params["amplitude"] > 0 and -np.pi < params["phase"] <= np.pi
    t = np.linspace(0, 5, 50)
    given = amplitude * np.sin(2.0 * t + phase)
    np.testing.assert_allclose(params["amplitude"] * np.sin(params["angular_frequency"] * t + params["phase"]), given)


@pytest.mark.parametrize("runs, said", [((None,), "in the record (row 3)"), (("a",), "in run 'a' (row 3)")])
def test_a_fault_of_an_unlabelled_record_names_no_run(runs, said):
    fault = DataFault("spikes", "y", "output", runs, (3,), 0.5)
    assert fault.what == f"1 spike of up to 0.5 {said}"


def test_runs_with_offsets_of_their_own_are_said_to_have_up_to_the_largest():
    one, two = (
        DataFault("offset", "y", "output", tuple(v), (), 0.5, values=v) for v in ({"a": 0.5}, {"a": 0.5, "b": 0.2})
    )
    assert one.what == "an offset of 0.5 in run 'a'" and two.what.startswith("an offset of up to 0.5 in run")


def test_a_table_is_printed_in_columns():
    table = Table(
        ({"name": "friction", "size": 0.12345678, "seen": None}, {"name": "lag", "size": 2.0, "seen": (1, 2)})
    )
    assert str(table).splitlines() == ["name      size    seen", "friction  0.1235  -", "lag       2       (1, 2)"]
    assert str(Table()) == "(empty)"
