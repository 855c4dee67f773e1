"""Does a diagnosis tell a fault of the record from a fault of the simulator, and find both where both are there?

    python tests/benchmarks/bench_record_faults.py [--plants cart motor] [--faults spikes hum] [--seed 0]

One line a case: what was wrong, what ``report.data`` says, the verdict and its names.
"""

from __future__ import annotations

import argparse
import time
import warnings

from record_cases import FAULTS, PLANTS, RecordCase, make_case

from sksurrogate.gap import GapDiagnoser


def judged(case: RecordCase, report: object) -> str:
    """``right``, or what is not; a name counts at its place, or where the right one is listed as its equivalent."""
    right = {(name, case.simulator.states[-1]) for name in (case.effect, *case.also)} if case.effect else set()
    own = [(e.name, e.location) for e in report.effects]
    named = [(name, {name, *(tuple(one)[:2] for one in e.equivalents)}) for name, e in zip(own, report.effects)]
    names = [next(iter(alike & right), name) for name, alike in named]
    if case.fault == "nothing":
        fault = not report.data.kinds
    else:
        fault = ("shift" if case.fault == "late_inputs" else case.fault) in report.data.kinds
    wrong = ["@".join(map(str, name)) for name in names if name not in right]
    if case.effect and not set(names) & right:
        wrong.append("effect not named")
    if not case.effect and report.verdict == "unknown":
        wrong.append("unknown")
    return "right" if fault and not wrong else "; ".join(([] if fault else ["fault not given"]) + wrong)


def main() -> None:
    """Run the cases that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plants", nargs="+", default=list(PLANTS))
    parser.add_argument("--faults", nargs="+", default=list(FAULTS))
    parser.add_argument("--effect", choices=["with", "without", "both"], default="both")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--free", action="store_true", help="all parameters of the simulator may differ")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    right = n = 0
    for name in given.plants:
        for fault in given.faults:
            for with_effect in {"with": [True], "without": [False], "both": [False, True]}[given.effect]:
                case = make_case(name, fault, with_effect, given.seed)
                started = time.process_time()
                diagnoser = GapDiagnoser(
                    case.simulator, free_params="all" if given.free else None, n_jobs=1, random_state=0
                )
                report = diagnoser.fit(case.U, case.Y, case.groups).report_
                said = judged(case, report)
                right, n = right + (said == "right"), n + 1
                names = [f"{e.name}@{e.location}" for e in report.effects]
                summary = [
                    f"{f.kind}@{f.location}:{len(f.rows)}r:{f.size:.3g}:{100 * f.share:.0f}%" for f in report.data
                ]
                seconds = time.process_time() - started
                print(f"{case.name:28} {said:24} {report.verdict:9} {names} {summary} {seconds:.1f} s", flush=True)
    print(f"{right} of {n} right")


if __name__ == "__main__":
    main()
