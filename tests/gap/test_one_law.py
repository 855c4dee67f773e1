"""Forms of one law: which effects are, and when a simpler one does as well."""

from types import SimpleNamespace

import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.search._nested import of_one_law
from sksurrogate.gap.search._related_forms import as_good


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (("coulomb_friction", "v", "v"), ("stribeck_friction", "v", "v"), True),
        (("coulomb_friction", "v", "v"), ("stribeck_friction", "v", "x"), False),  # in another signal
        (("coulomb_friction", "v", "v"), ("stribeck_friction", "w", "v"), False),  # at another place
        (("coulomb_friction", "v", "v"), ("gravity_tilt", "v", "v"), False),  # no form in common
        (("coulomb_friction", "v", "v"), ("coulomb_friction", "v", "v"), False),  # the same
    ],
)
def test_effects_of_one_place_and_signal_with_a_form_in_common_are_of_one_law(one, other, same):
    first, second = (CATALOGUE[name](*at) for name, *at in (one, other))
    assert of_one_law(first, second) == of_one_law(second, first) == same


@pytest.mark.parametrize(("more", "good"), [(0.0, True), (-100.0, True), (100.0, False)])
def test_far_from_the_data_a_simpler_form_is_as_good_where_the_score_of_the_richer_is_not_clearly_larger(more, good):
    scores = {"simple": 1000.0, "rich": 1000.0 + more}
    search = SimpleNamespace(is_far=lambda one: True, size_score=scores.__getitem__)
    assert as_good(search, "simple", "rich") == good
