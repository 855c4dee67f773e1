"""GapDiagnoser: parameters, data and report of a diagnosis."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral, Real
from typing import Any, ClassVar

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import HasMethods, Interval

from sksurrogate._columns import by_name
from sksurrogate._parallel._pickled import refuse_what_stays
from sksurrogate._stamps import on_grid, with_rows_in_gaps
from sksurrogate._warned_once import warned_once
from sksurrogate.effects._simulator import AugmentedSimulator
from sksurrogate.exceptions import DataError, SimulatorError
from sksurrogate.gap._begin import Task, begin_ode, begin_trajectory
from sksurrogate.gap._progress import Progress, progress_shown
from sksurrogate.gap._provenance import with_provenance
from sksurrogate.gap.faults._joined_runs import SHORTEST_RUN, say_joined_runs
from sksurrogate.gap.fit._known_parameters import KnownParameters
from sksurrogate.gap.render._report import GapReport
from sksurrogate.gap.rounds._rounds import diagnosed_in_rounds
from sksurrogate.kernels.record import Record
from sksurrogate.physics._asked import asked_bounds, asked_priors
from sksurrogate.physics._simulator import Plant, bounds_of, describe, recorded
from sksurrogate.runs import resolve_runs


class GapDiagnoser(BaseEstimator):
    """Diagnose the gap between a simulator and measured runs of the real plant.

    Parameters
    ----------
    simulator : object with ``simulate``
        Nominal model. With a right-hand side or a step function all effects can be tested, with ``simulate`` alone those of
        inputs, sensors and parameters.
    effects : sequence of str, effect classes or effect instances, optional
        Candidates; None for the whole catalogue at every place of the plant.
    exclude : sequence, default=()
        Effects that are absent and places that are right: names of effects (``"drift"``), places of the simulator (a state,
        input, output or parameter: no effect there), ``(name, location)`` or ``(name, location, variable)``. None in a tuple
        stands for any. Names may hold wildcards: ``("sensor_*", "level")`` says that this sensor is good.
    plausible : sequence, optional
        Where effects may act, in the words of ``exclude``; None: anywhere. ``(name, location)``: effects of that name act there
        only, others anywhere (``[("*friction", "joint")]``: friction in the joint only). A name or a place alone: no effects but
        these (``["valve"]``: the gap comes from the valve); such entries do not hold for an effect that an entry with a location names.
    free_params : sequence of str or "all", default=()
        Parameters of the simulator that are re-tuned with the null model and with every candidate, so a badly tuned simulator
        is not mistaken for a missing effect. None: no parameter.
    bounds : dict of (low, high), optional
        Limits of parameters of the simulator, by name, in their units; None leaves a side open. They hold in every fit: for
        free parameters, and for ``parameter_error`` as a candidate. By default those that the simulator knows: damping, dry
        friction and armature of a MuJoCo model are not negative.
    priors : dict, optional
        Expected values, by name: ``{"k": 0.05}`` is a relative standard deviation of 5 % around the simulator's value,
        ``{"k": (2.0, 0.1)}`` a mean and a standard deviation in the unit of k. A parameter keeps its sign: the prior is
        log-normal (of that median and relative standard deviation), and normal where the simulator's value is 0. A free
        parameter without a prior has a relative standard deviation of 10 % with heavy tails (Student's t).
    time : column name or int, optional
        Column of X that holds the time of every row; by default rows are ``simulator.dt`` apart. Stamps may be uneven and have gaps.
        A right-hand side is integrated from stamp to stamp. Other simulators run on their even grid, and their outputs are
        compared with the readings at the stamps. Inputs are held (or joined) from one stamp to the next. If an input differs
        before and after a gap, a new run starts behind the gap, if the initial states can be fitted.
    clock_offset : float, default=0.0
        Time by which the clocks of two sensors may be apart: a reading may show what is to come, so that ``sensor_delay`` is
        negative, down to minus this. With 0 no sensor is early.
    tolerance : float, default=0.1
        Share of the gap (amplitude, on held-out runs) that an explained model may leave: no form of an effect is exact on a
        real plant.
    include_law : bool, default=True
        Whether ``augmented_`` contains the law without a name, ``report_.missing_term.law``, if it is certified on held-out
        runs.
    correction : estimator, optional
        Generic learner of the waterfall; default ``HybridRegressor(simulator)``.
    time_limit : float, optional
        Seconds after which the diagnosis ends. The report then has the results so far, ``complete=False`` and a note on the open
        questions. The first half of the time is for the search of names, the second for their tests. The comparison of the
        simulator alone with the data is always finished.
    n_jobs : int, optional
        Workers for the fits of the candidates, through joblib; -1 for one per core. None: fits in this process, and independent
        questions in a second process if a core is free and the simulator can be copied: it holds no connection. 1: everything in
        this process.
    verbose : int, default=0
        1 shows the stage, the share that is done and an estimate of the remaining time: as a bar on a terminal (with rich, extra
        ``plot``), otherwise as lines on the error stream.
    random_state : int, RandomState or None, default=None
        Seed of the bootstrap.

    Attributes
    ----------
    report_ : GapReport
    augmented_ : AugmentedSimulator
        The simulator with the effects added and free parameters at their re-tuned values.
    n_features_in_ : int
        Inputs that ``fit`` was given; ``feature_names_in_`` holds the names of the columns of a frame.
    initial_states_ : ndarray (n_runs, n_states)
        Initial states of the runs for ``augmented_``; nan for runs of a long record that took no part, for runs without the effects
        if these act in other runs, and for a simulator with ``simulate`` alone that takes none.

    Notes
    -----
    A candidate's evidence is the likelihood of its own output-error fit, initial states unknown in every run, under its own
    noise: white sensor noise, coloured forces in the balances, coloured sensor noise. ``T = 2 (L - L_null)`` must exceed
    ``k ln N + 2 ln M`` for k parameters, N measured values and M candidates. A record of more than 9000 samples,
    or of more than 3000 with over 18000 readings of all outputs, is searched in pieces, and the named effects are fitted again on
    up to 60000 samples. With more than six states, effects and laws are first tried with signals that their balance sees along the
    data, or that see it; effects of distant signals follow where more than 1.15 times the noise is left.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 4.4; Kristensen, Madsen, Jorgensen,
    *Parameter estimation in stochastic grey-box models*, Automatica 40 (2004).

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.gap import GapDiagnoser
    >>> from sksurrogate.physics import ODESimulator
    >>> def rhs(t, x, u, p):
    ...     return [u[0] - p["k"] * x[0] - p["c"] * x[0] ** 3]
    >>> plant = ODESimulator(rhs, states=["level"], inputs=["flow"], outputs=["level"], params={"k": 1.0, "c": 0.5}, dt=0.1)
    >>> rng = np.random.default_rng(0)
    >>> U = np.repeat(rng.uniform(0, 3, 60), 5)[:, None]
    >>> Y = plant.simulate(U) + 0.005 * rng.normal(size=(300, 1))
    >>> simulator = plant.set_params(params__c=0.0)
    >>> diagnoser = GapDiagnoser(simulator, effects=["constant_bias", "linear_loss", "cubic_stiffness"], random_state=0)
    >>> report = diagnoser.fit(U, Y).report_
    >>> report.verdict, report.effects[0].name
    ('explained', 'cubic_stiffness')
    """

    _parameter_constraints: ClassVar[dict[str, list[Any]]] = {
        "simulator": [HasMethods("simulate")],
        "free_params": ["array-like", str, None],
        "clock_offset": [Interval(Real, 0, None, closed="left")],
        "tolerance": [Interval(Real, 0, 1, closed="neither")],
        "time_limit": [Interval(Real, 0, None, closed="neither"), None],
        "n_jobs": [Integral, None],
        "verbose": ["verbose"],
        "random_state": ["random_state"],
    }
    __metadata_request__fit = {"groups": True}
    report_: GapReport
    augmented_: AugmentedSimulator
    initial_states_: np.ndarray
    n_features_in_: int

    def __init__(
        self,
        simulator: Any,
        *,
        effects: Any = None,
        exclude: Any = (),
        plausible: Any = None,
        free_params: Sequence[str] | str | None = (),
        bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
        priors: Mapping[str, float | tuple[float, float]] | None = None,
        time: str | int | None = None,
        clock_offset: float = 0.0,
        tolerance: float = 0.1,
        include_law: bool = True,
        correction: Any = None,
        time_limit: float | None = None,
        n_jobs: int | None = None,
        verbose: int = 0,
        random_state: Any = None,
    ):
        self.simulator = simulator
        self.effects = effects
        self.exclude = exclude
        self.plausible = plausible
        self.free_params = free_params
        self.bounds = bounds
        self.priors = priors
        self.time = time
        self.clock_offset = clock_offset
        self.tolerance = tolerance
        self.include_law = include_law
        self.correction = correction
        self.time_limit = time_limit
        self.n_jobs = n_jobs
        self.verbose = verbose
        self.random_state = random_state

    def fit(self, X: Any, y: Any, groups: Any = None) -> GapDiagnoser:
        """Diagnose.

        Parameters
        ----------
        X : array-like or frame (n_samples, n_inputs), or None
            Measured inputs, columns in the order (or with the names) of the simulator's inputs; None where it has none.
        y : array-like (n_samples,) or (n_samples, n_outputs)
            Measured outputs, likewise; nan where an output was not measured (sensors at other rates, dropouts).
        groups : array-like (n_samples,), optional
            Run of every row; one run by default.

        Returns
        -------
        self

        Raises
        ------
        DataError, RunError
            The data do not keep the convention; ``bounds`` or ``priors`` name no parameter, or hold no such numbers;
            ``exclude`` or ``plausible`` names what is not there, or leaves nothing.
        SimulatorError
            The simulator does not, or does not fit the data; ``free_params`` names something that is not a parameter of it, or one parameter twice;
            it gives trajectories only, and none of ``effects`` can be tested with it.
        ValueError
            ``effects`` holds a name that is not in the catalogue or something that is not an effect; ``n_jobs`` is 0 or not an integer.
        """
        self._check_parameters()
        with progress_shown(self.verbose) as show, warned_once():
            return self._fit(X, y, groups, Progress(show, self.time_limit))

    def _fit(self, X: Any, y: Any, groups: Any, progress: Progress) -> GapDiagnoser:
        """The whole diagnosis."""
        if hasattr(X, "columns"):
            self.feature_names_in_ = np.asarray(list(map(str, X.columns)), dtype=object)
        seed = int(check_random_state(self.random_state).randint(2**31 - 1))
        inputs, clock = getattr(self.simulator, "inputs", None), self.time if isinstance(self.time, str) else None
        X, y = by_name(X, inputs, clock), by_name(y, getattr(self.simulator, "outputs", None))
        dt = getattr(self.simulator, "dt", None)
        runs = resolve_runs(
            X, y, groups=groups, time=self.time, dt=dt, allow_uneven=True, unmeasured=True, min_rows=SHORTEST_RUN
        )
        if runs[0].y is None:
            raise DataError("y is missing: the diagnosis compares measured outputs with the simulator's.")
        plant = describe(self.simulator, n_inputs=runs[0].X.shape[1], n_outputs=runs[0].y.shape[1], dt=runs.dt)
        plant = recorded(plant, [run.X for run in runs])
        free = _free(self.free_params, plant.params)
        _refuse_still([run.y for run in runs], plant.outputs)
        say_joined_runs(runs, plant)
        user_knows = _known(self.bounds, self.priors, plant)
        offsets, uneven, first_parts = None, False, np.arange(len(runs))
        if self.time is not None and plant.access == "rhs":
            runs, uneven, first_parts = with_rows_in_gaps(runs, plant.dt, plant.hold, self.time)
        elif self.time is not None:
            runs, offsets = on_grid(runs, plant.dt, plant.hold, self.time)
        parts = [r.X for r in runs], [r.y for r in runs], [r.t for r in runs]
        whole = Record.from_runs(*parts, plant.dt, offsets, uneven)
        begin = begin_trajectory if plant.access == "trajectory" else begin_ode
        pipeline, report = diagnosed_in_rounds(
            lambda some, record: begin(Task(self, plant, some, record, free, user_knows, seed, progress)),
            plant,
            runs,
            whole,
            progress,
        )
        self.n_features_in_ = runs[0].X.shape[1]
        final = pipeline.final.candidate
        self.report_ = with_provenance(report, self, final, len(runs), whole.n_samples, progress.elapsed)
        self.augmented_ = pipeline.augmented()
        at_start = pipeline.carried().candidate.initial_states()
        first = pipeline.rows[pipeline.problem.record.starts]
        known = np.isin(first, whole.starts)
        self.initial_states_ = np.full((len(runs), at_start.shape[1]), np.nan)
        self.initial_states_[np.searchsorted(whole.starts, first[known])] = at_start[known]
        self.initial_states_ = self.initial_states_[first_parts]
        return self

    def _check_parameters(self) -> None:
        """Values that no diagnosis can work with."""
        if self.n_jobs is not None and not (isinstance(self.n_jobs, Integral) and self.n_jobs != 0):
            raise ValueError(
                f"n_jobs={self.n_jobs!r}: expected None, -1 (one worker for each core) or a positive integer; write n_jobs=1."
            )
        refuse_what_stays(self.simulator, self.n_jobs)
        limit = self.time_limit
        if limit is not None and (not isinstance(limit, Real) or isinstance(limit, bool) or not 0.0 < limit < np.inf):
            raise ValueError(
                f"time_limit={limit!r}: expected None or a number of seconds above 0; write time_limit=60."
            )
        offset = self.clock_offset
        if not isinstance(offset, Real) or isinstance(offset, bool) or not 0.0 <= offset < np.inf:
            raise ValueError(
                f"clock_offset={offset!r}: expected a time from 0 on, the most by which two clocks are apart; write clock_offset=0.0 where "
                "all sensors have one clock."
            )
        if not (isinstance(self.tolerance, Real) and 0.0 < self.tolerance < 1.0):
            raise ValueError(
                f"tolerance={self.tolerance!r}: expected a share of the gap between 0 and 1; the default is 0.1."
            )


def _refuse_still(Y: Sequence[np.ndarray], names: Sequence[str]) -> None:
    """An output that reads one number in all rows is an error."""
    for name, y in zip(names, np.concatenate(Y).T):
        values = y[~np.isnan(y)]
        if np.ptp(values) == 0:
            raise DataError(
                f"y never moves in column {name!r}: it is {values[0]:g} in all rows, so it shows no gap. "
                "If the plant moved, this sensor stood still: leave the output out of y and of the simulator's outputs. If the "
                "plant stood still, record a run in which it moves."
            )


def _known(bounds: Any, priors: Any, plant: Plant) -> KnownParameters:
    """What the user knows of the parameters, checked; ranges that the simulator knows where the user gives none."""
    params, names = plant.params, list(plant.params)
    low, high = asked_bounds(bounds, names, "is not a parameter of the simulator")
    limits = {name: (float(a), float(b)) for name, a, b in zip(names, low, high) if np.isfinite(a) or np.isfinite(b)}
    limits = {**bounds_of(plant.simulator), **limits}
    known = KnownParameters(limits, asked_priors(priors, params, "is not a parameter of the simulator"))
    known.check(params)
    return known


def _free(free_params: Any, params: Any) -> tuple[str, ...]:
    """Names of the free parameters."""
    if free_params is None:
        return ()
    if isinstance(free_params, str):
        if free_params == "all":
            return tuple(params)
        free_params = (free_params,)
    names = list(free_params) if isinstance(free_params, Iterable) else [free_params]
    for k, name in enumerate(names):
        if not isinstance(name, str):
            raise SimulatorError(
                f'free_params={free_params!r}: {name!r} is not a name; expected a list of names out of {sorted(params)}, or "all".'
            )
        if name not in params:
            raise SimulatorError(f"free_params: the simulator has no parameter {name!r}; it has {sorted(params)}.")
        if name in names[:k]:
            raise SimulatorError(f"free_params={free_params!r}: {name!r} is listed twice; list each parameter once.")
    return tuple(names)
