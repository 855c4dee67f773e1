"""Actuators and slow sensors over one sample: what they remember, and what they pass on.

The formulae are those of a whole record (:mod:`sksurrogate.kernels.signals`, :mod:`sksurrogate.effects._sensor`), written for
one sample, so that they hold for numbers, arrays of points and the symbols of a graph alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import InputEffect, SensorEffect
from sksurrogate.effects._followers import Follower, InputLag, RateLimit
from sksurrogate.effects._input import InputBacklash, InputDelay, RememberingActuator
from sksurrogate.effects._onset import Starting, window_share
from sksurrogate.effects._sensor import SensorDelay, SensorLag, lag_moments
from sksurrogate.exceptions import SimulatorError
from sksurrogate.kernels.signals import Signal, delay_in_substeps, delayed_piece, lag_piece, ramp_piece

#: Size of a signal that a memory is sought with: an actuator of one's own may have edges of any size.
PROBED = (0.01, 1.0, 100.0)


@dataclass(frozen=True, eq=False)
class Pieces:
    """One input over one sample."""

    #: mean, half: tuple (n_sub,): mean and half rise in every substep; ``half`` is None where the input is held
    mean: tuple[Any, ...]
    half: tuple[Any, ...] | None
    shown: Any  #: Value at the start of the sample

    @classmethod
    def held(cls, u: Any, n_sub: int) -> Pieces:
        """An input that is held."""
        return cls((u,) * n_sub, None, u)

    def rises(self) -> tuple[Any, ...]:
        """Half rises, 0 where the input is held."""
        return (0.0,) * len(self.mean) if self.half is None else self.half

    @property
    def end(self) -> Any:
        """Value at the end of the sample."""
        return self.mean[-1] + self.rises()[-1]


def unwindowed(effect: BaseEffect) -> BaseEffect:
    """The effect as it is without an onset or an end."""
    return effect.always(**effect.get_params(deep=False)) if isinstance(effect, Starting) else effect


def own_values(effect: BaseEffect, theta: Sequence[float]) -> Sequence[float]:
    """Parameters without onset and end."""
    return effect.own(theta) if isinstance(effect, Starting) else theta


class InputInSample:
    """An effect on an input, sample by sample.

    ``h``: width of a substep.
    ``ramps``: whether what arrives may move within a sample.
    Raises SimulatorError where an effect of one's own has a memory that is not known here.
    """

    def __init__(self, effect: InputEffect, theta: Sequence[float], h: float, n_sub: int, ramps: bool):
        self.effect, self.theta, self.h, self.n_sub = effect, tuple(theta), h, n_sub
        self.always = unwindowed(effect)
        self.own = own_values(effect, theta)
        self.faster = self.always.times_faster if isinstance(self.always, Follower) else 1.0
        kind = type(self.always)
        self.advance_memory = {
            InputLag: self._lag, RateLimit: self._ramp, InputBacklash: self._play, InputDelay: self._delay,
        }.get(kind, self._static)  # fmt: skip
        self.size, self.ramps = 1, ramps or kind in (InputLag, RateLimit, InputDelay)
        if kind is InputDelay:
            whole, self.phi = delay_in_substeps(self.own[0], h, 10**9)
            self.late, self.past = whole, -(-(whole + 1) // n_sub)
            self.wide = ramps
            self.size = self.past * (2 * n_sub if ramps else 1)
        elif self.advance_memory == self._static:
            self.size = 0
            if kind.__module__ != InputDelay.__module__ and _remembers(self.always, self.own, h):
                raise SimulatorError(
                    f"{effect.name}: an actuator of your own with a memory has no state-space form here; use simulate."
                )

    def begin(self, first: Any, other: Any) -> tuple[list[Any], Any]:
        """Memory at the start of a run, and what acts then, given what arrives and the variable."""
        if self.advance_memory == self._static:
            return [], self.advance([], Pieces.held(first, self.n_sub), Pieces.held(other, self.n_sub), 0.0)[1].shown
        assert isinstance(self.always, RememberingActuator)
        first = first if self.always.before is None else self.always.before
        if isinstance(self.always, InputDelay) and self.wide:
            return [first if k % 2 == 0 else 0.0 * first for k in range(self.size)], first
        return [first] * self.size, first

    def advance(self, memory: Sequence[Any], given: Pieces, other: Pieces | None, t: Any) -> tuple[list[Any], Pieces]:
        """The memory a sample later, and the input that acts in this sample."""
        later, changed = self.advance_memory(memory, given, other)
        if not isinstance(self.effect, Starting):
            return later, changed
        bounds, span, h = self.effect.bounds(self.theta), self.effect.span, self.h
        shares = [window_share(t + (s + 0.5) * h, bounds, span, h) for s in range(self.n_sub)]
        mean = tuple(a + f * (b - a) for f, a, b in zip(shares, given.mean, changed.mean))
        half = tuple(a + f * (b - a) for f, a, b in zip(shares, given.rises(), changed.rises()))
        shown = given.shown + shares[0] * (changed.shown - given.shown)
        return later, Pieces(mean, None if given.half is changed.half is None else half, shown)

    def _static(self, memory: Any, given: Pieces, other: Pieces | None) -> tuple[list[Any], Pieces]:
        """A characteristic: the effect's own transform of single values."""

        def signal(pieces: Pieces | None, s: int) -> Signal | None:
            if pieces is None:
                return None
            return Signal(pieces.mean[s], None if pieces.half is None else pieces.half[s], pieces.shown)

        def changed(s: int) -> Signal:
            return self.always.transform(signal(given, s), signal(other, s), self.own, self.h, np.array([0]))  # type: ignore[attr-defined]

        if given.half is None:
            return [], Pieces.held(changed(0).mean, len(given.mean))
        found = [changed(s) for s in range(len(given.mean))]
        return [], Pieces(tuple(f.mean for f in found), tuple(f.half for f in found), found[0].shown)

    def _lag(self, memory: Sequence[Any], given: Pieces, other: Any) -> tuple[list[Any], Pieces]:
        """``c dw/dt + w = u``."""
        w, k = memory[0], max(self.own[0] / self.h, 1e-15)
        mean, half = [], []
        for m, r in zip(given.mean, given.rises()):
            piece = lag_piece(m, r, w, k)
            if self.faster != 1.0:
                falls = lag_piece(m, r, w, max(k / self.faster, 1e-15))
                piece = tuple(np.where(m + r > w, up, down) for up, down in zip(piece, falls))
            w, a, b = piece
            mean.append(a)
            half.append(b)
        return [w], Pieces(tuple(mean), tuple(half), memory[0])

    def _ramp(self, memory: Sequence[Any], given: Pieces, other: Any) -> tuple[list[Any], Pieces]:
        """``abs(dw/dt) <= c`` towards a held input."""
        w, up = memory[0], max(self.own[0], 0.0) * self.h
        down, found = up * self.faster, []
        for target in given.mean:
            found.append(ramp_piece(w, target, up if self.faster == 1.0 else np.where(target > w, up, down)))
            w = w + np.minimum(np.maximum(target - w, -down), up)
        return [w], Pieces(tuple(f[0] for f in found), tuple(f[1] for f in found), memory[0])

    def _play(self, memory: Sequence[Any], given: Pieces, other: Any) -> tuple[list[Any], Pieces]:
        """``w = clip(w before, u - c, u + c)``."""
        width = max(self.own[0], 0.0)
        w = np.minimum(np.maximum(memory[0], given.shown - width), given.shown + width)
        return [w], Pieces.held(w, self.n_sub)

    def _delay(self, memory: Sequence[Any], given: Pieces, other: Any) -> tuple[list[Any], Pieces]:
        """``u(t - c)``: the memory holds past samples, oldest first."""
        now = [v for pair in zip(given.mean, given.rises()) for v in pair] if self.wide else [given.shown]
        line = [*memory, *now]
        if self.wide:
            stretches = [(line[2 * k], line[2 * k + 1]) for k in range(len(line) // 2)]
        else:
            stretches = [(v, 0.0) for v in line for _ in range(self.n_sub)]
        first = self.past * self.n_sub - self.late
        found = [delayed_piece(stretches[first + s - 1], stretches[first + s], self.phi) for s in range(self.n_sub)]
        return line[len(now) :], Pieces(tuple(f[0] for f in found), tuple(f[1] for f in found), found[0][2])


def _remembers(effect: BaseEffect, theta: Sequence[float], h: float) -> bool:
    """Whether what an actuator makes of a value depends on the values before it."""
    values, starts = np.array([0.3, -0.7, 1.1, 0.45, -0.2]), np.array([0])
    parameters = [np.full((1, 1), value) for value in theta]
    for size in PROBED:
        u = (size * values)[None, None]
        whole, alone = (
            effect.transform(Signal(part), Signal(0.5 * part), parameters, h, starts).mean  # type: ignore[attr-defined]
            for part in (u, u[..., -1:])
        )
        if not np.allclose(whole[..., -1], alone[..., -1], rtol=1e-12, atol=0):
            return True
    return False


class SensorInSample:
    """A sensor with a memory, sample by sample.

    Raises SimulatorError where the sensor has no such form.
    """

    def __init__(self, effect: SensorEffect, theta: Sequence[float], dt: float):
        self.effect, self.theta, self.dt = effect, theta, dt
        kind, theta = type(unwindowed(effect)), own_values(effect, theta)
        if kind not in (SensorLag, SensorDelay):
            raise SimulatorError(
                f"{effect.name}: a sensor of your own with a memory has no state-space form here; use simulate."
            )
        self.size, self.is_lag = 1, kind is SensorLag
        if self.is_lag:
            self.ratio = max(theta[0], 0.0) / dt
            moments, decay, rate = lag_moments(np.array([[self.ratio]]))
            self.moments, self.decay, self.rate = moments.ravel().tolist(), decay.item(), rate.item()
            return
        if theta[0] < 0:
            raise SimulatorError(
                f"{effect.name}: a delay of {theta[0]:g} shows what is to come; no state-space form does. Take it as 0."
            )
        self.whole = int(np.floor(theta[0] / dt))
        self.s = 1.0 - (theta[0] / dt - self.whole)  # place within a piece, in (0, 1]
        self.exact = self.s == 1.0
        self.size = self.whole + (not self.exact)

    def reading(self, memory: Sequence[Any], y: Any, t: Any) -> Any:
        """What the sensor shows now; ``y`` is what it would show without a memory."""
        if not self.size:
            return y
        if not isinstance(self.effect, Starting):
            return memory[-1]
        return y + self.effect.within(t, self.theta, 0.0) * (memory[-1] - y)

    def advance(self, memory: Sequence[Any], piece: tuple[Any, ...], t: Any) -> tuple[list[Any], tuple[Any, ...]]:
        """The memory a sample later, and the piece of what is passed on.

        A piece holds the value and dt times the slope at the start, the value just before the end, dt times the slope there.
        """
        later, passed = self._advance(memory, piece)
        if not isinstance(self.effect, Starting):
            return later, passed
        now, then = (self.effect.within(at, self.theta, 0.0) for at in (t, t + self.dt))
        return later, tuple(a + share * (b - a) for a, b, share in zip(piece, passed, (now, now, then, then)))

    def _advance(self, memory: Sequence[Any], piece: tuple[Any, ...]) -> tuple[list[Any], tuple[Any, ...]]:
        """Of a sensor that is always slow."""
        y0, m0, y1, m1 = piece
        if not self.is_lag:
            s, q = self.s, 1.0 - self.s
            value = y0 if self.exact else (1 + 2 * s) * q * q * y0 + s * s * (3 - 2 * s) * y1 + s * q * q * m0 - s * s * q * m1  # fmt: skip
            return [value, *memory][: self.size], piece
        rise = y1 - y0
        a = (y0, m0, 3 * rise - 2 * m0 - m1, m0 + m1 - 2 * rise)
        before, (j0, j1, j2, _) = memory[0], self.moments
        later = self.decay * before + sum(moment * part for moment, part in zip(self.moments, a))
        end = a[1] * j0 + 2 * a[2] * j1 + 3 * a[3] * j2 + (a[0] - before) * self.rate
        mean = a[0] + a[1] / 2 + a[2] / 3 + a[3] / 4 - self.ratio * (later - before)
        return [later], (before, end + 12 * (mean - (before + later) / 2), later, end)
