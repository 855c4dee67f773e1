"""Write the tables and figures of docs/blind_check.md from stored rows: ``python docs/_scripts/blind_page.py``.

With ``--complete``, detuned rows without the gap beyond re-tuning get it first (their cases are drawn once more: seconds each).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sksurrogate.blind import BlindResult
from sksurrogate.blind._pictures import missing_terms, overview, recorded_terms
from sksurrogate.blind._retune import with_retuning
from sksurrogate.blind._table import table

DOCS = Path(__file__).parents[1]
BEGIN, END = "<!-- figures: begin -->", "<!-- figures: end -->"
#: Newest commits that are told together.
RECENT = 3
MISSES = ("<!-- misses: begin -->", "<!-- misses: end -->")


def figures() -> str:
    """All tables and figures as markdown."""
    result = BlindResult.load(DOCS / "blind_rows.jsonl")
    truths = sum(len(row.get("truths", [])) for row in result.rows)
    known = [row for row in result.rows if row.get("truths") is not None]
    names = {t["name"] for row in known for t in row["truths"]}
    plants = {row["plant"] for row in known}
    parts = [
        f"{len(result.rows)} cases on {len(plants)} plants with {truths} effects ({len(names)} different ones), "
        f"{sum(bool(r.get('right')) for r in result.rows)} right.",
        *_bars(result),
        "### By arm", table(result.scores()),
        *picture(overview(result), "blind_scores", "Right answers by arm, detection, probabilities, shrink"),
        "### Detection over the size of the gap", DETECTION, table(result.detection()),
        "### Unknown", table(result.unknown()),
        *picture(missing_terms(result.rows), "blind_missing", "Missing terms as learned and as they are"),
        "### Stated probabilities", table(result.calibration()),
        "### The suggested next experiment", EXPERIMENT, table(result.experiments()),
        "### By excitation", table(result.scores("excitation")),
        "### By plant", table(result.scores("plant")),
        *_baselines(result), *_recorded(),
    ]  # fmt: skip
    return "\n\n".join(parts)


def _bars(result: BlindResult) -> list[str]:
    """The bars: of the rows that the newest code answered, and of all; rows tell their code where several are stored."""
    codes = list(dict.fromkeys(row.get("code", "") for row in result.rows))
    if len(codes) == 1:
        return ["### The bars", BARS, table(result.bars())]
    parts = ["### The bars", BARS]
    for chosen, said in (
        (codes[-1:], "Commit"),
        (codes[-RECENT:], "The newest commits together, misses mended between them,"),
    ):
        some = BlindResult(tuple(row for row in result.rows if row.get("code", "") in chosen))
        right = sum(bool(row.get("right")) for row in some.rows)
        parts += [f"{said} {', '.join(chosen)}: {len(some.rows)} cases, {right} right.", table(some.bars())]
    return [
        *parts,
        f"All {len(result.rows)} cases, commits {', '.join(codes)}; the tables after this one are of all.", table(result.bars()),
    ]  # fmt: skip


BARS = (
    "Low and high are 90 % limits (Wilson's for shares, order statistics for medians). Open: the limits hold the bar between "
    "them, more cases would tell."
)
DETECTION = (
    "Arms with one effect. The gap is the root mean square of what the effect moves the measured outputs by, in units of "
    "their noise."
)
EXPERIMENT = (
    "Where names were tied, the experiment that the report suggests was carried out on the true plant and its run added to "
    "the data; the tied names were asked again. The control is the first run recorded once more. The lead is the log "
    "likelihood of the true effect over that of the best other member of its class."
)


def picture(figure: Any, name: str, text: str) -> list[str]:
    """Store a figure and refer to it; nothing where there is none."""
    if figure is None:
        return []
    figure.savefig(DOCS / "_static" / f"{name}.png", dpi=100)
    return [f"![{text}](_static/{name}.png)"]


def _baselines(result: BlindResult) -> list[str]:
    """Simpler ways on the same cases, beside the diagnosis on them."""
    stored = DOCS / "blind_baselines.jsonl"
    if not stored.exists():
        return []
    others = BlindResult.load(stored)
    asked = {(row["arm"], row["seed"]) for row in others.rows}
    same = [row for row in result.rows if (row["arm"], row["seed"]) in asked]
    lines = []
    for row in BlindResult((*others.rows, *same)).scores("diagnosis"):
        lines.append({**row, "diagnosis": row["diagnosis"].rpartition(":")[2]})
    head = f"The same {len(asked)} cases." if same else "On other cases."
    return ["### Baselines", head, table(lines)]


def _recorded() -> list[str]:
    """Real recordings."""
    stored = DOCS / "blind_recorded.jsonl"
    if not stored.exists():
        return []
    rows = [json.loads(line) for line in stored.read_text(encoding="utf-8").splitlines()]
    keys = ("recording", "verdict", "named", "place", "right", "before", "retuned", "after", "unit", "published")
    text = [{key: _text(row.get(key, row.get("error", ""))) for key in keys} for row in rows]
    drawn = picture(recorded_terms(rows), "blind_recorded", "Learned from real recordings without the name")
    return ["### Real recordings", "Free run on the official test record, RMSE.", table(text), *drawn]


def _text(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(f"{v:.3g}" for v in value) or "-"
    return "-" if value in (None, "") else str(value)


def misses() -> str:
    """Every missed case, grouped by kind."""
    lines: list[Mapping[str, Any]] = BlindResult.load(DOCS / "blind_rows.jsonl").misses()
    return f"{len(lines)} cases.\n\n{table(lines)}"


def written(text: str, between: tuple[str, str], new: str) -> str:
    """The page with what stands between two marks replaced."""
    before, rest = text.split(between[0])
    return f"{before}{between[0]}\n\n{new}\n\n{between[1]}{rest.split(between[1])[1]}"


def complete() -> None:
    """Rows that were stored before the gap beyond re-tuning was told get it; their cases are drawn once more."""
    path = DOCS / "blind_rows.jsonl"
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    path.write_text("".join(json.dumps(with_retuning(row)) + "\n" for row in rows), encoding="utf-8")


if __name__ == "__main__":
    if "--complete" in sys.argv:
        complete()
    page = DOCS / "blind_check.md"
    text = written(page.read_text(encoding="utf-8"), (BEGIN, END), figures())
    page.write_text(written(text, MISSES, misses()), encoding="utf-8")
