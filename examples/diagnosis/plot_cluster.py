"""
Cluster: does a diagnosis with dask give the same answer?
=========================================================

The joblib context decides where the work runs. Here a dask cluster has two processes on this machine. The search and the diagnosis must give the same answers. The memory of a worker is printed.
"""

import json
import warnings

import joblib
import numpy as np
import sklearn
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV, GroupKFold

from sksurrogate.compose import RecursivePredictor
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.exceptions import SurrogateError, require
from sksurrogate.gap import GapDiagnoser
from sksurrogate.model_selection import FreeRunScorer


def search(X, y, runs):
    """Lags and penalty, by the free run on runs left out."""
    with sklearn.config_context(enable_metadata_routing=True):
        return GridSearchCV(
            RecursivePredictor(Ridge()).set_fit_request(groups=True),
            {"output_lags": [1, 2, 3], "estimator__alpha": [1e-6, 1e-2]},
            scoring=FreeRunScorer("neg_rmse", n_initial=3),
            cv=GroupKFold(3),
        ).fit(X, y, groups=runs)


def numbers(report):
    """The whole report, without when and how fast it was made."""
    return json.dumps(
        {name: value for name, value in report.to_dict().items() if name not in ("provenance", "seconds")}
    )


def main():
    """Once here, once on the cluster."""
    distributed = require("distributed", "dask")
    X, y, runs = make_reactor_runs(6, 100, y0_range=(4.0, 6.0), u_range=(0.1, 0.16), noise=0.02, random_state=0)
    diagnoser = GapDiagnoser(make_reactor(second=80.0), effects=["parameter_error", "sensor_bias"], random_state=0)
    here = search(X, y, runs), numbers(diagnoser.fit(X, y, groups=runs).report_)
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, memory_limit="1GiB")
    with cluster, distributed.Client(cluster) as client, joblib.parallel_config("dask"):
        there = search(X, y, runs), numbers(diagnoser.fit(X, y, groups=runs).report_)
        workers = client.scheduler_info()["workers"].values()
        memory = [worker["metrics"]["memory"] / 2**20 for worker in workers]
    print(f"best here {here[0].best_params_}, on the cluster {there[0].best_params_}")
    print(f"the diagnoses are {'the same' if here[1] == there[1] else 'different'}")
    print(f"memory of a worker: {max(memory):.0f} MiB, of it the packages themselves most")
    assert np.allclose(here[0].best_score_, there[0].best_score_)


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # dask speaks of its own ports and spilling
    try:
        main()
    except SurrogateError as error:
        print(f"Skipped: {error}")
