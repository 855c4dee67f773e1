"""Surrogate models, hybrid models and the diagnosis of the sim-to-real gap, scikit-learn compatible.

The names below are imported on first use, so that ``import sksurrogate`` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

#: Public name -> module that holds it.
_HOME = {
    "AugmentedSimulator": "effects",
    "BlockedSplit": "model_selection",
    "CATALOGUE": "effects",
    "CalibratedSimulator": "physics",
    "CallableSimulator": "physics",
    "CasadiSimulator": "physics",
    "ClosedLoopSimulator": "physics",
    "ConformalFreeRun": "model_selection",
    "ControlSimulator": "physics",
    "DerivativeRegressor": "compose",
    "FMUSimulator": "physics",
    "FNNRegressor": "neural",
    "FourierFeatures": "features",
    "FreeRunScorer": "model_selection",
    "GapDiagnoser": "gap",
    "GaussianFeatures": "features",
    "HeavisideFeatures": "features",
    "HybridRegressor": "compose",
    "Interpolator": "features",
    "LagEmbedding": "features",
    "LaggedLinearRegressor": "linear",
    "MuJoCoSimulator": "physics",
    "NonlinearBasisRegressor": "linear",
    "ODESimulator": "physics",
    "OutlierFilter": "features",
    "PCRRegressor": "linear",
    "PenalizedRegressor": "linear",
    "RecurrentRegressor": "neural",
    "Remembered": "model_selection",
    "RecursivePredictor": "compose",
    "SparseRegressor": "linear",
    "SplineFeatures": "features",
    "StateSpaceRegressor": "compose",
    "StepSimulator": "physics",
    "SurrogateSimulator": "physics",
    "TableSimulator": "physics",
    "blind": "",
    "compare_simulators": "gap",
    "compose": "",
    "coverage_report": "compose",
    "cut_runs": "runs",
    "datasets": "",
    "displays": "",
    "effects": "",
    "exceptions": "",
    "export": "",
    "features": "",
    "gap": "",
    "linear": "",
    "load_augmented": "effects",
    "metrics": "",
    "model_selection": "",
    "neural": "",
    "physics": "",
    "runs": "",
    "save_augmented": "effects",
    "scan_orders": "model_selection",
    "simulate_experiments": "datasets",
    "split_runs": "model_selection",
    "stack_runs": "runs",
    "testing": "",
    "unstack_runs": "runs",
}

__all__ = sorted(["__version__", *_HOME])


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'sksurrogate' has no attribute {name!r}")
    home = _HOME[name]
    return import_module(f"sksurrogate.{name}") if not home else getattr(import_module(f"sksurrogate.{home}"), name)


def __dir__() -> list[str]:
    return list(__all__)
