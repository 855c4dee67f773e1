"""Effects that begin, and end, at a time in the run: within a window of time.

The window is a part of the effect: its last parameters are ``onset`` and ``end``, in the unit of time. Within a sample the
window is the share of it that lies inside, so that results depend smoothly on both times.
"""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect, Theta
from sksurrogate.effects._families import (
    BalanceEffect,
    HiddenEffect,
    InputEffect,
    LimitEffect,
    ParameterEffect,
    SensorEffect,
)
from sksurrogate.effects._parts import Parameter, Probe, SensorPath
from sksurrogate.effects._smooth import after
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.record import ages_of
from sksurrogate.kernels.signals import Signal

#: Shares of the longest run at which windows are tried to begin or end.
EDGE_SHARES = tuple(np.arange(1, 16) / 16.0)
#: Those of windows that begin and end: every other one.
WINDOW_SHARES = tuple(itertools.combinations(EDGE_SHARES[::2], 2))
#: What begins is so many times rarer than what is always there, as drifts and jumps are.
TIMES_RARER = 10.0
#: Places to each side to which an edge is moved, once it was fitted.
MOST_MOVED = 40
#: Parameters of a window by name: before ``onset`` and after ``end`` the effect is absent.
WINDOW = {
    "onset": Parameter("onset", low=0.0, unit="time", jumps=True),
    "end": Parameter("end", null=np.inf, low=0.0, unit="time", jumps=True),
}


def window(t: Any, bounds: Sequence[Any], span: Sequence[str], width: float) -> Any:
    """1 within the window, 0 outside, over a half width of time; ``bounds`` are the values of the ``span``.

    >>> window(np.array([0.0, 1.0, 2.0, 3.0]), (1.0, 3.0), ("onset", "end"), 0.0)
    array([0., 1., 1., 0.])
    """
    out: Any = 1.0
    for name, bound in zip(span, bounds):
        share = after(t, bound, width)
        out = out * (share if name == "onset" else 1.0 - share)
    return out


def edges_of(width: Any) -> float:
    """Half width in time of the edges of a window, of a pair (of kinks, of edges); 0 where only that of kinks is given."""
    return float(width[1]) if isinstance(width, tuple) else 0.0


def kinks_of(width: Any) -> Any:
    """Width of the kinks, of such a pair or by itself."""
    return width[0] if isinstance(width, tuple) else width


class Starting(BaseEffect):
    """What effects within a window have in common; made by :func:`starting`."""

    span: ClassVar[tuple[str, ...]] = ()
    always: ClassVar[type[BaseEffect]]
    rows_at: np.ndarray | None = None  #: (n_samples,): times of the rows, where a record knows them

    @property
    def key(self) -> Any:
        """``(name, location, variable, window)``."""
        return (*super().key, "-".join(self.span))

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (self.always, self.span, self.__dict__)

    def own(self, theta: Sequence[Any]) -> Sequence[Any]:
        """Parameters without those of the window."""
        return theta[: -len(self.span)]

    def bounds(self, theta: Sequence[Any]) -> Sequence[Any]:
        """Those of the window."""
        return theta[-len(self.span) :]

    def within(self, t: Any, theta: Sequence[Any], width: float) -> Any:
        """The window at times."""
        return window(t, self.bounds(theta), self.span, width)

    def times(self, starts: np.ndarray, n_samples: int, dt: float) -> np.ndarray:
        """Times of the rows: those that are known (:func:`timed`), else since the first row of every run."""
        return self.rows_at if self.rows_at is not None else ages_of(starts, n_samples) * dt

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Those of the effect, evident ones too, in windows."""
        return self._in_windows([*super().evident(probe), *super().starts(probe)], probe)

    def _in_windows(self, starts: Sequence[tuple[float, ...]], probe: Probe) -> list[tuple[float, ...]]:
        """Starting values in every window that is tried."""
        both = [dict(zip(WINDOW, shares)) for shares in WINDOW_SHARES]
        one = [dict.fromkeys(self.span, share) for share in EDGE_SHARES]
        shares = both if len(self.span) > 1 else one
        places = [[found[name] * probe.duration for name in self.span] for found in shares]
        return [(*theta, *place) for theta in starts for place in places]

    def evident(self, probe: Probe) -> list[tuple[float, ...]]:
        """None: in which window is not evident."""
        return []

    def scan(self, theta: Sequence[float]) -> list[tuple[float, ...]]:
        """Those of the effect, in the same window."""
        return [(*one, *self.bounds(theta)) for one in super().scan(self.own(theta))]

    def moved(self, theta: Sequence[float], dt: float, duration: float) -> list[tuple[float, ...]]:
        """The same with an edge of the window moved by whole samples, up to the distance of the edges that were tried.

        An input that jumps has a valley of its own between any two of its jumps.
        """
        far = max(duration / (len(EDGE_SHARES) + 1) / dt, 1.0)
        steps = dt * np.unique(np.round(np.linspace(1.0, far, min(int(far), MOST_MOVED))))
        edges = np.eye(len(theta))[-len(self.span) :]
        return [tuple(np.add(theta, by * edge)) for edge in edges for by in (*steps, *-steps)]

    def simpler(self, theta: Sequence[float]) -> dict[str, tuple[float, ...]]:
        """None: simpler forms have the window too."""
        return {}

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """The window begins and ends within the runs, and is open for a while."""
        times = dict(zip(self.span, self.bounds(theta)))
        first, last = times.get("onset", 0.0), min(times.get("end", np.inf), probe.duration)
        inside = all(probe.dt <= bound <= probe.duration - probe.dt for bound in times.values())
        return inside and last - first >= 2 * probe.dt and super().plausible(self.own(theta), probe)

    def identifiable(self, theta: Sequence[float]) -> tuple[float, ...]:
        """Those of the effect, in the same window."""
        return (*super().identifiable(self.own(theta)), *self.bounds(theta))

    def lower_bounds(self, duration: float) -> tuple[float, ...]:
        """Those of the effect, and 0."""
        return (*super().lower_bounds(duration)[: len(self.parameters) - len(self.span)], *(0.0 for _ in self.span))

    def canonical(self, theta: Sequence[float]) -> tuple[float, ...]:
        """That of the effect, in the same window."""
        return (*super().canonical(self.own(theta)), *self.bounds(theta))


class _StartingLaw(Starting, BalanceEffect):
    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: Any) -> Any:
        """The term within the window; ``width`` is that of its kinks, or a pair of that and of the window's edges."""
        return self.within(t, theta, edges_of(width)) * super().term(t, x, v, self.own(theta), kinks_of(width))  # type: ignore[safe-super]

    def jump(self, theta: Sequence[Any], load: Any = 0.0) -> Any:
        """That of the effect."""
        return super().jump(self.own(theta) if len(theta) == len(self.parameters) else theta, load)

    def smoothed(self, theta: Sequence[Any], width: float, h: float) -> Any:
        """That of the effect."""
        return super().smoothed(self.own(theta), width, h)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Those of the effect as it is always there, in windows."""
        return self._in_windows(self.always(**self.get_params(deep=False)).starts(probe), probe)


class _StartingHidden(_StartingLaw, HiddenEffect):
    def rest(self, v: np.ndarray, theta: Sequence[Any]) -> Sequence[Any]:
        """That of the effect."""
        return super().rest(v, self.own(theta))

    def rates(self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: Any) -> Any:
        """Those of the effect: its memory runs from the start, what it does begins with the window."""
        own = self.own(theta) if len(theta) == len(self.parameters) else theta
        return super().rates(z, t, v, dv, own, kinks_of(width))  # type: ignore[safe-super]

    def rates_within(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: Any, h: float
    ) -> Any:
        """Likewise."""
        return super().rates_within(z, t, v, dv, self.own(theta), kinks_of(width), h)

    def force(self, z: np.ndarray, v: np.ndarray, theta: Sequence[Any]) -> Any:
        """That of the effect; the window is applied where the time is known."""
        return super().force(z, v, self.own(theta))  # type: ignore[safe-super]

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: Any) -> Any:
        """None: the force is what acts."""
        return np.zeros_like(x)


class _StartingInput(Starting, InputEffect):
    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        """The input that acts: that of the effect for the share of every substep within the window, else as it is."""
        changed = super().transform(u, v, self.own(theta), h, starts)  # type: ignore[safe-super]
        n_sub, _, n_samples = u.mean.shape
        t = self.times(starts, n_samples, n_sub * h)
        middle = t + (np.arange(n_sub)[:, None, None] + 0.5) * h
        share = np.clip(window_share(middle, self.bounds(theta), self.span, h), 0.0, 1.0)
        at = np.clip(window_share(t[None, :] + 0.5 * h, self.bounds(theta), self.span, h), 0.0, 1.0)
        mean = u.mean + share * (changed.mean - u.mean)
        if u.half is None and changed.half is None:
            half = None
        else:
            before, later = (0.0 if s.half is None else s.half for s in (u, changed))
            half = before + share * (later - before)
        shown = u.at_samples() + at * (changed.at_samples() - u.at_samples())
        return replace(changed, mean=mean, half=half, shown=shown)


class _StartingSensor(Starting, SensorEffect):
    def _blend(self, y: np.ndarray, changed: np.ndarray, t: np.ndarray, theta: Sequence[Any], width: float) -> Any:
        return y + self.within(t, theta, width) * (changed - y)

    def read(self, y: np.ndarray, v: np.ndarray | None, t: np.ndarray, theta: Sequence[Any]) -> np.ndarray:
        """The reading within the window, the output outside."""
        return np.asarray(self._blend(y, super().read(y, v, t, self.own(theta)), t, theta, 0.0))

    def soft(
        self,
        y: np.ndarray,
        v: np.ndarray | None,
        t: np.ndarray,
        theta: Sequence[Any],
        width: float,
        readings: np.ndarray | None = None,
    ) -> np.ndarray:
        """The same in a fit: the edges of the window are spread over a sample."""
        if readings is not None:
            readings = np.where(
                self.within(t, theta, 0.0) > 0.5, readings, np.nan
            )  # what is read outside shows nothing of it
        plain = self.always(**self.get_params(deep=False)).soft(y, v, t, self.own(theta), width, readings)  # type: ignore[attr-defined]
        step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
        return np.asarray(self._blend(y, plain, t, theta, step))

    def follow(self, path: SensorPath, theta: Theta, dt: float, starts: np.ndarray) -> SensorPath:
        """A sensor with a memory, within the window, whose edges are spread over a sample."""
        return self._followed(path, theta, dt, starts, dt)

    def follow_sharp(self, path: SensorPath, theta: Theta, dt: float, starts: np.ndarray) -> SensorPath:
        """The same with sharp edges."""
        return self._followed(path, theta, dt, starts, 0.0)

    def _followed(self, path: SensorPath, theta: Theta, dt: float, starts: np.ndarray, width: float) -> SensorPath:
        changed = super().follow(path, self.own(theta), dt, starts)
        t = self.times(starts, path.y.shape[-1], dt)

        def blended(one: np.ndarray, other: np.ndarray) -> np.ndarray:
            return np.asarray(self._blend(one, other, t, theta, width))

        end = None if path.end is None and changed.end is None else blended(path.before, changed.before)
        return SensorPath(
            blended(path.y, changed.y), blended(path.right, changed.right), blended(path.left, changed.left), end
        )


class _StartingLimit(Starting, LimitEffect):
    def clip(
        self, x: np.ndarray, v: np.ndarray | None, theta: Sequence[Any], final: bool
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """That of the effect; the window is applied where the time is known."""
        return super().clip(x, v, self.own(theta), final)  # type: ignore[safe-super]

    def flow(
        self, x: np.ndarray, dx: np.ndarray, dv: np.ndarray, theta: Sequence[Any]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Likewise."""
        return super().flow(x, dx, dv, self.own(theta))


class _StartingParameter(Starting, ParameterEffect):
    access = "step"

    def value(self, p: Any, t: Any, theta: Sequence[Any], width: float, *driver: Any) -> Any:
        """That of the effect within the window, the parameter itself outside."""
        changed = super().value(p, t, self.own(theta), width, *driver)  # type: ignore[safe-super]
        return p + self.within(t, theta, width) * (changed - p)


def window_share(middle: np.ndarray, bounds: Sequence[Any], span: Sequence[str], h: float) -> Any:
    """Share of intervals of length ``h`` about times that lies within the window."""
    out: Any = 1.0
    for name, bound in zip(span, bounds):
        share = np.clip((middle - bound) / h + 0.5, 0.0, 1.0)
        out = out * (share if name == "onset" else 1.0 - share)
    return out


_FAMILIES: tuple[tuple[type[BaseEffect], type[Starting]], ...] = (
    (HiddenEffect, _StartingHidden),
    (BalanceEffect, _StartingLaw),
    (InputEffect, _StartingInput),
    (SensorEffect, _StartingSensor),
    (LimitEffect, _StartingLimit),
    (ParameterEffect, _StartingParameter),
)

#: Classes that were made, so that two instances of one kind are of one class.
_KINDS: dict[tuple[type[BaseEffect], tuple[str, ...]], type[BaseEffect]] = {}


def can_start(effect: BaseEffect) -> bool:
    """Whether an effect can have a window: one that has parameters and no times of its own, and is no state that a sensor shows."""
    if isinstance(effect, HiddenEffect) and effect.kind == "output":
        return False
    timed = any(p.name in ("time", "phase", *WINDOW) for p in effect.parameters)
    if isinstance(effect, ParameterEffect):  # a parameter that drifts does so from the start
        timed = timed or any(p.name == "rate" for p in effect.parameters)
    return bool(effect.parameters) and not timed and isinstance(effect, tuple(family for family, _ in _FAMILIES))


def starting(effect: BaseEffect, span: Sequence[str] = ("onset",)) -> BaseEffect:
    """The effect within a window of time.

    Parameters
    ----------
    effect : BaseEffect
        Any that has parameters and no time of its own.
    span : sequence of {"onset", "end"}, default=("onset",)
        What the window has: a beginning, an end, or both.

    Returns
    -------
    BaseEffect
        Of the same name; ``onset`` and ``end`` are its last parameters.

    Raises
    ------
    DataError

    Examples
    --------
    >>> from sksurrogate.effects import CATALOGUE
    >>> late = starting(CATALOGUE["coulomb_friction"]("v", "v"))
    >>> late.name, [parameter.name for parameter in late.parameters]
    ('coulomb_friction', ['level', 'onset'])
    """
    wanted = tuple(span or ())
    if wanted not in (("onset",), ("end",), ("onset", "end")):
        raise DataError(f"span={span!r}: expected ('onset',), ('end',) or ('onset', 'end').")
    if not can_start(effect):
        raise DataError(
            f"{effect!r} has no onset: expected an effect with parameters and no time of its own, as step_disturbance has."
        )
    return _rebuilt(type(effect), wanted, copy.copy(effect.__dict__))


def timed(effect: BaseEffect, t: np.ndarray) -> Any:
    """The effect with the times of the rows, (n_samples,), where it has a window: pieces of a run do not begin at its start.

    >>> from sksurrogate.effects import CATALOGUE
    >>> late = starting(CATALOGUE["input_gain"]("valve"))
    >>> timed(late, np.array([5.0, 6.0])).times(np.array([0]), 2, 1.0)
    array([5., 6.])
    """
    if not isinstance(effect, Starting):
        return effect
    out = copy.copy(effect)
    out.rows_at = t
    return out


def _rebuilt(always: type[BaseEffect], span: tuple[str, ...], state: dict[str, Any]) -> BaseEffect:
    """An instance of the class within a window."""
    key = (always, span)
    if key not in _KINDS:
        _KINDS[key] = _kind(always, span)
    kind = _KINDS[key]
    out: BaseEffect = kind.__new__(kind)
    out.__dict__.update(state)
    return out


def _kind(always: type[BaseEffect], span: tuple[str, ...]) -> type[BaseEffect]:
    """The class of effects within a window."""
    family: Callable[..., Any] = next(other for one, other in _FAMILIES if issubclass(always, one))
    own = {
        "parameters": (*always.parameters, *(WINDOW[name] for name in span)),
        "rarity": TIMES_RARER * always.rarity,
        "span": span,
        "always": always,
        "__doc__": always.__doc__,
    }
    return type(always.__name__, (family, always), own)  # type: ignore[arg-type]
