"""Sines and cosines as features."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any, NamedTuple

import numpy as np
from sklearn.utils._param_validation import Interval, StrOptions

from sksurrogate.exceptions import DataError
from sksurrogate.features._base import INTERACTION, BaseFeatures, rising
from sksurrogate.kernels.bases import fourier


class Waves(NamedTuple):
    """Wavelengths of one input, and whether a constant comes with them."""

    lengths: np.ndarray
    constant: bool


class FourierFeatures(BaseFeatures):
    """A constant, sines and cosines.

    Parameters
    ----------
    n_harmonics : int, default=5
        Pairs of sine and cosine for each input.
    period : None, float or array-like (n_inputs,), default=None
        Longest wave of the harmonics, in units of the input: sin(2 pi i x / period). None: the range of the input seen in
        ``fit``, whose ends are then forced to agree; give twice the range where they should not.
    form : {"harmonics", "subharmonics"}, default="harmonics"
        "harmonics": waves period / i. "subharmonics": waves i * period, the form 2 pi x / i in which the paper writes the
        series; ``period=None`` is 1 then.
    interaction : bool or {"additive", "tensor"}, default=False
        With several inputs: side by side (with one constant), or all products.

    Attributes
    ----------
    bases_ : list of Waves
        Wavelengths of each input, and whether the constant is counted there.
    n_features_out_ : int
    n_features_in_ : int
    feature_names_in_ : ndarray of str
        Where X is a frame.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 2.1 (iii).

    Examples
    --------
    >>> from sksurrogate.features import FourierFeatures
    >>> waves = FourierFeatures(n_harmonics=1, period=4.0).fit([[0.0], [1.0]])
    >>> waves.transform([[1.0]]).round(12)
    array([[1., 1., 0.]])
    >>> waves.get_feature_names_out(["u"])
    array(['1', 'sin1(u)', 'cos1(u)'], dtype=object)
    """

    _parameter_constraints: dict = {
        "n_harmonics": [Interval(Integral, 1, None, closed="left")],
        "period": [None, Interval(Real, 0, None, closed="neither"), "array-like"],
        "form": [StrOptions({"harmonics", "subharmonics"})],
        "interaction": INTERACTION,
    }

    def __init__(
        self,
        n_harmonics: int = 5,
        *,
        period: Any = None,
        form: str = "harmonics",
        interaction: bool | str = False,
    ):
        self.n_harmonics = n_harmonics
        self.period = period
        self.form = form
        self.interaction = interaction

    def _learn(self, x: np.ndarray, j: int) -> Waves:
        counts = np.arange(1, self.n_harmonics + 1)
        length = self._period_of(x, j)
        lengths = length / counts if self.form == "harmonics" else length * counts
        return Waves(lengths, self._multiplied or j == 0)

    def _period_of(self, x: np.ndarray, j: int) -> float:
        """Period of input j."""
        if self.period is None:
            return float(np.ptp(rising(np.array([x.min(), x.max()])))) if self.form == "harmonics" else 1.0
        periods = np.asarray(self.period, dtype=float)
        if periods.ndim == 0:
            return float(periods)
        if periods.shape != (self.n_features_in_,) or not (np.isfinite(periods) & (periods > 0)).all():
            raise DataError(
                f"period={self.period!r} must be a positive number, or one for each of the {self.n_features_in_} inputs."
            )
        return float(periods[j])

    def _values(self, basis: Waves, x: np.ndarray, derivative: int) -> np.ndarray:
        return fourier(x, basis.lengths, basis.constant, derivative)

    def _labels(self, basis: Waves, name: str) -> list[str]:
        pairs = [f"{wave}{i + 1}({name})" for i in range(len(basis.lengths)) for wave in ("sin", "cos")]
        return ["1", *pairs] if basis.constant else pairs
