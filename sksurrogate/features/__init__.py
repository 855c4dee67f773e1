"""Features for surrogate models: phi(x) of section 2.1 of the paper, lags, and repair of the data before.

The identity and polynomials are scikit-learn's own: pass X as it is (or ``FunctionTransformer()``), and
``sklearn.preprocessing.PolynomialFeatures``.
"""

from sksurrogate.features._clean import Interpolator
from sksurrogate.features._fourier import FourierFeatures
from sksurrogate.features._gaussian import GaussianFeatures
from sksurrogate.features._heaviside import HeavisideFeatures
from sksurrogate.features._lag import LagEmbedding
from sksurrogate.features._outliers import OutlierFilter
from sksurrogate.features._spline import SplineFeatures

__all__ = [
    "FourierFeatures",
    "GaussianFeatures",
    "HeavisideFeatures",
    "Interpolator",
    "LagEmbedding",
    "OutlierFilter",
    "SplineFeatures",
]
