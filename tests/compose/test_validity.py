"""Coverage of (y, u): shares against areas, holes where none were measured."""

import numpy as np
import pytest

from sksurrogate.compose import coverage_report
from sksurrogate.exceptions import DataError


def square(n=60, low=0.0, high=1.0):
    axis = np.linspace(low, high, n)
    y, u = (part.ravel() for part in np.meshgrid(axis, axis))
    return u[:, None], y


def test_the_share_is_that_of_the_area():
    X, y = square(high=0.5)
    report = coverage_report(X, y, box=[(0, 1), (0, 1)], radius=0.01)
    # a quarter, a strip of one radius, a quarter of a disc
    assert report.share == pytest.approx(0.25 + 0.01 + np.pi * 1e-4 / 4, abs=3e-3)
    assert report.covers(np.array([[0.2], [0.8]]), np.array([0.2, 0.2])).tolist() == [True, False]


def test_the_largest_hole_is_found_and_holes_keep_apart():
    X, y = square()
    hole = np.hypot(X[:, 0] - 0.7, y - 0.3) > 0.2
    report = coverage_report(X[hole], y[hole], radius=0.05)
    np.testing.assert_allclose(report.holes[0], [0.3, 0.7], atol=0.03)
    assert report.hole_radius[0] == pytest.approx(0.2, abs=0.03)
    assert "nothing within 0.2" in str(report)


def test_units_do_not_matter():
    X, y = square(20, 0.0, 0.5)
    a = coverage_report(X, y, box=[(0, 1), (0, 1)])
    b = coverage_report(1e3 * X, 1e-3 * y, box=[(0, 1e-3), (0, 1e3)])
    assert a.share == b.share
    np.testing.assert_allclose(a.hole_radius, b.hole_radius)


def test_a_wrong_box_says_what_is_expected():
    X, y = square(5)
    with pytest.raises(DataError, match=r"expected \(2, 2\)"):
        coverage_report(X, y, box=[(0, 1)])
    with pytest.raises(DataError, match="radius=0"):
        coverage_report(X, y, radius=0)


def test_holes_stand_apart():
    rng = np.random.default_rng(0)
    X, y = rng.uniform(0, 0.4, (80, 1)), rng.uniform(0, 0.4, 80)
    report = coverage_report(X, y, box=[(0, 1), (0, 1)], n_holes=6)
    assert len(report.holes) > 2
    for i, centre in enumerate(report.holes):  # the emptiest first: a later one is no nearer to them than to the data
        apart = np.linalg.norm(report.holes[:i] - centre, axis=1)
        assert np.all(apart >= report.hole_radius[i] - 1e-12)
    assert np.all(np.diff(report.hole_radius) <= 0)


def test_a_constant_column_takes_no_part():
    X, y = square(40)
    plain = coverage_report(X, y)
    for constant in (3.0, 0.0, -1e6):
        with_it = coverage_report(np.c_[X, np.full(len(X), constant)], y)
        assert with_it.share == plain.share == 1.0
        assert not len(with_it.holes)
    hole = np.hypot(X[:, 0] - 0.7, y - 0.3) > 0.2
    plain, with_it = (coverage_report(part[hole], y[hole]) for part in (X, np.c_[X, np.full(len(X), 3.0)]))
    assert with_it.share == plain.share < 0.95
    np.testing.assert_array_equal(with_it.holes[:, :2], plain.holes)
    np.testing.assert_array_equal(with_it.holes[:, 2], 3.0)
    np.testing.assert_array_equal(with_it.hole_radius, plain.hole_radius)


def test_a_column_that_is_constant_to_rounding_takes_no_part_either():
    X, y = square(40)
    noisy = np.where(np.arange(len(X)) % 2, 0.3, 0.1 + 0.2)
    assert np.ptp(noisy) > 0
    assert coverage_report(np.c_[X, noisy], y).share == 1.0


def test_a_report_agrees_with_itself_about_its_holes():
    y = np.r_[np.linspace(0, 0.3, 50), np.linspace(0.8, 1, 50)]
    report = coverage_report(np.full((100, 1), 3.0), y)  # one input, which does not move
    assert report.share == pytest.approx(0.6, abs=1e-3)  # 0.3 and 0.2 of data, a radius at either side of the gap
    np.testing.assert_allclose(report.holes[0], [0.55, 3.0], atol=1e-3)
    assert not report.covers(report.holes[:, 1:], report.holes[:, 0]).any()
    assert not report.covers([[5.0]], [0.1])[0]
    assert coverage_report(np.full((5, 1), 3.0), np.ones(5)).share == 1.0


def test_a_box_without_width_is_a_slice_of_the_data():
    X, y = square(41)  # u in steps of 0.025
    assert coverage_report(X, y, box=[(0, 1), (0.5, 0.5)], radius=0.02).share == 1.0
    beside = X[:, 0] < 0.46
    assert coverage_report(X[beside], y[beside], box=[(0, 1), (0.5, 0.5)], radius=0.02).share == 0.0
