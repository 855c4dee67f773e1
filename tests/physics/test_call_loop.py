"""Calls at one point after the other: the machine code does what the same calls through ctypes do."""

import ctypes

import numpy as np
import pytest

from sksurrogate.physics._call_loop import Call, CallLoop, Real, Row

KINDS = {"handle": ctypes.c_size_t, "number": ctypes.c_double, "row": ctypes.c_size_t}


@pytest.fixture(params=["machine code", "ctypes"])
def native(request):
    """Both ways."""
    if request.param == "machine code":
        pytest.importorskip("llvmlite", reason="the extra fmu brings llvmlite; without it there is no machine code")
    return request.param == "machine code"


def function(of):
    """A Python function (handle, number, row) as a C function, and its address."""
    kept = ctypes.CFUNCTYPE(ctypes.c_int, *KINDS.values())(
        lambda handle, number, row: of(handle, number, ctypes.cast(row, ctypes.POINTER(ctypes.c_double)))
    )
    return kept, ctypes.cast(kept, ctypes.c_void_p).value


def test_every_point_is_called_in_order_with_its_own_row_and_number(native):
    heard = []

    def first(handle, number, row):
        heard.append((handle, number, row[0], row[1]))
        row[1] = row[0] + number
        return 1  # a warning is a success

    def second(handle, number, row):
        heard.append((handle, number, row[0], row[1]))
        return 0

    (_one, at_one), (_two, at_two) = function(first), function(second)
    loop = CallLoop(
        [Call(at_one, (2**62, Real("t"), Row("x")), "when"), Call(at_two, (5, Real("t"), Row("x")))], native
    )
    assert loop.native == native
    x, t = np.array([[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]), np.array([0.5, -1.5, 2.5])
    assert loop(0, {"x": x, "t": t, "when": np.array([True, False, True])}) == (3, 0)
    assert heard == [
        (2**62, 0.5, 1.0, 0.0), (5, 0.5, 1.0, 1.5), (5, -1.5, 2.0, 0.0), (2**62, 2.5, 3.0, 0.0), (5, 2.5, 3.0, 5.5)
    ]  # fmt: skip
    assert x.tolist() == [[1.0, 1.5], [2.0, 0.0], [3.0, 5.5]]


def test_the_loop_stops_at_the_call_that_fails_and_goes_on_where_it_is_told(native):
    heard = []

    def fails(handle, number, row):
        heard.append((handle, number))
        return 3 if (handle, number) == (1, 2.0) else 0

    _kept, at = function(fails)
    loop = CallLoop([Call(at, (1, Real("t"), Row("t"))), Call(at, (2, Real("t"), Row("t")))], native)
    t = {"t": np.arange(5.0)}
    assert loop(0, t) == (2, 3)
    assert heard[-1] == (1, 2.0)  # nothing is called behind it
    assert loop(3, t) == (5, 0)
    assert heard[5:] == [(1, 3.0), (2, 3.0), (1, 4.0), (2, 4.0)]


def test_more_points_than_a_stretch(native, monkeypatch):
    monkeypatch.setattr("sksurrogate.physics._call_loop._STRETCH", 4)

    def add(handle, number, row):
        row[0] += number
        return 2 if number == 9.0 else 0

    _kept, at = function(add)
    t, x = np.arange(12.0), np.zeros((12, 1))
    loop = CallLoop([Call(at, (0, Real("t"), Row("x")))], native)
    assert loop(0, {"t": t, "x": x}) == (9, 2)
    assert x[:, 0].tolist() == [*range(10), 0.0, 0.0]
