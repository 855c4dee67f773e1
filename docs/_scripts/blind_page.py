"""Write the tables of docs/blind_check.md from stored rows: ``python docs/_scripts/blind_page.py``."""

from __future__ import annotations

import json
from pathlib import Path

from sksurrogate.blind import BlindResult
from sksurrogate.blind._table import table

DOCS = Path(__file__).parents[1]
BEGIN, END = "<!-- figures: begin -->", "<!-- figures: end -->"


def figures() -> str:
    """All tables as markdown."""
    result = BlindResult.load(DOCS / "blind_rows.jsonl")
    truths = sum(len(row.get("truths", [])) for row in result.rows)
    parts = [
        f"{len(result.rows)} cases with {truths} effects, {sum(bool(r.get('right')) for r in result.rows)} right.",
        table(result.scores()),
        "Stated probabilities:", table(result.calibration()),
        "By excitation:", table(result.scores("excitation")),
        "Failures by kind:",
        table([{"failure": kind, "count": len(rows), "for example": _example(rows[0])} for kind, rows in result.failures()]),
    ]  # fmt: skip
    baselines = DOCS / "blind_baselines.jsonl"
    if baselines.exists():
        parts += ["Baselines, on earlier cases:", table(BlindResult.load(baselines).scores("diagnosis"))]
    recorded = DOCS / "blind_recorded.jsonl"
    if recorded.exists():
        rows = [json.loads(line) for line in recorded.read_text(encoding="utf-8").splitlines()]
        keys = ("recording", "verdict", "named", "place", "right", "before", "after", "unit", "published")
        text = [{key: _text(row.get(key, row.get("error", ""))) for key in keys} for row in rows]
        parts += ["Real recordings, free run on the official test record, RMSE:", table(text)]
    return "\n\n".join(parts)


def _example(row: dict) -> str:
    from sksurrogate.blind._table import example

    return example(row)


def _text(value: object) -> str:
    return ", ".join(f"{v:.3g}" for v in value) if isinstance(value, list) else str(value)


if __name__ == "__main__":
    page = DOCS / "blind_check.md"
    before, rest = page.read_text(encoding="utf-8").split(BEGIN)
    page.write_text(f"{before}{BEGIN}\n\n{figures()}\n\n{END}{rest.split(END)[1]}", encoding="utf-8")
