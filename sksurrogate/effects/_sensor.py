"""Effects on an output: what the sensor makes of it. They act in the order of this file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import Theta
from sksurrogate.effects._families import SensorEffect
from sksurrogate.effects._input import (
    delays,
    levels_inside,
    neighbouring_steps,
    quantize,
    size_of,
    step_sizes,
    times,
)
from sksurrogate.effects._lattice import LATTICE_STEPS_SPANNED, lattice_steps, shows_steps
from sksurrogate.effects._levelling import Levelling
from sksurrogate.effects._parts import Parameter, Probe, SensorPath
from sksurrogate.kernels.banded import first_order_scan
from sksurrogate.kernels.sampling import read_between
from sksurrogate.physics._simulator import Plant

#: Nodes and weights on [0, 1]: exact for the smooth kernels of lags longer than a sample.
_GAUSS = np.polynomial.legendre.leggauss(12)
_NODES, _WEIGHTS = (_GAUSS[0] + 1) / 2, _GAUSS[1] / 2
#: Steps of more than this many times the noise show in readings that span some of them (:func:`lattice_steps`).
HIDDEN = 8.0
#: Columns of readings closer than this share of a step are differences of one.
BESIDE = 1e-2
#: Range, over the noise, in which a crowd can be seen; how many times more readings it has than the same width below it, and
#: which share of all.
CROWD_RANGE, CROWD, LEAST_CROWD = 20.0, 3.0, 0.02
#: What an output outside the interval of its reading counts, of its distance.
EXCESS = 0.3


def lag_moments(ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a first-order lag makes of 1, s, s^2, s^3 over one sample, s from 0 to 1.

    ``ratio`` (n_columns, 1): time constant over sample time, >= 0.
    Returns ``moments`` (4, n_columns, 1): ``integral of exp(-(1 - s) / ratio) / ratio * s^j``.
    Returns ``decay`` (n_columns, 1): ``exp(-1 / ratio)``.
    Returns ``decay_rate`` (n_columns, 1): ``exp(-1 / ratio) / ratio``.
    """
    k = np.maximum(ratio, 1e-15)
    decay = np.exp(-1.0 / k)
    moments = np.empty((4, *k.shape))
    moments[0] = -np.expm1(-1.0 / k)
    for j in (1, 2, 3):  # by parts; cancels where the lag is long, hence the quadrature there
        moments[j] = 1.0 - j * k * moments[j - 1]
    kernel = np.exp(-(1 - _NODES) / np.maximum(k, 0.5)) / np.maximum(k, 0.5) * _WEIGHTS
    for j in (1, 2, 3):
        moments[j] = np.where(k > 0.5, np.sum(kernel * _NODES**j, axis=-1, keepdims=True), moments[j])
    return moments, decay, decay / k


def _pieces(path: SensorPath, dt: float) -> np.ndarray:
    """Coefficients of 1, s, s^2, s^3 of the cubic from every row to the next: (4, n_columns, n_samples - 1)."""
    y, following = path.y[:, :-1], path.before[:, 1:]
    m0, m1 = dt * path.right[:, :-1], dt * path.left[:, 1:]
    rise = following - y
    return np.stack([y, m0, 3 * rise - 2 * m0 - m1, m0 + m1 - 2 * rise])


class SensorLag(SensorEffect):
    """A slow sensor: ``c dw/dt + w = y`` in continuous time, ``w(0) = y(0)``."""

    name = "sensor_lag"
    order = 0
    memory = True
    parameters = (Parameter("time_constant", low=0.0, unit="time"),)
    equation = "c dw/dt + w = y, w(0) = y(0)"
    signature = "edges and fast swings are smoothed in this output alone"
    twins = ("input_lag", "sensor_delay", "input_delay", "hidden_relaxation")
    linear = False

    def follow(self, path: SensorPath, theta: Theta, dt: float, starts: np.ndarray) -> SensorPath:
        """The lag solved exactly along the cubic pieces of the path.

        The pieces handed on keep the end values, the slopes before the samples and the means of the exact solution.
        """
        ratio = np.maximum(np.reshape(theta[0], (-1, 1)), 0.0) / dt
        path = SensorPath(*np.broadcast_arrays(path.y, path.right, path.left, path.before))
        a = _pieces(path, dt)
        moments, decay, decay_rate = lag_moments(ratio)
        n_columns, n_samples = max(len(path.y), len(ratio)), path.y.shape[1]
        within = np.ones(n_samples - 1, dtype=bool)
        within[starts[1:] - 1] = False
        b = np.broadcast_to(path.y, (n_columns, n_samples)).copy()
        b[:, 1:][:, within] = np.sum(moments[:, :, :] * a, axis=0)[:, within]
        w = np.empty_like(b)
        for c in range(n_columns):
            w[c] = first_order_scan(float(decay[c if len(decay) > 1 else 0, 0]), b[c], starts)
        before, later = w[:, :-1], w[:, 1:]
        # dt w' at the end of a piece, (y - w) / ratio without the division by a small ratio.
        end = a[1] * moments[0] + 2 * a[2] * moments[1] + 3 * a[3] * moments[2] + (a[0] - before) * decay_rate
        mean = a[0] + a[1] / 2 + a[2] / 3 + a[3] / 4 - ratio * (later - before)
        first = end + 12 * (mean - (before + later) / 2)
        right, left = np.zeros_like(w), np.zeros_like(w)
        right[:, :-1][:, within] = (first / dt)[:, within]
        left[:, 1:][:, within] = (end / dt)[:, within]
        left[:, starts] = right[:, starts]
        ends = np.r_[starts[1:], n_samples] - 1
        right[:, ends] = left[:, ends]
        return SensorPath(w, right, left)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """0.3 to 30 samples."""
        return times(probe)


class SensorDelay(SensorEffect):
    """A reading that comes late: ``y(t - c)``; before the first row its value.

    ``earliest``: least delay. Below 0 the clock of this sensor may be ahead of the others: a reading shows what is to
        come.
    """

    name = "sensor_delay"
    order = 1
    memory = True
    parameters = (Parameter("delay", low=0.0, unit="time"),)
    equation = "y(t - c)"
    signature = "minus the delay times the slope of the output, from the first row on"
    twins = ("input_delay", "sensor_lag", "input_lag")
    linear = False

    def __init__(self, location: str | None = None, variable: str | None = None, earliest: float = 0.0):
        super().__init__(location, variable)
        self.earliest = earliest

    def follow(self, path: SensorPath, theta: Theta, dt: float, starts: np.ndarray) -> SensorPath:
        """The cubic piece in which ``t - c`` lies, exactly there."""
        shift = np.reshape(theta[0], (-1, 1)) / dt
        return SensorPath(*read_between(path.y, path.right, path.left, path.before, shift, dt, starts))

    def lower_bounds(self, duration: float) -> tuple[float, ...]:
        """0, or how early the clock of the sensor may be."""
        return (float(self.earliest),)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """0.3 to 30 samples, at first amid each; as many ahead where the clock may be."""
        late = delays(probe)
        return [*late, *((-delay,) for (delay,) in late if -delay >= self.earliest)]


class SensorCoupling(SensorEffect):
    """Another output leaks in, or an input reaches the sensor at once: ``y + c v``."""

    name = "sensor_coupling"
    rarity = 10.0
    order = 2
    parameters = (Parameter("coefficient", unit="y over v"),)
    equation = "y + c v, v another output or an input"
    signature = "a residual that follows another output, or an input, without delay"
    twins = ("sensor_gain", "input_coupling", "exchange")

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """The other outputs, and the inputs."""
        return (*(name for name in plant.outputs if name != location), *plant.inputs)

    def read(self, y: np.ndarray, v: np.ndarray | None, t: np.ndarray, theta: Sequence[Any]) -> np.ndarray:
        return y + theta[0] * v

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth of this output at the other one's size."""
        assert probe.v is not None
        return [(0.1 * size_of(probe.x) / size_of(probe.v),)]


class SensorNonlinearity(SensorEffect):
    """A bent characteristic: ``y + c y^2``."""

    name = "sensor_nonlinearity"
    order = 3
    parameters = (Parameter("coefficient", unit="1 over y"),)
    equation = "y + c y^2"
    signature = "the square of the output, at rest and in motion alike"
    twins = ("sensor_gain", "sensor_saturation", "quadratic_loss")

    def read(self, y: np.ndarray, v: np.ndarray | None, t: np.ndarray, theta: Sequence[Any]) -> np.ndarray:
        return y + theta[0] * y * y

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth at the output's size."""
        return [(0.1 / size_of(probe.x),)]


class SensorGain(SensorEffect):
    """A wrong scale: ``(1 + c) y``."""

    name = "sensor_gain"
    order = 4
    parameters = (Parameter("relative_error"),)
    equation = "(1 + c) y"
    signature = "a scaled copy of the output, its initial value and offset included"
    twins = ("input_gain", "parameter_error", "sensor_coupling", "sensor_nonlinearity")

    def read(self, y: np.ndarray, v: np.ndarray | None, t: np.ndarray, theta: Sequence[Any]) -> np.ndarray:
        return (1 + theta[0]) * y

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth."""
        return [(0.1,)]


class SensorBias(SensorEffect):
    """A wrong zero: ``y + c``."""

    name = "sensor_bias"
    order = 5
    parameters = (Parameter("value", unit="y"),)
    equation = "y + c"
    signature = "a constant from the first row on, without transient"
    twins = ("constant_bias", "input_bias", "sensor_drift")

    def read(self, y: np.ndarray, v: np.ndarray | None, t: np.ndarray, theta: Sequence[Any]) -> np.ndarray:
        return y + theta[0]

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth of the output's deviation."""
        return [(0.1 * (float(np.std(probe.x)) or 1.0),)]


class SensorDrift(Levelling, SensorEffect):
    """A zero that wanders: ``y + c t``; it may level off."""

    name = "sensor_drift"
    rarity = 10.0
    order = 6
    parameters = (Parameter("rate", unit="y over time"),)
    equation = "y + c t"
    signature = "a ramp that the plant does not filter"
    twins = ("drift", "sensor_bias", "parameter_drift")

    def read(self, y: np.ndarray, v: np.ndarray | None, t: np.ndarray, theta: Sequence[Any]) -> np.ndarray:
        return y + theta[0] * self.elapsed(t)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth of the output's deviation in the middle of the longest run."""
        middle = self.elapsed(0.5 * max(probe.duration, probe.dt))
        return [(0.1 * (float(np.std(probe.x)) or 1.0) / middle,)]


class SensorRectification(SensorEffect):
    """A sensor that loses the sign: ``abs(y)``. It has no parameter: it is there or it is not."""

    name = "sensor_rectification"
    rarity = 10.0
    order = 7
    parameters = ()
    equation = "abs(y)"
    signature = "a mirror image wherever the output is negative"
    folds = True
    twins = ("sensor_nonlinearity",)
    linear = False

    def read(self, y: np.ndarray, v: np.ndarray | None, t: np.ndarray, theta: Sequence[Any]) -> np.ndarray:
        return np.abs(y)


class SensorSaturation(SensorEffect):
    """A sensor that ends: ``min(y, c)``."""

    name = "sensor_saturation"
    order = 8
    parameters = (Parameter("limit", null=np.inf, unit="y"),)
    equation = "min(y, c)"
    signature = "flat tops in this output while the others move on"
    twins = ("state_saturation", "sensor_nonlinearity", "overflow")
    linear = False

    def read(self, y: np.ndarray, v: np.ndarray | None, t: np.ndarray, theta: Sequence[Any]) -> np.ndarray:
        return np.minimum(y, theta[0])

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Limits within the reached range."""
        return levels_inside(probe.x)

    def evident(self, probe: Probe) -> list[tuple[float, ...]]:
        """The level that readings crowd at."""
        level = ceiling(probe.x, probe.noise)
        return [] if level is None else [(level,)]


class SensorQuantization(SensorEffect):
    """A sensor that reads in steps: ``c round(y / c)``."""

    name = "sensor_quantization"
    order = 9
    parameters = (Parameter("step", low=0.0, unit="y"),)
    equation = "c round(y / c)"
    signature = "readings on a grid; a saw tooth that never exceeds half a step"
    twins = ("input_quantization",)
    linear = False

    def read(self, y: np.ndarray, v: np.ndarray | None, t: np.ndarray, theta: Sequence[Any]) -> np.ndarray:
        return quantize(y, theta[0])

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """From one step to 40 steps to the largest reading; of steps that show in the readings, those that they show."""
        shown = HIDDEN * probe.noise, float(np.ptp(probe.x)) / LATTICE_STEPS_SPANNED
        return [
            (step,)
            for (step,) in step_sizes(probe.x, probe.slope)
            if probe.noise == 0 or not shown[0] < step < shown[1]
        ]

    def evident(self, probe: Probe) -> list[tuple[float, ...]]:
        """The step whose multiples the readings crowd at."""
        return [(step,) for step in lattice_steps(probe.x)]

    def soft(
        self,
        y: np.ndarray,
        v: np.ndarray | None,
        t: np.ndarray,
        theta: Sequence[Any],
        width: float,
        readings: np.ndarray | None = None,
    ) -> np.ndarray:
        """The level that was read, plus a share of how far the output lies outside its interval, where readings show the steps.

        The likelihood is that of interval-censored readings: a value just beside a threshold is not an error of a whole step.
        A disturbance moves the moment of a crossing, so that the excess is known less well than a reading is.
        Otherwise a staircase with steep flanks, on which columns that differ by next to nothing stand where the first does: a
        slope is that of many steps, 1, not that of a flank.
        """
        step = np.abs(theta[0])
        some = np.where(step > 0, step, 1.0)
        moved = np.where(np.abs(y - y[:1]) < BESIDE * some, y - y[:1], 0.0)
        first = (y - moved) / some
        whole = np.floor(first)
        stairs = np.where(step > 0, step * (whole + np.clip((first - whole - 0.5) / width + 0.5, 0.0, 1.0)) + moved, y)
        if readings is None:
            return stairs
        seen = np.isfinite(readings)
        ratio = y / some
        level = np.round(np.where(seen, readings, 0.0) / some)
        beyond = ratio - level
        soft = EXCESS * width * (np.logaddexp(0.0, (beyond - 0.5) / width) - np.logaddexp(0.0, (-beyond - 0.5) / width))
        return np.where((step > 0) & seen & shows_steps(readings[seen], some), step * (level + soft), stairs)

    def scan(self, theta: Sequence[float]) -> list[tuple[float, ...]]:
        """Steps up to 4 % off."""
        return neighbouring_steps(theta[0])


def ceiling(readings: np.ndarray, noise: float) -> float | None:
    """The level at the top of a range where readings crowd within their noise, far more than below it; None where they do not."""
    if not len(readings) or noise <= 0 or np.ptp(readings) < CROWD_RANGE * noise:
        return None
    level = float(np.median(readings[readings > np.max(readings) - 6.0 * noise]))
    here = np.sum(np.abs(readings - level) < 3.0 * noise)
    below = np.sum((readings > level - 9.0 * noise) & (readings < level - 3.0 * noise))
    return level if here > max(CROWD * below, LEAST_CROWD * len(readings)) else None
