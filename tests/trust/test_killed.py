"""A search, a campaign of simulations or a blind check that is killed goes on where it was, with nothing lost."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import sklearn
from sklearn.base import clone
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.model_selection import GridSearchCV, GroupKFold
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.compose import RecursivePredictor
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.model_selection import FreeRunScorer, Remembered


@parametrize_with_checks([Remembered(LinearRegression())])
def test_contract(estimator, check):
    check(estimator)


class Counting(Ridge):
    """Counts its fits in a file."""

    def __init__(self, alpha=1.0, log=None):
        super().__init__(alpha)
        self.log = log

    def fit(self, X, y):
        with open(self.log, "a") as stream:
            stream.write(f"{self.alpha}\n")
        return super().fit(X, y)


def test_a_fit_is_made_once(tmp_path):
    X, y, _ = make_reactor_runs(2, 40, random_state=0)
    model = Remembered(Counting(log=str(tmp_path / "log")), tmp_path / "fits")
    first, again = (clone(model).fit(X, y).predict(X) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    clone(model).set_params(estimator__alpha=2.0).fit(X, y)
    clone(model).fit(X[:-1], y[:-1])
    assert (tmp_path / "log").read_text().split() == ["1.0", "2.0", "1.0"]


def test_runs_and_learned_attributes_pass_through(tmp_path):
    X, y, groups = make_reactor_runs(6, 60, y0_range=(4.0, 6.0), u_range=(0.1, 0.16), noise=0.02, random_state=0)
    plain = RecursivePredictor(Ridge(1e-3), 2, 2)
    kept = Remembered(plain, tmp_path).fit(X, y, groups=groups)
    assert kept.n_initial_ == 2
    np.testing.assert_array_equal(
        kept.predict(X, groups=groups), plain.fit(X, y, groups=groups).predict(X, groups=groups)
    )
    assert kept.score(X, y, groups=groups) == plain.score(X, y, groups=groups)
    grid = {"estimator__output_lags": [1, 2]}
    with sklearn.config_context(enable_metadata_routing=True):
        found = [
            GridSearchCV(
                (model if name else model.estimator).set_fit_request(groups=True),
                grid if name else {"output_lags": [1, 2]},
                scoring=FreeRunScorer("neg_rmse", n_initial=2),
                cv=GroupKFold(3),
            ).fit(X, y, groups=groups)
            for name, model in ((False, Remembered(plain)), (True, Remembered(plain, tmp_path)))
        ]
    np.testing.assert_array_equal(*(search.cv_results_["mean_test_score"] for search in found))


KILLED_SEARCH = """
import sys, time
import numpy as np
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV
from sksurrogate.model_selection import Remembered

class Slow(Ridge):
    def __init__(self, alpha=1.0, log=None):
        super().__init__(alpha)
        self.log = log

    def fit(self, X, y):
        with open(self.log, "a") as stream:
            stream.write(str(self.alpha) + chr(10))
        with open(self.log) as stream:
            if len(stream.readlines()) == int(sys.argv[3]):
                time.sleep(3600)  # here it is killed
        return super().fit(X, y)

if __name__ == "__main__":
    log, folder = sys.argv[1:3]
    rng = np.random.default_rng(0)
    X = rng.normal(size=(30, 2))
    model = Remembered(Slow(log=log), folder)
    search = GridSearchCV(model, {"estimator__alpha": [0.1, 1.0, 10.0]}, cv=5, refit=False).fit(X, X[:, 0])
    print(search.best_params_["estimator__alpha"])
"""


def lines(path):
    return path.read_text().split() if path.exists() else []


def wait_for(condition, process):
    """Until it holds; the process stops by itself there, so that no clock decides what it has done."""
    while not condition():
        assert process.poll() is None, "it ended before it was killed"
        time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_killed_search_goes_on(tmp_path):
    (tmp_path / "search.py").write_text(KILLED_SEARCH)
    log = tmp_path / "log"
    line = [sys.executable, str(tmp_path / "search.py"), str(log), str(tmp_path / "fits")]
    process = subprocess.Popen([*line, "7"], stdout=subprocess.DEVNULL)
    wait_for(lambda: len(lines(log)) == 7, process)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    out = subprocess.run([*line, "0"], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "0.1"
    assert len(lines(log)) == 16  # 15 fits in all, and the one that was cut off once more


KILLED_CHECK = """
import sys
from sksurrogate.blind import run_blind_check

if __name__ == "__main__":
    run_blind_check(4, ["none", "coloured"], seed=1, diagnosis=sys.argv[1], resume=sys.argv[2])
"""

ANSWER = """
import time
from pathlib import Path

def says_nothing(question):
    asked = Path(__file__).with_name("asked")
    asked.open("a").write("x")
    if len(asked.read_text()) == 3:
        time.sleep(3600)  # here it is killed
    predicted = [question.simulator.simulate(U, x0=x) for U, x in zip(question.X_test, question.x0_test)]
    return {"verdict": "none", "effects": [], "where": {"location": None}, "predicted": predicted, "seconds": 0.5}
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_killed_blind_check_goes_on(tmp_path):
    (tmp_path / "check.py").write_text(KILLED_CHECK)
    (tmp_path / "answer.py").write_text(ANSWER)
    rows = tmp_path / "rows.jsonl"
    line = [sys.executable, str(tmp_path / "check.py"), "answer:says_nothing", str(rows)]
    process = subprocess.Popen(line, start_new_session=True)
    wait_for(lambda: len("".join(lines(tmp_path / "asked"))) == 3, process)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    before = rows.read_text().splitlines()
    assert len(before) == 2
    subprocess.run(line, check=True, capture_output=True)
    after = rows.read_text().splitlines()
    assert after[: len(before)] == before and not any("error" in json.loads(row) for row in after)
    assert len(after) == 4 and len({(json.loads(row)["arm"], json.loads(row)["seed"]) for row in after}) == 4
