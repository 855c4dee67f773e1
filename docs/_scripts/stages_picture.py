"""Draw docs/_static/stages.svg: ``python docs/_scripts/stages_picture.py``."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
matplotlib.rcParams["svg.hashsalt"] = "stages"
import matplotlib.pyplot as plt  # noqa: E402

STAGES = (
    ("simulator\nand runs", "GapDiagnoser"),
    ("fit", "free run,\nnoise, evidence"),
    ("screen", "which candidates\ndeserve a fit"),
    ("search", "which set\nof effects"),
    ("unnamed", "laws without\na name"),
    ("decide", "posterior, classes,\nheld-out runs, rules"),
    ("render", "report"),
)


def draw(path: Path) -> None:
    """One row of boxes with arrows."""
    figure, ax = plt.subplots(figsize=(11.5, 2.1))
    for k, (name, what) in enumerate(STAGES):
        ax.add_patch(plt.Rectangle((1.6 * k, 0), 1.3, 1.0, facecolor="white", edgecolor="black", linewidth=1.5))
        ax.text(1.6 * k + 0.65, 0.72, name, ha="center", va="center", fontsize=11, fontweight="bold")
        ax.text(1.6 * k + 0.65, 0.28, what, ha="center", va="center", fontsize=8)
        if k:
            ax.annotate("", (1.6 * k, 0.5), (1.6 * k - 0.3, 0.5), arrowprops={"arrowstyle": "->", "linewidth": 1.5})
    ax.set(xlim=(-0.1, 1.6 * len(STAGES) - 0.2), ylim=(-0.1, 1.1))
    ax.axis("off")
    figure.savefig(path, bbox_inches="tight", metadata={"Date": None})


if __name__ == "__main__":
    draw(Path(__file__).parents[1] / "_static" / "stages.svg")
