"""What effects are made of and are given: their parameters, what the data show about a place, a signal to read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name : str
    null : float
        Value at which the effect is absent (of the magnitude; that of a shape parameter is not used).
    low, high : float
        Bounds.
    unit : str
        In words, for example "dx/dt over v".
    grows : bool
        Whether it grows with the magnitude where the whole effect does (levels of a friction with springy bristles).
    jumps : bool
        Whether it is a time at which the effect jumps.

    Examples
    --------
    >>> from sksurrogate.effects import Parameter
    >>> Parameter("coefficient", low=0.0, unit="dx/dt over v").null
    0.0
    """

    name: str
    null: float = 0.0
    low: float = -np.inf
    high: float = np.inf
    unit: str = ""
    grows: bool = False
    jumps: bool = False


@dataclass(frozen=True, eq=False)
class Probe:
    """What the data show about one place, from which an effect takes its starting values.

    Attributes
    ----------
    v : ndarray (n_samples,) or None
        The variable along the smoothed trajectory (the product for "v*w"); the input, output or state itself where
        the effect acts on it.
    x : ndarray (n_samples,)
        The state, input or output of the location.
    rate : float
        RMS of the derivative of that state; at a port the force that makes such derivatives; 0 for inputs and outputs.
    dt, duration : float
        Sample time and length of the longest run.
    starts : ndarray of int (n_runs,)
        First rows of the runs.
    factors : tuple of ndarray (n_samples,)
        The two signals of a variable "v*w" one by one.
    noise : float
        White noise of the readings of an output; 0 elsewhere, and where it is not known.
    slope : pair of ndarray (n_samples,), optional
        An input or a predicted output, and what a unit change of it at every sample would do to the log likelihood.
    feedback : float, optional
        At a port: what a unit of force there changes in dv/dt.
    gain : float, optional
        In a balance, of an effect that an input drives: what a unit of this input changes in dx/dt already.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.effects import Probe
    >>> v = np.linspace(-1, 1, 5)
    >>> probe = Probe(v=v, x=v, rate=2.0, dt=0.1, duration=0.5, starts=np.array([0]))
    >>> round(probe.unit(v), 3)   # c with which c v is a tenth of the derivative
    0.333
    """

    v: np.ndarray | None
    x: np.ndarray
    rate: float
    dt: float
    duration: float
    starts: np.ndarray
    factors: tuple[np.ndarray, ...] = ()
    noise: float = 0.0
    slope: tuple[np.ndarray, np.ndarray] | None = None
    feedback: float | None = None
    gain: float | None = None

    def unit(self, form: np.ndarray) -> float:
        """Size of a coefficient that makes ``c * form`` a tenth of the derivative."""
        size = float(np.mean(np.abs(form)))
        return 0.1 * self.rate / size if size > 0 and self.rate > 0 else 1.0

    def quantiles(self, values: np.ndarray, *q: float) -> list[float]:
        """Distinct quantiles of ``values``."""
        return list(dict.fromkeys(float(value) for value in np.quantile(values, q)))


@dataclass(frozen=True, eq=False)
class SensorPath:
    """An output between the samples as cubic pieces: values and slopes to the right and to the left of every sample.

    Attributes
    ----------
    y, right, left : ndarray (n_columns, n_samples)
    end : ndarray (n_columns, n_samples), optional
        Values just before every sample, where the output jumps with an input that it shows at once.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.effects import SensorPath
    >>> y = np.array([[0.0, 1.0, 2.0]])
    >>> SensorPath(y, np.ones((1, 3)), np.ones((1, 3))).y.shape
    (1, 3)
    """

    y: np.ndarray
    right: np.ndarray
    left: np.ndarray
    end: np.ndarray | None = None

    @property
    def before(self) -> np.ndarray:
        """Values just before every sample."""
        return self.y if self.end is None else self.end
