"""Searches and diagnoses on a dask cluster of processes give what they give here."""

import re
import warnings

import joblib
import numpy as np
import pytest
import sklearn
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV, GroupKFold

from sksurrogate._parallel import _interrupts
from sksurrogate.blind import run_blind_check
from sksurrogate.compose import RecursivePredictor
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.gap import GapDiagnoser
from sksurrogate.model_selection import FreeRunScorer

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),  # dask's and loky's own, in threads of theirs
]


def printed(report):
    """The terminal page without when it was made and how long it took."""
    return re.sub(r"date:\s+\S+\s+[0-9:]+;\s+time\s+taken:\s+[0-9.]+\s+s", "", str(report))


@pytest.fixture(scope="module")
def client():
    """Two worker processes on this machine."""
    distributed = pytest.importorskip("distributed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with (
            distributed.LocalCluster(
                n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit="1GiB"
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client


def search():
    """A search over lags and penalties on the free run."""
    return GridSearchCV(
        RecursivePredictor(Ridge()).set_fit_request(groups=True),
        {"output_lags": [1, 2], "estimator__alpha": [1e-6, 1.0]},
        scoring=FreeRunScorer("neg_rmse", n_initial=2),
        cv=GroupKFold(3),
    )


@pytest.mark.slow
def test_a_search_on_the_cluster(client):
    X, y, groups = make_reactor_runs(6, 80, y0_range=(4.0, 6.0), u_range=(0.1, 0.16), noise=0.02, random_state=0)
    with sklearn.config_context(enable_metadata_routing=True):
        here = search().fit(X, y, groups=groups)
        with joblib.parallel_config("dask"):
            there = search().fit(X, y, groups=groups)
    np.testing.assert_allclose(there.cv_results_["mean_test_score"], here.cv_results_["mean_test_score"], rtol=1e-9)


@pytest.mark.slow
def test_a_diagnosis_on_the_cluster(client, monkeypatch):
    X, y, groups = make_reactor_runs(4, 80, noise=0.02, random_state=0)
    names = ["parameter_error", "sensor_bias", "input_bias", "input_lag"]
    here = GapDiagnoser(make_reactor(second=80.0), effects=names, random_state=0).fit(X, y, groups=groups).report_
    workers = []

    def spy(n_jobs, **options):
        workers.append(joblib.effective_n_jobs(n_jobs))
        return _interrupts.workers(n_jobs, **options)

    monkeypatch.setattr("sksurrogate.gap.search._expander.workers", spy)
    with joblib.parallel_config("dask"):
        there = GapDiagnoser(make_reactor(second=80.0), effects=names, random_state=0).fit(X, y, groups=groups).report_
    assert printed(here) == printed(there)
    assert workers and set(workers) == {2}


@pytest.mark.slow
def test_a_blind_check_on_the_cluster(client, tmp_path, monkeypatch):
    """The same cases, the same scores; rows are stored as they come."""
    (tmp_path / "answer.py").write_text(
        "def says_nothing(question):\n"
        "    predicted = [question.simulator.simulate(U, x0=x) for U, x in zip(question.X_test, question.x0_test)]\n"
        "    return {'verdict': 'none', 'effects': [], 'where': {'location': None}, 'predicted': predicted, 'seconds': 0.0}\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    client.upload_file(str(tmp_path / "answer.py"))
    same = {"arms": "none", "seed": 1, "diagnosis": "answer:says_nothing"}
    here = run_blind_check(2, **same)
    with joblib.parallel_config("dask"):
        there = run_blind_check(2, **same, resume=tmp_path / "rows.jsonl")
    assert not any("error" in row for row in (*here.rows, *there.rows))
    assert {r["seed"]: (r["plant"], r["right"]) for r in there.rows} == {
        r["seed"]: (r["plant"], r["right"]) for r in here.rows
    }
    assert len((tmp_path / "rows.jsonl").read_text().splitlines()) == 2


@pytest.mark.slow
def test_a_diagnosis_in_two_processes():
    X, y, groups = make_reactor_runs(4, 80, noise=0.02, random_state=0)
    names = ["parameter_error", "sensor_bias", "input_bias", "input_lag"]
    alone, shared = (
        GapDiagnoser(make_reactor(second=80.0), effects=names, n_jobs=n_jobs, random_state=0).fit(X, y, groups=groups)
        for n_jobs in (None, 2)
    )
    assert printed(alone.report_) == printed(shared.report_)


def test_a_simulator_with_a_function_of_the_script_travels(client):
    """Lambdas and functions of a script go by value."""
    from sksurrogate.physics import ODESimulator

    simulator = ODESimulator(
        lambda t, x, u, p: [u[0] - p["k"] * x[0]], states=["x"], inputs=["u"], outputs=["x"], params={"k": 1.0}, dt=0.1
    )
    U = np.ones((10, 1))
    with joblib.parallel_config("dask"):
        found = joblib.Parallel()(joblib.delayed(simulator.simulate)(U) for _ in range(3))
    for one in found:
        np.testing.assert_allclose(one, simulator.simulate(U))


def test_memory_of_a_worker_stays_within_its_limit(client):
    for worker in client.scheduler_info()["workers"].values():
        assert worker["metrics"]["memory"] < worker["memory_limit"]
