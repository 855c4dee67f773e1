"""A time limit: the report holds what is known by then; progress with an estimate."""

import io
import itertools
import time
from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser, _begin, _pipeline, _progress
from sksurrogate.gap._progress import Progress, progress_shown
from sksurrogate.gap.search._set_moves import SetMoves
from sksurrogate.kernels import clock
from sksurrogate.kernels.clock import TimeIsUp, check_time, limited, time_left, time_until
from sksurrogate.physics import ODESimulator

EFFECTS = ["sensor_bias", "input_bias", "input_gain", "linear_loss", "cubic_stiffness", "constant_bias"]


def level(t, x, u, p):
    return (u[0] - p["k"] * x[0] - p["c"] * x[0] ** 3,)


def plant(c=0.0, rhs=level):
    return ODESimulator(rhs, states=["level"], inputs=["flow"], outputs=["level"], params={"k": 1.0, "c": c}, dt=0.1)


class Slow:
    """Seen from outside, and slow."""

    states, inputs, outputs, dt, params = ("level",), ("flow",), ("level",), 0.1, {"k": 1.0}

    def simulate(self, U, x0=None, t=None):
        time.sleep(0.05)
        return plant().simulate(U, x0=x0)


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(0, 3, 60), 5)[:, None]
    runs = np.repeat([0, 1, 2], 100)
    y = np.concatenate([plant(0.5).simulate(U[runs == run], x0=[0.0]) for run in range(3)])
    return U, y + 0.005 * rng.normal(size=y.shape), runs


def diagnosed(simulator, data, **settings):
    U, y, runs = data
    return GapDiagnoser(simulator, **{"effects": EFFECTS, "n_jobs": 1, "random_state": 0, **settings}).fit(
        U, y, groups=runs
    )


@pytest.fixture
def ticks(monkeypatch):
    """A clock that moves on by one whenever it is asked."""
    ticks = itertools.count()
    counted = SimpleNamespace(perf_counter=lambda: float(next(ticks)))
    for module in (clock, _progress, _pipeline):
        monkeypatch.setattr(module, "time", counted)
    return ticks


@pytest.mark.parametrize("simulator", [plant(), Slow()], ids=["rhs", "simulate"])
def test_whenever_the_time_is_up_there_is_a_report(simulator, data, ticks, monkeypatch):
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    answers = []
    for limit in (1, 30, 100, 1000, 3000, 10**4, 3 * 10**4, 10**5, 10**9):
        diagnoser = diagnosed(simulator, data, time_limit=limit)
        report = diagnoser.report_
        answers.append((len(report.effects) > 0, report.complete))
        assert report.complete == (not any("time limit" in note for note in report.notes))
        if report.reasons.rule == "interrupted":
            assert report.verdict == "unknown" and "before it had an answer" in report.sentence
        str(report), report.to_html(), report.to_dict()
        assert np.isfinite(diagnoser.augmented_.simulate(data[0][:50], x0=[0.1])).all()
    assert [complete for _, complete in answers] == sorted(complete for _, complete in answers)
    assert answers[0] == (False, False) and answers[-1] == (True, True)
    assert (True, False) in answers  # names stand before they are judged


def test_the_names_of_a_cut_search_are_those_of_a_whole_one(data, ticks):
    whole = diagnosed(plant(), data).report_
    for limit in (300, 1000, 3000):
        some = diagnosed(plant(), data, time_limit=limit).report_
        if some.effects:
            assert some.effects[0].name == whole.effects[0].name == "cubic_stiffness"


@pytest.mark.parametrize("simulator", [plant(), Slow()], ids=["rhs", "simulate"])
def test_an_interrupted_search_leaves_the_best_of_what_it_fitted(simulator, data, monkeypatch):
    def interrupted(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    monkeypatch.setattr(SetMoves, "ranked", interrupted)
    with pytest.warns(UserWarning, match="interrupted"):
        report = diagnosed(simulator, data).report_
    assert not report.complete and len(report.effects) == 1


def slow_level(t, x, u, p):
    time.sleep(0.002)
    return level(t, x, u, p)


@pytest.mark.parametrize("simulator", [plant(rhs=slow_level), Slow()], ids=["rhs", "simulate"])
def test_a_slow_simulator_ends_near_the_limit(simulator, data):
    started = time.perf_counter()
    report = diagnosed(simulator, data, time_limit=2.0).report_
    assert time.perf_counter() - started < 5.0  # a busy machine; the whole diagnosis takes some twenty seconds
    assert not report.complete and report.seconds < 5.0
    assert "The time limit of 2 s ended the diagnosis early" in report.notes[0]


@pytest.mark.parametrize("limit", [0, -1.0, "60", True, np.inf])
def test_a_mistaken_limit_is_named(limit, data):
    with pytest.raises(ValueError, match=r"time_limit=.*: expected None or a number of seconds above 0"):
        diagnosed(plant(), data, time_limit=limit)


def test_the_clock_stops_once():
    check_time()
    assert not limited() and time_left() == np.inf
    with time_until(time.perf_counter() + 100.0):
        check_time()
        assert limited() and 99.0 < time_left() <= 100.0
        with time_until(time.perf_counter()), pytest.raises(TimeIsUp):
            check_time()
        check_time()
    with time_until(0.0):
        with pytest.raises(KeyboardInterrupt):
            check_time()
        check_time()  # who catches it may end in order
    assert not limited()


def test_progress_tells_share_and_rest(monkeypatch):
    shown = []
    now = iter([100.0, 110.0, 120.0, 130.0])
    monkeypatch.setattr(_progress, "time", SimpleNamespace(perf_counter=lambda: next(now)))
    progress = Progress(lambda *what: shown.append(what), time_limit=32.0)
    progress.stage(0.5)
    progress.say("first")
    progress.say("second")
    progress.stage(0.5)
    progress.say("third")
    assert shown == [("first", 0.0, None), ("second", 0.25, 12.0), ("third", 0.5, 2.0)]


def test_another_round_begins_anew(monkeypatch):
    """After a fault of the record the bar stood at its end, with nothing left, for minutes."""
    shown = []
    now = iter([0.0, 50.0, 100.0, 110.0, 115.0, 120.0])
    monkeypatch.setattr(_progress, "time", SimpleNamespace(perf_counter=lambda: next(now)))
    progress = Progress(lambda *what: shown.append(what), time_limit=None)
    progress.stage(1.0)
    progress.say("first")
    progress.begin()
    progress.stage(0.5)
    progress.say("again")
    progress.begin(0.8)  # a round that goes on
    progress.stage(0.2)
    progress.say("on")
    assert [one[:2] for one in shown] == [("first", 0.0), ("again", 0.0), ("on", 0.8)]
    assert progress.done == pytest.approx(0.9)


def test_stages_end_one_after_the_other_within_a_time_limit():
    ends = [stage.until for stage in _pipeline.STAGES if stage.share > 0.0 and np.isfinite(stage.until)]
    assert len(ends) > 5 and np.all(np.diff([0.0, *ends, 1.0]) >= 0.0)


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_lines_go_to_a_file_and_a_bar_to_a_terminal(monkeypatch, capsys):
    with progress_shown(1) as show:
        show("fitting", 0.25, 12.3)
    assert capsys.readouterr().err == "[gap]  25 % fitting (about 12 s left)\n"
    with progress_shown(0) as show:
        assert show is None
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    pytest.importorskip("rich")
    with progress_shown(1) as show:
        show("fitting [3]", 0.25, 12.3)
    assert "fitting [3] (about 12 s left)" in terminal.getvalue() and "25%" in terminal.getvalue()


def test_a_call_that_takes_long_is_said_before_minutes_go_by(data, monkeypatch):
    monkeypatch.setattr(_begin, "SLOW_CALL", 0.0)
    with pytest.warns(
        RuntimeWarning, match=r"One call of the simulator's rhs takes 0\.0 s.*Let it take many points at once"
    ):
        diagnosed(plant(), data, effects=["cubic_stiffness"], time_limit=1e-3)
