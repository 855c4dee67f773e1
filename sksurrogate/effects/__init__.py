"""Effects: small parametric changes to a simulator whose null value gives the simulator back."""

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import CATALOGUE, build_effects
from sksurrogate.effects._families import (
    BalanceEffect,
    HiddenEffect,
    InputEffect,
    LimitEffect,
    ParameterEffect,
    SensorEffect,
)
from sksurrogate.effects._law import (
    InputLawEffect,
    LawEffect,
    MemoryLawEffect,
    ParameterLawEffect,
    SensorLawEffect,
)
from sksurrogate.effects._onset import starting
from sksurrogate.effects._parts import Parameter, Probe, SensorPath
from sksurrogate.effects._simulator import AugmentedSimulator
from sksurrogate.effects._store import load_augmented, save_augmented

__all__ = [
    "CATALOGUE",
    "AugmentedSimulator",
    "BalanceEffect",
    "BaseEffect",
    "HiddenEffect",
    "InputEffect",
    "InputLawEffect",
    "LawEffect",
    "LimitEffect",
    "MemoryLawEffect",
    "Parameter",
    "ParameterEffect",
    "ParameterLawEffect",
    "Probe",
    "SensorEffect",
    "SensorLawEffect",
    "SensorPath",
    "build_effects",
    "load_augmented",
    "save_augmented",
    "starting",
]
