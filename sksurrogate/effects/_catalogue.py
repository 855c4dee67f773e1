"""The catalogue: every effect by its canonical name, and its instances over the places and signals of a plant."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Sequence
from numbers import Real
from typing import Any

import numpy as np

from sksurrogate._close_names import did_you_mean
from sksurrogate.effects import _backlash as backlash
from sksurrogate.effects import _balance as balance
from sksurrogate.effects import _disturbance as disturbance
from sksurrogate.effects import _exchange as exchange
from sksurrogate.effects import _followers as followers
from sksurrogate.effects import _hidden as hidden
from sksurrogate.effects import _input as actuator
from sksurrogate.effects import _limit as limit
from sksurrogate.effects import _load_friction as load_friction
from sksurrogate.effects import _parameter as parameter
from sksurrogate.effects import _sensor as sensor
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import BalanceEffect
from sksurrogate.effects._levelling import Levelling
from sksurrogate.effects._ports import Places, places_of
from sksurrogate.effects._structure import motions
from sksurrogate.exceptions import DataError
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant

_ORDER: tuple[type[BaseEffect], ...] = (
    parameter.ParameterError,
    parameter.ParameterDrift,
    parameter.ParameterStep,
    parameter.ParameterDependence,
    backlash.Backlash,
    balance.ConstantBias,
    balance.LinearLoss,
    balance.QuadraticLoss,
    balance.QuadraticDrag,
    balance.CoulombFriction,
    balance.AsymmetricFriction,
    balance.StribeckFriction,
    load_friction.LoadFriction,
    balance.CubicStiffness,
    balance.SqrtLeak,
    balance.PowerLaw,
    exchange.Exchange,
    exchange.Radiation,
    balance.Bilinear,
    balance.GravityTilt,
    balance.EndStop,
    limit.StateSaturation,
    limit.Overflow,
    disturbance.Drift,
    disturbance.PeriodicDisturbance,
    disturbance.StepDisturbance,
    hidden.Hysteresis,
    hidden.LugreFriction,
    hidden.HiddenRelaxation,
    hidden.HiddenMode,
    actuator.InputGain,
    actuator.InputBias,
    actuator.InputCurve,
    actuator.InputCoupling,
    actuator.InputDeadZone,
    actuator.InputBacklash,
    actuator.InputSaturation,
    followers.RateLimit,
    actuator.InputQuantization,
    actuator.InputDelay,
    followers.InputLag,
    sensor.SensorLag,
    sensor.SensorDelay,
    sensor.SensorCoupling,
    sensor.SensorNonlinearity,
    sensor.SensorGain,
    sensor.SensorBias,
    sensor.SensorDrift,
    sensor.SensorRectification,
    sensor.SensorSaturation,
    sensor.SensorQuantization,
)

#: Canonical name -> class, in the order of the table in the documentation.
CATALOGUE: dict[str, type[BaseEffect]] = {effect.name: effect for effect in _ORDER}


def build_effects(
    plant: Plant, balances: Sequence[str], effects: Iterable[Any] | str | type[BaseEffect] | BaseEffect | None = None
) -> list[BaseEffect]:
    """Instances of effects over the places and variables of a plant.

    Parameters
    ----------
    plant : Plant
    balances : sequence of str
        States whose balance may hold an effect; leave out the :func:`kinematic_states`. Laws at ports that are no laws of
        one balance come beside those.
    effects : None, or one or several of str, class, instance
        None: the whole catalogue without forms that no plant has, such as friction that a position drives or the sine of a
        speed (``implausible`` of a law). A name or class is enumerated over the plant; an instance with a location is taken
        as it is, one without is enumerated like its class.

    Returns
    -------
    list of BaseEffect
        Those that the plant's access allows, in the order given, none twice.

    Raises
    ------
    DataError
        A name is not in the catalogue, a class is not an effect, or an instance names a signal that the plant lacks.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.effects import build_effects
    >>> from sksurrogate.physics._simulator import describe
    >>> [effect.key for effect in build_effects(describe(make_reactor()), ["y"], ["sensor_bias", "input_lag"])]
    [('sensor_bias', 'y', None), ('input_lag', 'u', None)]
    """
    found: dict[tuple[Any, ...], BaseEffect] = {}
    wanted = _wanted(effects)
    places = places_of(plant, balances) if any(map(_enumerates_laws, wanted)) else Places(tuple(balances))
    for item in wanted:
        for effect in _instances(item, plant, places):
            if effect.access == "trajectory" or plant.access in ("rhs", "step"):
                found.setdefault((type(effect), *effect.key, *_extras(effect)), effect)
    return list(found.values()) if effects is not None else _plausible(list(found.values()), plant)


def _plausible(effects: list[BaseEffect], plant: Plant) -> list[BaseEffect]:
    """Without laws whose variable is what must not drive them."""
    if not any(getattr(effect, "implausible", ()) for effect in effects):
        return effects
    kind_of = motions(PlantModel(plant))
    return [
        effect
        for effect in effects
        if not (isinstance(effect, BalanceEffect) and kind_of.get(str(effect.variable)) in effect.implausible)
    ]


def left_out(effects: Any, tested: Iterable[BaseEffect]) -> list[str]:
    """Names of what was asked for as ``effects`` of :func:`build_effects` and is not among what is tested, in that order."""
    kinds = {type(effect) for effect in tested}
    names = []
    for item in _wanted(effects):
        asked = CATALOGUE[item] if isinstance(item, str) else item
        kind = asked if inspect.isclass(asked) else type(asked)
        if kind not in kinds:
            names.append(asked.name if isinstance(asked.name, str) else kind.__name__)
    return list(dict.fromkeys(names))


def name_of(effect: BaseEffect) -> str:
    """Effect, place and driving signal in words.

    >>> name_of(CATALOGUE["coulomb_friction"]("speed", "speed")), name_of(CATALOGUE["linear_loss"]("speed", "level"))
    ('coulomb friction at speed', 'linear loss at speed, driven by level')
    """
    window = f" with an {effect.key[3]}" if len(effect.key) > 3 else ""
    return in_words(effect.name, effect.location, effect.variable) + window


def in_words(name: str, place: str | None, driver: str | None) -> str:
    """The same of a name by itself."""
    driven = f", driven by {driver}" if driver and driver != place else ""
    return f"{name.replace('_', ' ')} at {place}{driven}"


def _wanted(effects: Any) -> list[Any]:
    """The entries of ``effects=``."""
    if effects is None:
        return list(CATALOGUE.values())
    if isinstance(effects, str | BaseEffect) or inspect.isclass(effects) or not isinstance(effects, Iterable):
        return [effects]
    return list(effects)


def _extras(effect: BaseEffect) -> tuple[Any, ...]:
    """Further constructor arguments of a user's own effect, which may tell two instances at one place apart."""
    own = effect.get_params(deep=False)
    return tuple(sorted((name, repr(value)) for name, value in own.items() if name not in ("location", "variable")))


def _enumerates_laws(item: Any) -> bool:
    """Whether an entry of ``effects=`` is a law that is tried at all its places."""
    kind: Any = CATALOGUE.get(item) if isinstance(item, str) else item
    if isinstance(kind, BaseEffect):
        return isinstance(kind, BalanceEffect) and kind.location is None
    return inspect.isclass(kind) and issubclass(kind, BalanceEffect)


def _instances(item: Any, plant: Plant, places: Places) -> Iterable[BaseEffect]:
    """One entry of ``effects=`` as instances."""
    if isinstance(item, str):
        if item not in CATALOGUE:
            hint = did_you_mean(item, CATALOGUE, 0.4) or f" known are {list(CATALOGUE)}."
            raise DataError(
                f"effects: {item!r} is not in the catalogue;{hint} "
                "An effect of your own goes in as a class or an instance."
            )
        return places.instances(CATALOGUE[item], plant)
    if inspect.isclass(item) and issubclass(item, BaseEffect):
        return places.instances(item, plant)
    if isinstance(item, BaseEffect):
        if item.location is None:
            return places.instances(type(item), plant)
        if plant.access == "trajectory" and item.access != "trajectory":
            return []  # it has no place to be checked: such a plant shows no states
        check_place(item, plant)
        return [item]
    raise DataError(
        f"effects: {item!r} is neither a name of the catalogue, nor a subclass of BaseEffect, nor an instance of one; "
        "write for example effects=['coulomb_friction', MyEffect]."
    )


#: Numbers that effects take beside their places, and the effects that do.
OWN_NUMBERS = {
    "before": actuator.RememberingActuator, "corner": actuator.LimitedActuator, "earliest": sensor.SensorDelay,
    "curvature": parameter.ParameterDependence, "levelling": Levelling, "lower": actuator.InputQuantization,
    "falling": followers.Follower,
}  # fmt: skip


def check_place(effect: BaseEffect, plant: Plant) -> None:
    """Say which name an effect uses that the plant does not have, or which of its numbers is none.

    Raises DataError.
    """
    for name, kind in OWN_NUMBERS.items():
        value = getattr(effect, name, None) if isinstance(effect, kind) else None
        if value is not None and (
            isinstance(value, bool) or not isinstance(value, Real) or not np.isfinite(float(value))
        ):
            raise DataError(f"{effect!r}: {name}={value!r}: expected a finite number; leave it out for the default.")
    named = {"parameter": tuple(plant.params), "state": plant.states, "input": plant.inputs, "output": plant.outputs}
    places = named[effect.kind]
    ports = plant.ports if isinstance(effect, BalanceEffect) else ()
    if effect.location not in (*places, *ports):
        beside = f", and no port: {list(ports)}" if ports else ""
        a = "an" if effect.kind in ("input", "output") else "a"
        raise DataError(
            f"{effect!r}: location={effect.location!r} is not {a} {effect.kind} of the simulator: {list(places)}{beside}."
        )
    if effect.variable is None:
        return
    beside_inputs = {"input": (), "output": plant.outputs}.get(effect.kind, plant.states)
    signals = beside_inputs + plant.inputs
    for name in effect.signals:
        if name not in signals:
            raise DataError(
                f"{effect!r}: variable={effect.variable!r} is made of signals of the simulator: {list(signals)}."
            )
