"""How long does ``import sksurrogate`` take, in processor seconds (other load hardly counts), and what comes along?"""

import os
import statistics
import subprocess
import sys

LINES = {
    "nothing": "pass",
    "import sklearn.linear_model": "import sklearn.linear_model",
    "import sksurrogate": "import sksurrogate",
    "from sksurrogate.gap import GapDiagnoser": "from sksurrogate.gap import GapDiagnoser",
    "sksurrogate --help": "import sksurrogate.cli",
}
COUNT = "; import sys; print(len(sys.modules), *sorted({'torch', 'skorch', 'matplotlib'} & set(sys.modules)))"


def main(repeats: int = 7) -> None:
    """Print the table: medians, interleaved so that other load hits all lines alike."""
    seconds: dict[str, list[float]] = {name: [] for name in LINES}
    loaded: dict[str, str] = {}
    for _ in range(repeats):
        for name, line in LINES.items():
            started = os.times()
            out = subprocess.run([sys.executable, "-c", line + COUNT], check=True, capture_output=True, text=True)
            ended = os.times()
            spent = ended.children_user + ended.children_system - started.children_user - started.children_system
            seconds[name].append(spent)
            loaded[name] = out.stdout.strip()
    bare = statistics.median(seconds["nothing"])
    reference = statistics.median(seconds["import sklearn.linear_model"]) - bare
    print("| line | seconds | over scikit-learn's | ratio | modules |\n| --- | --- | --- | --- | --- |")
    for name in list(LINES)[1:]:
        value = statistics.median(seconds[name]) - bare
        print(f"| `{name}` | {value:.2f} | {value - reference:+.2f} | {value / reference:.2f} | {loaded[name]} |")


if __name__ == "__main__":
    main()
