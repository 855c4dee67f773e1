"""Bases against scipy, against scikit-learn, and against the identities that they must keep."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline, make_interp_spline
from sklearn.preprocessing import SplineTransformer

from sksurrogate.kernels import bases
from sksurrogate.kernels.bases import spline_at_data, spline_csr, spline_on

EVEN = np.linspace(-1.0, 2.0, 7)
UNEVEN = np.array([-1.0, -0.7, 0.1, 0.4, 1.3, 2.0])


def dense(x, spline, order=0):
    return spline_csr(x[:, None], [spline], derivatives=[order]).toarray()


def by_scipy(x, spline, order=0):
    """Every spline alone, as a BSpline with one coefficient; continued by the polynomial of the last interval."""
    n = len(spline.knots) - spline.degree - 1
    columns = []
    for j in range(n):
        one = BSpline(spline.knots, np.eye(n)[j], spline.degree, extrapolate=True)
        columns.append(one.derivative(order)(x) if order else one(x))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("degree", range(7))
@pytest.mark.parametrize("breaks", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_splines_and_their_derivatives_equal_scipy(degree, breaks, order):
    x = np.linspace(-1.0, 2.0, 401)[1:-1]
    x = x[np.abs(x[:, None] - breaks).min(axis=1) > 1e-9]  # pieces may jump at the knots
    spline = spline_on(breaks, degree)
    expected = by_scipy(x, spline, order) if order <= degree else 0.0
    np.testing.assert_allclose(dense(x, spline, order), expected, atol=1e-11 * 10.0**order)


@pytest.mark.parametrize("degree", range(5))
@pytest.mark.parametrize("extrapolation", ["constant", "linear", "continue", "periodic"])
@pytest.mark.parametrize("breaks", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_extrapolation_equals_scikit_learn(degree, extrapolation, breaks):
    x = np.linspace(-4.0, 5.0, 300)
    if degree == 0 and extrapolation in ("linear", "constant"):
        pytest.skip("scikit-learn 1.9 refuses the one and fails on rows outside in the other")
    peer = SplineTransformer(degree=degree, knots=breaks[:, None], extrapolation=extrapolation).fit(breaks[:, None])
    ours = dense(x, spline_on(breaks, degree, extrapolation))
    np.testing.assert_allclose(ours, peer.transform(x[:, None]), atol=2e-11)


@given(
    degree=st.integers(0, 8),
    widths=st.lists(st.floats(0.05, 3.0), min_size=1, max_size=8),
    even=st.booleans(),
    extrapolation=st.sampled_from(["constant", "linear", "continue", "periodic", "zero"]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=80, deadline=None)
def test_splines_sum_to_one_and_are_positive(degree, widths, even, extrapolation, seed):
    breaks = np.r_[0.0, np.cumsum(np.full(len(widths), widths[0]) if even else widths)]
    x = np.random.default_rng(seed).uniform(-1.0, breaks[-1] + 1.0, 50)
    inside = (x >= 0) & (x <= breaks[-1])
    values = dense(x, spline_on(breaks, degree, extrapolation))
    assert values[inside].min(initial=0.0) > -1e-14
    expected = inside if extrapolation == "zero" else 1.0
    # continued polynomials of degree 8 are large outside: their sum is one up to cancellation
    np.testing.assert_allclose(values.sum(axis=1), expected, atol=1e-13 * max(1.0, np.abs(values).max()))


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_higher_orders_are_moving_averages_of_lower_ones(degree):
    # the paper: "higher order splines are found recursively by integration"
    step = 1e-3
    x = np.arange(-3.0, 3.0, step)
    low = dense(x + step / 2, spline_on(np.arange(-9.0, 10.0), degree - 1))
    high = dense(x, spline_on(np.arange(-9.0, 10.0), degree))
    primitive = np.cumsum(low, axis=0) * step
    mean_over_one_interval = primitive[1000:] - primitive[:-1000]
    expected = high[1001:, 1:]  # spline j of the higher order starts one knot further left
    assert (
        np.abs(mean_over_one_interval[:-1] - expected[:, : low.shape[1]]).max() < 1e-3
    )  # midpoint rule, order 0 jumps


def test_zero_order_splines_are_differences_of_steps():
    # Remark 1, term by term
    sites = np.linspace(0.0, 9.0, 10)
    x = np.linspace(-2.0, 11.0, 1301)
    edges = np.r_[sites - 0.5, 9.5]
    unit = bases.steps(x, edges)
    pulses = dense(x, spline_at_data(sites, 0, "zero"))
    inside = x < 9.5  # H(x) = 1 from the threshold on, while the last interval is closed
    np.testing.assert_array_equal(pulses[inside], (unit[:, :-1] - unit[:, 1:])[inside])


@given(
    sites=st.lists(st.integers(-40, 40), min_size=1, max_size=12, unique=True),
    degree=st.integers(0, 5),
    seed=st.integers(0, 100),
)
@settings(max_examples=60, deadline=None)
def test_splines_centred_at_data_interpolate(sites, degree, seed):
    sites = np.sort(np.array(sites, float)) / 10
    y = np.random.default_rng(seed).normal(size=len(sites))
    spline = spline_at_data(sites, degree)
    matrix = dense(sites, spline)
    assert matrix.shape == (len(sites), len(sites))
    theta = np.linalg.solve(matrix, y)
    np.testing.assert_allclose(matrix @ theta, y, atol=1e-9)
    x = np.linspace(sites[0], sites[-1], 77)
    if 1 <= degree < len(sites):
        peer = make_interp_spline(sites, y, k=degree)
        scale = np.abs(theta).max()
        np.testing.assert_allclose(dense(x, spline) @ theta, peer(x), atol=1e-7 * max(1.0, scale))


def test_orders_zero_and_one_need_no_solve():
    # section 2.2: f_k(x) = sum_j y_j phi_j(x) passes through the data
    sites = np.array([0.0, 0.3, 1.0, 2.5])
    for degree in (0, 1):
        np.testing.assert_array_equal(dense(sites, spline_at_data(sites, degree)), np.eye(4))


def test_equidistant_route_equals_the_general_one():
    x = np.random.default_rng(0).uniform(-1.5, 2.5, 5000)
    for degree in range(6):
        for extrapolation in ("constant", "linear", "continue", "periodic", "zero"):
            fast = spline_on(EVEN, degree, extrapolation)
            slow = bases.Spline(fast.knots, degree, extrapolation, uniform=False)
            assert fast.uniform
            for order in (0, 1):
                np.testing.assert_allclose(dense(x, fast, order), dense(x, slow, order), atol=1e-11)


def test_many_rows_equal_few_rows():
    X = np.random.default_rng(1).normal(size=(2 * bases.BASIS_ROWS + 17, 3))
    splines = [spline_on(EVEN, 3), spline_on(EVEN * 2, 3), spline_on(EVEN[:4], 3)]
    whole = spline_csr(X, splines).toarray()
    apart = np.hstack([dense(x, spline) for x, spline in zip(X.T, splines)])
    np.testing.assert_array_equal(whole, apart)
    assert spline_csr(X, splines).indices.dtype == np.int32


@pytest.mark.parametrize("extrapolation", ["constant", "periodic"])
def test_product_is_kron_of_the_rows(extrapolation):
    X = np.random.default_rng(2).uniform(-1, 2, size=(40, 3))
    splines = [
        spline_on(EVEN, 1, extrapolation),
        spline_on(UNEVEN, 2, extrapolation),
        spline_on(EVEN[:3], 0, extrapolation),
    ]
    blocks = [dense(x, spline) for x, spline in zip(X.T, splines)]
    expected = np.stack([np.kron(np.kron(a, b), c) for a, b, c in zip(*blocks)])
    np.testing.assert_allclose(spline_csr(X, splines, product=True).toarray(), expected, atol=1e-15)
    np.testing.assert_allclose(bases.tensor(blocks), expected, atol=1e-15)


def test_fourier_columns_are_orthogonal_over_a_period():
    x = np.arange(64) / 64 * 3.0
    values = bases.fourier(x, 3.0 / np.arange(1, 9))
    gram = values.T @ values / 64
    np.testing.assert_allclose(gram, np.diag([1.0] + [0.5] * 16), atol=1e-14)


def test_fourier_reads_as_in_the_paper():
    x = np.array([0.3, 1.7])
    values = bases.fourier(x, np.arange(1.0, 4.0))
    np.testing.assert_array_equal(values[:, 0], 1.0)
    for i in (1, 2, 3):
        np.testing.assert_allclose(values[:, 2 * i - 1], np.sin(2 * np.pi * x / i), atol=1e-15)
        np.testing.assert_allclose(values[:, 2 * i], np.cos(2 * np.pi * x / i), atol=1e-15)


@pytest.mark.parametrize(
    "basis",
    [
        lambda x, d: bases.fourier(x, np.array([0.7, 2.0, 3.1]), derivative=d),
        lambda x, d: bases.gaussians(x, np.array([-1.0, 0.2, 1.0]), np.array([0.3, 0.5, 1.0]), derivative=d),
        lambda x, d: dense(x, spline_on(UNEVEN, 3), d),
        lambda x, d: dense(x, spline_on(UNEVEN, 2, "linear"), d),
    ],
    ids=["fourier", "gaussian", "spline", "spline, linear outside"],
)
def test_derivatives_equal_central_differences(basis):
    x = np.random.default_rng(3).uniform(-2, 3, 200)
    x = x[np.abs(x[:, None] - UNEVEN).min(axis=1) > 1e-4]
    h = 1e-5
    np.testing.assert_allclose(basis(x, 1), (basis(x + h, 0) - basis(x - h, 0)) / (2 * h), atol=1e-7)


def test_radial_gaussians_are_products_of_gaussians():
    X = np.random.default_rng(4).normal(size=(20, 2))
    centers = np.array([[0.0, 1.0], [0.5, -1.0]])
    expected = np.prod([bases.gaussians(x, c, 0.8) for x, c in zip(X.T, centers.T)], axis=0)
    np.testing.assert_allclose(bases.radial(X, centers, 0.8), expected, rtol=1e-14)
