"""Is a hybrid ever worse than its simulator? Free runs on runs (blocks) left out, recordings and withheld effects.

Run: ``OMP_NUM_THREADS=1 SKSURROGATE_DATA=FOLDER python tests/benchmarks/bench_hybrids.py [--forms output static ...]
[--cases N] [--first K] [--skip-recordings]``. A recording of several runs is split into even and odd runs, one of a single run into halves; each
half is predicted by a hybrid that was fitted to the other, from its first rows. The synthetic cases are those of
``sksurrogate.blind``: the hybrid learns from the recorded runs and predicts the test runs. Ratios: RMSE of the hybrid over that of
the simulator from the same first rows, as it starts by itself and from the initial states that the hybrid finds; those rows left out.
"""

import argparse
import time
import warnings

import numpy as np
from recordings import NAMES, problem

from sksurrogate.blind import draw
from sksurrogate.compose import HybridRegressor
from sksurrogate.compose._hybrid_output import simulate_runs

#: One of each kind of gap: none, one effect, two, a region, three, forms that no catalogue holds, parameters off.
ARMS = ("effect", "none", "two", "outside", "inexact", "three")


def halves(one):
    """Two sets of runs, each a list of (U, y)."""
    labels = np.unique(one.groups)
    if len(labels) > 1:
        runs = [(one.X[one.groups == k], one.y[one.groups == k]) for k in labels]
        return runs[::2], runs[1::2]
    cut = len(one.y) // 2
    return [(one.X[:cut], one.y[:cut])], [(one.X[cut:], one.y[cut:])]


def errors(simulator, form, train, test, **more):
    """RMSE of simulator (also from the hybrid's initial states) and hybrid over the outputs' deviation, share kept, seconds."""
    started = time.process_time()
    groups = np.repeat(np.arange(len(train)), [len(U) for U, _ in train])
    hybrid = HybridRegressor(simulator, form=form, **more)
    hybrid.fit(np.concatenate([U for U, _ in train]), np.concatenate([y for _, y in train]), groups=groups)
    seconds = time.process_time() - started
    n, o = hybrid.n_initial_, train[0][1].shape[1]
    size = np.std(np.concatenate([y for _, y in test]), axis=0) + 1e-300
    given = simulator, [U for U, _ in test], [y[:n] for _, y in test], o
    alone, started_alike = simulate_runs(*given), simulate_runs(*given, getattr(hybrid.correction_, "starts", None))
    groups = np.repeat(np.arange(len(test)), [len(U) for U, _ in test])
    first = np.stack([y[:n] for _, y in test])
    found = hybrid.predict(np.concatenate([U for U, _ in test]), y0=first, groups=groups).reshape(-1, o)
    ends = np.cumsum([len(U) for U, _ in test])[:-1]
    before, alike, after = (
        np.sqrt(np.mean(np.concatenate([(p - y)[n:] for p, (_, y) in zip(parts, test)]) ** 2 / size**2))
        for parts in (alone, started_alike, np.split(found, ends))
    )
    return float(before), float(alike), float(after), hybrid.shrinkage_, seconds


def synthetic(seed):
    """A case of the check on withheld effects: simulator, training runs, test runs."""
    case = draw(ARMS[seed % len(ARMS)], 900 + seed)
    q = case.question
    train = [(q.X[q.groups == k], q.y[q.groups == k].reshape(-1, len(case.scale))) for k in np.unique(q.groups)]
    rng = np.random.default_rng(seed)
    noisy = case.y_test + case.noise * rng.normal(size=case.y_test.shape)
    return case.facts["plant"], q.simulator, train, list(zip(q.X_test, noisy))


def main():
    """Print one line a fit, and the worst and median ratio of each form."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--forms", nargs="+", default=["output"])
    parser.add_argument("--cases", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--names", nargs="*", default=list(NAMES))
    parser.add_argument("--skip-recordings", action="store_true")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    questions = []
    for name in () if options.skip_recordings else options.names:
        one = problem(name)
        a, b = halves(one)
        questions += [(f"{name} 1", one.simulator, a, b), (f"{name} 2", one.simulator, b, a)]
    for seed in range(options.first, options.first + options.cases):
        name, simulator, train, test = synthetic(seed)
        questions.append((f"{seed} {ARMS[seed % len(ARMS)]} {name}", simulator, train, test))
    for form in options.forms:
        ratios = []
        for name, simulator, train, test in questions:
            try:
                before, alike, after, share, seconds = errors(simulator, form, train, test)
            except Exception as error:
                print(f"{form} | {name} | {type(error).__name__}: {str(error)[:160]}", flush=True)
                continue
            ratios.append((after / before, after / alike))
            print(
                f"{form} | {name} | {before:.3f} | {after / before:.3f} | {after / alike:.3f} | {np.round(share, 2)} | {seconds:.1f} s",
                flush=True,
            )
        table = np.array(ratios)
        median, worst = np.median(table, axis=0).round(3), np.sort(table, axis=0)[-3:].T.round(3)
        print(f"{form}: {len(table)} fits, median ratios {median}, largest {worst.tolist()}")


if __name__ == "__main__":
    main()
