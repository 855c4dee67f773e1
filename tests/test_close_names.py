"""Names that a mistyped one may stand for."""

from sksurrogate._close_names import did_you_mean


def test_at_most_three_names_are_offered_the_nearest_first():
    said = did_you_mean("valve", ["valve_a", "valve_bc", "valve_cde", "valve_defg", "pump"])
    assert said == " did you mean 'valve_a' or 'valve_bc' or 'valve_cde'?"
