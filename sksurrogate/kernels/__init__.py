"""Kernels: the equations of the package as pure functions on arrays; nothing here knows an estimator or a simulator."""
