"""A form of a law says the same as a function, as text and to sympy."""

import numpy as np
import pytest

from sksurrogate.effects import InputLawEffect
from sksurrogate.effects._formula import SHAPES, Term
from sksurrogate.kernels.signals import Signal

FUNCTIONS = {name: getattr(np, name) for name in ("sin", "cos", "tanh", "exp", "sqrt", "log", "sign")}
#: Of positive signals only; a B-spline is no word of sympy's, time is not the signal.
POSITIVE, OWN = {"flow", "hill"}, {"spline", "after"}


@pytest.mark.parametrize("name", sorted(set(SHAPES) - OWN))
@pytest.mark.parametrize("v", [0.4, 1.3, -0.4, -1.3])
def test_function_text_and_expression_are_one(name, v):
    sympy = pytest.importorskip("sympy")
    if name in POSITIVE:
        v = abs(v)
    shape, c, d = SHAPES[name], 0.7, 1.6
    constants = (c, 0.0, d)[: shape.value.__code__.co_argcount - 1]  # 0: kinks that are not rounded
    signal = sympy.Symbol("v", real=True)
    expression = sympy.sympify(shape.symbolic(sympy, signal, c, d)).subs(signal, v)
    text = shape.text.format(v=f"({v})", c=f"({c})", d=f"({d})").replace("^", "**")
    value = float(shape.value(np.array(v), *constants))
    assert float(expression) == pytest.approx(value, abs=1e-9)
    assert float(eval(text, {"abs": abs, "max": max, "min": min, **FUNCTIONS})) == pytest.approx(value, abs=1e-9)


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_what_latex_says_holds_the_signal_and_the_constants_of_the_text(name):
    shape, given = SHAPES[name], {"v": "VVV", "c": "CCC", "d": "DDD"}
    text, latex = shape.text.format(**given), shape.latex.format(**given)
    for letter in ("CCC", "DDD", *(["VVV"] if name != "after" else [])):
        assert (letter in latex) == (letter in text)
    assert latex.count("{") == latex.count("}")


@pytest.mark.parametrize("name", sorted(set(SHAPES) - {"sine", "cosine", "root", "flow"}))  # of angles; of half powers
def test_units_of_a_shape_and_of_its_constants_are_those_of_its_function(name):
    """A signal in units three times as small."""
    shape, c, d = SHAPES[name], 0.7, 1.6
    first, second = (3.0**power for power in (*shape.constant_powers, 1)[:2])
    power = c if shape.power is None else shape.power
    v, more = np.array([0.4, 0.9, 1.3]), shape.value.__code__.co_argcount - 3
    there = shape.value(3.0 * v, first * c, 0.0, *[second * d][:more])
    np.testing.assert_allclose(there, 3.0**power * shape.value(v, c, 0.0, *[d][:more]))


def test_a_law_at_an_input_of_ramps_is_exact_where_it_is_linear_or_square():
    mean, half = np.array([[[1.0, 2.0, -1.0]]]), np.array([[[0.5, -0.25, 0.0]]])
    for shape, wanted in [("v", 1.4 * mean), ("square", mean + 0.4 * (mean**2 + half**2 / 3))]:
        law = InputLawEffect("u", "u", (Term(((shape, "u", 0.0, 0.0),)),), (0.4,))
        found = law.transform(Signal(mean, half), None, [np.full((1, 1), 0.4)], 0.1, np.array([0]))
        np.testing.assert_allclose(found.mean, wanted)
        ends = [end + 0.4 * (end if shape == "v" else end**2) for end in (mean - half, mean + half)]
        np.testing.assert_allclose(2 * found.half, ends[1] - ends[0])
        held = law.transform(Signal(mean), None, [np.full((1, 1), 0.4)], 0.1, np.array([0]))
        assert held.half is None
        np.testing.assert_allclose(held.mean, mean + 0.4 * (mean if shape == "v" else mean**2))
