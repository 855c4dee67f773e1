"""Effects of a set are chosen again one by one: each of them is left out, and once more where the set has come near the data."""

from types import SimpleNamespace

import pytest

from sksurrogate.gap.search._ode_search import OdeSearch

#: Costs of sets by name; all others cost 900.
COSTS = {"abc": 500.0, "bcx": 400.0, "bxy": 20.0, "xyz": 5.0, "bxz": 300.0}


class Swaps(OdeSearch):
    """A search over sets of letters, whose costs are known."""

    frugal = False

    def __init__(self, near):
        self.near, self.left_out, self.judged = near, [], _Far()

    def without(self, candidate, i):
        self.left_out.append((candidate.name, candidate.keys[i]))
        return one([key for key in candidate.keys if key != candidate.keys[i]])

    def expand(self, base, wanted):
        return [one([*base.keys, letter]) for letter in "abcxyz" if letter not in base.keys]

    def ranked(self, candidates, base):
        return sorted(candidates, key=lambda candidate: candidate.fit.cost)

    def polish(self, candidate):
        return candidate

    def plausible(self, candidate):
        return True

    def is_far(self, candidate):
        return candidate.fit.cost > self.near

    def order(self, candidates):
        return lambda candidate: -candidate.fit.cost


class _Far(dict):
    def __missing__(self, candidate):
        return SimpleNamespace(left=99.0)


class one:
    """A set, in the order in which its effects were added."""

    def __init__(self, keys):
        self.keys = self.effects = tuple(keys)
        self.name = "".join(sorted(keys))
        self.fit = SimpleNamespace(cost=COSTS.get(self.name, 900.0))


@pytest.mark.parametrize(("near", "found", "passes"), [(1.0, "bxy", 1), (100.0, "xyz", 2)])
def test_every_effect_is_left_out_also_where_one_before_it_was_replaced(near, found, passes):
    search = Swaps(near)
    assert search.swap(one("abc")).name == found
    assert [key for _, key in search.left_out[:3]] == ["a", "b", "c"]
    assert len(search.left_out) == 3 * passes


def test_a_set_that_stays_is_gone_through_once():
    search = Swaps(100.0)
    assert search.swap(one("xyz")).name == "xyz"
    assert len(search.left_out) == 3
