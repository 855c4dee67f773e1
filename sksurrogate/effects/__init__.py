"""Effects: small parametric changes to a simulator whose null value gives the simulator back."""

from sksurrogate.effects._catalogue import CATALOGUE, build_effects
from sksurrogate.effects._effect import (
    BalanceEffect,
    BaseEffect,
    HiddenEffect,
    InputEffect,
    LimitEffect,
    Parameter,
    ParameterEffect,
    Probe,
    SensorEffect,
    SensorPath,
)
from sksurrogate.effects._law import (
    InputLawEffect,
    LawEffect,
    MemoryLawEffect,
    ParameterLawEffect,
    SensorLawEffect,
)
from sksurrogate.effects._onset import starting
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
