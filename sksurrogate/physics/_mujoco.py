"""Robots and mechanisms of MuJoCo as simulators."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.utils.metaestimators import available_if

from sksurrogate._columns import by_name
from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._free_run import raise_if_diverged
from sksurrogate.physics._mujoco_effects import as_parameters
from sksurrogate.physics._mujoco_march import held_inputs, run_by_rollout, run_in_steps
from sksurrogate.physics._mujoco_patch import patched
from sksurrogate.physics._mujoco_points import Points
from sksurrogate.physics._mujoco_read import NamedModel, whole_steps

#: The way out of a run that diverged.
AFTER_DIVERGING = (
    'Check x0 and the units of the inputs; a stiff model may want a smaller timestep or integrator="implicitfast" '
    "(<option .../> in the MJCF)."
)


def _is_markov(self: MuJoCoSimulator) -> bool:
    return self._engine().markov


def _has_equations(self: MuJoCoSimulator) -> bool:
    return self._engine().has_equations


def _has_sensors(self: MuJoCoSimulator) -> bool:
    return self._engine().markov and not set(self.outputs) <= set(self.states)


class MuJoCoSimulator(NamedModel):
    """A MuJoCo model: robots, hands, mechanisms, with contacts.

    Parameters
    ----------
    model : path, str or ``mujoco.MjModel``
        File of MJCF or URDF, XML text (it starts with ``<``), or a compiled model. The model given is never written; what
        is changed in it after the first use is not seen: make a new simulator then.
    inputs : list of str, optional
        Actuators by name; all of them by default. A port (a joint, see Attributes) may stand here too: a force in it is
        then an input, which is the way to drive a URDF, since a URDF has no actuators.
    outputs : list of str, optional
        States or sensors by name; by default the sensors, or the states where the model has no sensor. Components of a
        sensor of three numbers are ``<sensor>.x``, ``.y``, ``.z``, of a quaternion ``.w``, ``.x``, ``.y``, ``.z``.
    params : dict of float, or list of str, optional
        Parameters and their values, or names whose values are the model's. By default all: ``<joint>.damping``,
        ``.frictionloss``, ``.armature``, ``.stiffness``; ``<body>.mass`` (the inertia goes with it), ``.load`` (a point mass
        at the tip of a body that carries no other); ``<actuator>.gear``, and ``.kp``, ``.kv`` of servos; ``<geom>.friction``,
        ``.torsional_friction``, ``.rolling_friction`` of geoms that collide.
    dt : float, optional
        Sample time, a multiple of the model's timestep; by default the timestep.
    x0 : array-like (n_states,), optional
        Initial state; by default the model's (``qpos0`` at rest). :meth:`keyframe` gives those that the model stores.
    n_threads : int, optional
        Threads over which runs and points are spread; 1 by default, -1: one for each core.
    units : dict of str, optional
        Units of states, inputs, outputs, parameters and "time" by name, for reports and labels: ``{"speed": "rad/s"}``.
        Joints and time are in SI units by default.

    Attributes
    ----------
    states : list of str
        ``<joint>.pos`` of every joint, then ``<joint>.vel``, then ``<actuator>.act`` of actuators with a state. A free
        joint has ``.pos.x``, ``.y``, ``.z``, ``.qw``, ``.qx``, ``.qy``, ``.qz`` and ``.vel.x``, ``.y``, ``.z``, ``.rx``,
        ``.ry``, ``.rz``; a ball joint the last four and the last three. Units are those of the model (rad, m, s).
    ports : list of str
        Where a generalised force can enter, in addition to the inputs: the joints; ``<joint>.x`` to ``<joint>.rz`` of those with
        several degrees of freedom; ``<joint>.force`` where an actuator has the joint's name. In N m or N.
    kinematic : list of str
        States that are integrals of others: all positions.

    Raises
    ------
    MissingExtraError
        MuJoCo is not installed.
    SimulatorError
        The model cannot be read, or has no such actuator, state, sensor or parameter; ``dt`` is not a multiple of the
        timestep.

    Notes
    -----
    ``simulate`` takes the same steps as ``mujoco.mj_step``: same integrator, same timestep, same numbers. ``rhs`` is the forward
    dynamics, the limit of short steps: the same as ``mujoco.mj_forward``. A diagnosis uses the steps (``exact_step``). With
    ``integrator="RK4"`` and without free or ball joints these solve the forward dynamics accurately, and a diagnosis uses ``rhs``,
    in as few steps as the noise allows. Points and runs go through MuJoCo's batched rollout, with one copy of the model for each
    set of parameters; many points of a tree of hinges and slides on which nothing else acts go through its equations of motion,
    which agree to rounding. Models with a memory beyond these states (delayed actuators or sensors, plastic joints, plugins) give
    trajectories only. Inputs are held over a sample. A sensor's row k is its reading at the state and input of row k.

    Elements without a name are called ``joint0``, ``body1``, ``actuator2`` by their kind and number.

    References
    ----------
    Todorov, Erez, Tassa, *MuJoCo: A physics engine for model-based control*, IROS (2012) 5026-5033.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.physics import MuJoCoSimulator
    >>> pendulum = MuJoCoSimulator('''
    ...     <mujoco>
    ...       <worldbody>
    ...         <body>
    ...           <joint name="hinge" axis="0 1 0" damping="0.1"/>
    ...           <geom type="sphere" size="0.05" pos="0 0 -0.5" mass="1"/>
    ...         </body>
    ...       </worldbody>
    ...       <actuator><motor name="torque" joint="hinge"/></actuator>
    ...     </mujoco>''', outputs=["hinge.pos"], dt=0.01)
    >>> pendulum.states, pendulum.inputs, pendulum.ports
    (['hinge.pos', 'hinge.vel'], ['torque'], ['hinge'])
    >>> float(pendulum.simulate(np.full((200, 1), 0.5)).max().round(3))
    0.191
    """

    hold = "zoh"

    def __init__(
        self,
        model: Any,
        *,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        params: Mapping[str, float] | Sequence[str] | None = None,
        dt: float | None = None,
        x0: Any = None,
        n_threads: int | None = None,
        units: Mapping[str, str] | None = None,
    ):
        self.model = model
        self.inputs = inputs
        self.outputs = outputs
        self.params = params
        self.dt = dt
        self.x0 = x0
        self.n_threads = n_threads
        self.units = units

    # ---- what was given, and what it means --------------------------------------------------------------------------
    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Constructor arguments as given; with ``deep`` also every parameter as ``params__<name>``."""
        out = {name: self.__dict__[name] for name in self._get_param_names()}
        if deep:
            out.update({f"params__{name}": value for name, value in self.params.items()})
        return out

    def set_params(self, **params: Any) -> MuJoCoSimulator:
        """Set constructor arguments, or single parameters as ``params__<name>`` (in a new dict)."""
        for name in set(params) & set(self._get_param_names()):
            setattr(self, name, params.pop(name))
        super().set_params(**params)
        return self

    # ---- points -----------------------------------------------------------------------------------------------------
    @available_if(_is_markov)
    def rhs(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], forces: Any = None) -> np.ndarray:
        """Time derivative of the states: the model's forward dynamics.

        Parameters
        ----------
        t : float or array of shape s
        x : array-like (n_states, *s)
        u : array-like (n_inputs, *s)
        p : dict of float or of arrays of shape s
            Those that are missing have the model's values.
        forces : array-like (n_ports, *s), optional
            What enters at the ports; nothing by default.

        Returns
        -------
        ndarray (n_states, *s)
            nan where MuJoCo cannot go on.
        """
        shape, at = self._points(t, x, u, p, forces)
        return self._engine().rates(at).reshape(-1, *shape)

    @available_if(_is_markov)
    def step(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], dt: float, forces: Any = None) -> np.ndarray:
        """States (n_states, *s) a time ``dt`` later; inputs and forces are held. Other arguments as in :meth:`rhs`.

        A time that is not a multiple of the model's timestep is cut into equal shorter steps.
        """
        shape, at = self._points(t, x, u, p, forces)
        return self._engine().step(at, float(dt)).reshape(-1, *shape)

    @available_if(_has_sensors)
    def output(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], forces: Any = None) -> np.ndarray:
        """Outputs (n_outputs, *s), where some are sensors. Arguments as in :meth:`rhs`."""
        shape, at = self._points(t, x, u, p, forces)
        same = {*self.states, *self._engine().layout.same}
        read = np.empty(0) if same.issuperset(self.outputs) else self._engine().sensors(at)
        return self._select(at.x, read, axis=0).reshape(-1, *shape)

    @available_if(_has_equations)
    def drive_forces(self, x: Any, u: Any, p: Mapping[str, Any]) -> np.ndarray:
        """What the actuators bring at every port (n_ports, *s), of a model that is a tree of hinges and slides. Arguments as in :meth:`rhs`."""
        shape, at = self._points(0.0, x, u, p, None)
        engine = self._engine()
        places = [engine.layout.ports.index(name) for name in self.ports]
        return engine.drive_forces(at)[places].reshape(-1, *shape)

    def _points(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], forces: Any) -> tuple[tuple[int, ...], Points]:
        """Shape s, and where the engine is asked."""
        states = np.asarray(x, dtype=float)
        shape, size = states.shape[1:], int(np.prod(states.shape[1:]))

        def flat(value: Any) -> np.ndarray:
            return np.broadcast_to(np.asarray(value, dtype=float), shape).reshape(-1)

        layout = self._engine().layout
        controls, entering = np.zeros((len(layout.controls), size)), None
        rows = list(zip(self.inputs, u)) + ([] if forces is None else list(zip(self.ports, forces)))
        for name, value in rows:
            if name in layout.controls:
                controls[layout.controls.index(name)] = flat(value)
            else:
                entering = np.zeros((len(layout.ports), size)) if entering is None else entering
                entering[layout.ports.index(name)] = flat(value)
        params = {name: value if np.ndim(value) == 0 else flat(value) for name, value in p.items()}
        return shape, Points(flat(t), states.reshape(len(states), size), controls, entering, params)

    def _select(self, states: np.ndarray, sensors: np.ndarray, axis: int) -> np.ndarray:
        """Outputs, stacked along an axis, from states and sensor components."""
        layout = self._engine().layout
        rows = dict(zip(layout.states, np.moveaxis(states, axis, 0)))
        same = {name: rows[state] for name, state in layout.same.items()}
        read = {name: np.take(sensors, k, axis) for name, k in layout.sensors.items() if sensors.size}
        rows = {**read, **same, **rows}
        return np.stack([rows[name] for name in self.outputs], axis)

    # ---- runs -------------------------------------------------------------------------------------------------------
    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run.

        Parameters
        ----------
        U : array-like (n_samples, n_inputs)
        x0 : array-like (n_states,), optional
        t : array-like (n_samples,), optional
            Times, multiples of the model's timestep apart; default ``dt * arange(n_samples)``.

        Returns
        -------
        ndarray (n_samples, n_outputs)

        Raises
        ------
        SimulationDiverged
            A state became infinite or nan.
        SimulatorError
            U, x0 or t does not fit the model.
        """
        inputs = np.asarray(by_name(U, self.inputs), dtype=float)
        inputs = inputs[:, None] if inputs.ndim == 1 else inputs
        X, read, _ = self._run(inputs[None], x0, t)
        return self._select(X, read, axis=2)[0]

    def simulate_batch(self, U: Any, X0: Any = None, t: Any = None) -> np.ndarray:
        """Free runs of equal length: U (n_runs, n_samples, n_inputs) -> Y (n_runs, n_samples, n_outputs)."""
        X, read, _ = self._run(np.asarray(U, dtype=float), X0, t)
        return self._select(X, read, axis=2)

    @available_if(_is_markov)
    def simulate_states(self, U: Any, x0: Any = None, t: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """States of one run and their derivatives with the input that acts from t_k on, both (n_samples, n_states)."""
        inputs = np.asarray(by_name(U, self.inputs), dtype=float)
        inputs = inputs[:, None] if inputs.ndim == 1 else inputs
        X, _, times = self._run(inputs[None], x0, t)
        return X[0], self.rhs(times, X[0].T, inputs.T, self.params).T

    @available_if(_is_markov)
    def march(
        self,
        X0: np.ndarray,
        U: np.ndarray,
        p: Mapping[str, float],
        dt: float,
        entering: Callable[[int, float, np.ndarray], np.ndarray] | None = None,
        lengths: np.ndarray | None = None,
    ) -> np.ndarray | None:
        """States of runs under held inputs, by the model's own steps: what :meth:`step` gives, one sample after the other.

        Parameters
        ----------
        X0 : ndarray (n_states, n_runs)
        U : ndarray (n_inputs, n_runs, n_samples) or (n_parts, n_inputs, n_runs, n_samples)
            Held over a sample, or over each of so many equal parts, a divisor of its steps.
        p : dict of float
            Those that are missing have the model's values.
        dt : float
        entering : callable, optional
            ``entering(k, after, x)``: what enters at the inputs, then at the ports, (n_some, n_runs), in the step that begins a time
            ``after`` sample k, at states x (n_states, n_runs); the inputs by default. It is asked in the order of time, at the last
            sample too, so that it may carry states of its own.
        lengths : ndarray (n_runs,) of int, optional
            Samples of every run, n_samples at most and by default; states behind its end are not defined.

        Returns
        -------
        ndarray (n_states, n_runs, n_samples) or None
            nan where a run is not finite; None where ``dt`` is not a multiple of the model's timestep.
        """
        engine = self._engine()
        ratio = round(dt / engine.timestep)
        if ratio < 1 or abs(dt - ratio * engine.timestep) > 1e-6 * dt:
            return None
        if not np.isfinite(U).all():
            return np.full((len(X0), *U.shape[-2:]), np.nan)
        lengths = np.full(X0.shape[1], U.shape[-1]) if lengths is None else lengths
        if entering is not None:
            return run_in_steps(engine, [*self.inputs, *self.ports], X0, lengths, ratio, p, entering)
        return run_by_rollout(engine, self.inputs, X0, U if U.ndim == 4 else U[None], lengths, ratio, p)

    def _run(self, U: np.ndarray, X0: Any, t: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States (n_runs, n_samples, n_states), sensor components (n_runs, n_samples, n_components), times."""
        engine, names = self._engine(), self.inputs
        if U.ndim != 3 or U.shape[2] != len(names):
            raise SimulatorError(
                f"U has shape {U.shape if U.ndim != 3 or len(U) > 1 else U.shape[1:]}, expected (n_samples, {len(names)}): "
                f"one column for each of inputs={names}."
            )
        if not np.all(np.isfinite(U)):
            row = int(np.flatnonzero(~np.isfinite(U).all(axis=(0, 2)))[0])
            raise SimulatorError(f"U is not finite in row {row}: interpolate or cut the record there.")
        times = self.dt * np.arange(U.shape[1]) if t is None else np.asarray(t, dtype=float)
        if times.shape != (U.shape[1],) or not len(times):
            raise SimulatorError(f"t has shape {times.shape}, expected ({U.shape[1]},): one time for each row of U.")
        start = self.x0 if X0 is None else self._checked_x0(np.asarray(X0, dtype=float), engine)
        counts = whole_steps(np.diff(times), engine.timestep, "rows of t are apart by")
        try:
            controls = held_inputs(engine.layout, names, U, counts)
        except MemoryError as error:
            raise SimulatorError(
                f"the rows are {float(np.max(np.diff(times))):g} s apart, so that a run takes {int(counts.sum())} steps of the model's timestep "
                f"{engine.timestep:g} s, which memory does not hold: is the time in seconds?"
            ) from error
        rows = np.concatenate([[0], np.cumsum(counts)])
        if np.shape(start) not in ((engine.n_states,), (1, engine.n_states), (len(U), engine.n_states)):
            raise SimulatorError(
                f"X0 has shape {np.shape(start)}, expected ({engine.n_states},), or ({len(U)}, {engine.n_states}): one row for each run."
            )
        X0 = np.broadcast_to(start, (len(U), engine.n_states))
        X, read = engine.runs(float(times[0]), X0, controls, self.params, rows)
        raise_if_diverged(X, times, engine.layout.states, remedy=engine.refusal(self.params) or AFTER_DIVERGING)
        return X, read, times

    # ---- back to MuJoCo ---------------------------------------------------------------------------------------------
    def as_parameters(self, effects: Sequence[Any], values: Sequence[Mapping[str, float]]) -> tuple[Any, list[int]]:
        """Effects as parameters of the model, where they are ones.

        ``parameter_error``, ``input_gain`` of a motor, and ``linear_loss`` and ``coulomb_friction`` at a joint's port, driven
        by its velocity, are parameters. (Dry friction is a constraint in MuJoCo, softened near rest.)

        Parameters
        ----------
        effects : sequence of BaseEffect
        values : sequence of dict of float
            Parameters of each effect.

        Returns
        -------
        simulator : MuJoCoSimulator
            A clone with other ``params``.
        left : list of int
            Positions of the effects that no parameter can say; they are not in ``simulator``.

        Examples
        --------
        >>> from sksurrogate.effects import CATALOGUE
        >>> from sksurrogate.physics import MuJoCoSimulator
        >>> slider = MuJoCoSimulator('''<mujoco><worldbody><body><joint name="rail" type="slide"/>
        ...     <geom size="0.1"/></body></worldbody><actuator><motor name="push" joint="rail"/></actuator></mujoco>''')
        >>> weak, left = slider.as_parameters([CATALOGUE["input_gain"]("push")], [{"relative_error": -0.2}])
        >>> weak.params["push.gear"], left
        (0.8, [])
        """
        changed, left = as_parameters(self._engine(), self.params, effects, values)
        return clone(self).set_params(params={**self.params, **changed}), left

    def to_mjcf(self, path: Any = None) -> str:
        """The model with the parameters of this simulator, as MJCF.

        Parameters
        ----------
        path : path, optional
            File to write.

        Returns
        -------
        str
            The text. An MJCF file keeps its own text but for the numbers that changed. Where an element stands in an
            included file or has no name, and for a URDF, MuJoCo writes the whole model anew (numbers of six digits).

        Raises
        ------
        SimulatorError
            ``model`` is compiled and holds no XML, or MJCF cannot say what ``params`` says.

        Examples
        --------
        >>> from sksurrogate.physics import MuJoCoSimulator
        >>> slider = MuJoCoSimulator('''<mujoco><worldbody><body><joint name="rail" type="slide"/>
        ...     <geom size="0.1"/></body></worldbody></mujoco>''')
        >>> print(slider.set_params(**{"params__rail.damping": 0.25}).to_mjcf())
        <mujoco><worldbody><body><joint name="rail" type="slide" damping="0.25" />
            <geom size="0.1" /></body></worldbody></mujoco>
        """
        engine = self._engine()
        return patched(
            self.model, engine.with_values(self.params), engine.changed(self.params), engine.parameters, path
        )
