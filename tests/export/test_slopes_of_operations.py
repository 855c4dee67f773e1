"""Every operation of a graph knows its slopes."""

import numpy as np
import pytest

from sksurrogate.export._graph import BINARY, UNARY, Graph

H = 1e-6


@pytest.mark.parametrize("name", UNARY)
def test_slopes_of_one_argument_are_those_of_differences(name):
    value, slope = UNARY[name]
    x = np.array([0.3, 0.7, 1.2]) if name in ("log", "sqrt") else np.array([-1.3, -0.4, 0.3, 0.9])
    np.testing.assert_allclose(slope(x, value(x)), (value(x + H) - value(x - H)) / (2 * H), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("name", BINARY)
def test_slopes_of_two_arguments_are_those_of_differences(name):
    value, slopes = BINARY[name]
    a, b = np.array([1.5, 0.4, 2.2]), np.array([0.7, 1.9, -0.6])
    by_a, by_b = slopes(a, b, value(a, b))
    np.testing.assert_allclose(by_a + 0 * a, (value(a + H, b) - value(a - H, b)) / (2 * H), rtol=1e-7, atol=1e-7)
    if name != "pow":  # powers of a graph are constants
        np.testing.assert_allclose(by_b + 0 * b, (value(a, b + H) - value(a, b - H)) / (2 * H), rtol=1e-7, atol=1e-7)


def test_the_slope_of_a_choice_is_that_of_what_is_chosen():
    graph = Graph()
    x = graph.input("x", 1)
    inside = graph.binary("ge", x, graph.constant(0.0))
    graph.outputs["y"] = graph.choose(inside, graph.unary("sin", x), graph.unary("exp", x))
    assert graph.jacobian(x=[0.5])["y", "x"].item() == np.cos(0.5)
    assert graph.jacobian(x=[-0.5])["y", "x"].item() == np.exp(-0.5)
