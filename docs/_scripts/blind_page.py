"""Write the tables of docs/blind_check.md, docs/blind_appendix.md and docs/blind_tables.md from stored rows.

``python docs/_scripts/blind_page.py``. With ``--complete``, detuned rows without the gap beyond re-tuning get it first (their
cases are drawn again: seconds each).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sksurrogate.blind import BlindResult
from sksurrogate.blind._criteria import probabilities
from sksurrogate.blind._pictures import missing_terms, overview, recorded_terms, reliability
from sksurrogate.blind._retune import with_retuning
from sksurrogate.blind._table import table

DOCS = Path(__file__).parents[1]
#: Newest commits whose cases are counted together.
RECENT = 3
WITHHELD = " (withheld)"
#: Columns of the table of an arm, an excitation or a plant.
COLUMNS = ("cases", "right", "named", "false", "place", "class", "covered", "shrink", "oracle")

Row = Mapping[str, Any]


def commits(result: BlindResult) -> list[str]:
    """Commits that answered, oldest first."""
    return list(dict.fromkeys(row.get("code", "") for row in result.rows))


def newest(result: BlindResult) -> BlindResult:
    """Cases that the newest commits answered."""
    chosen = commits(result)[-RECENT:]
    return BlindResult(tuple(row for row in result.rows if row.get("code", "") in chosen))


def short(rows: Iterable[Row], by: str, columns: Sequence[str] = COLUMNS) -> str:
    """A table of some columns of the scores."""
    return table([{key: row[key] for key in (by, *columns)} for row in rows])


def count(result: BlindResult) -> str:
    """Cases, plants, effects and right answers in one line."""
    known = [row for row in result.rows if row.get("truths") is not None]
    names = {truth["name"] for row in known for truth in row["truths"]}
    plants = {row["plant"] for row in known}
    some = newest(result)
    right, all_right = (sum(bool(row.get("right")) for row in rows) for rows in (some.rows, result.rows))
    return (
        f"Stored: {len(result.rows)} cases on {len(plants)} plants with {len(names)} different effects, {all_right} right. "
        f"The newest {min(RECENT, len(commits(result)))} commits ({', '.join(commits(result)[-RECENT:])}) "
        f"answered {len(some.rows)} of them, {right} right."
    )


def limits(row: Row | None) -> str:
    """A figure with its 90 % limits and its number of cases."""
    if row is None:
        return "-"
    return f"{row['figure']:.3g} [{row['low']:.3g}, {row['high']:.3g}] of {row['cases']}"


def targets(result: BlindResult) -> str:
    """The targets beside the figures of the newest commits and of all."""
    recent = {row["question"]: row for row in newest(result).bars()}
    return table(
        [
            {"question": row["question"], "target": row["bar"], "newest": limits(recent.get(row["question"])),
             "all": f"{row['figure']:.3g} of {row['cases']}", "newest meets it": recent.get(row["question"], {"cleared": "-"})["cleared"]}
            for row in result.bars()
        ]
    )  # fmt: skip


def promised(rows: Sequence[Row]) -> str:
    """What a diagnosis promises, by the stored cases."""
    seen = BlindResult(tuple(rows))
    lines = [
        {"promise": row["question"], "bar": row["bar"], "figure": limits(row), "kept": row["cleared"]} for row in seen.promises()
    ]  # fmt: skip
    code = " and ".join(commits(seen))
    right = sum(bool(row["right"]) for row in seen.rows)
    head = f"{len(seen.rows)} fresh cases answered by commit {code}, {right} right."
    return f"{head}\n\n{table(lines)}"


def missed(rows: Sequence[Row]) -> str:
    """Every miss of these cases."""
    keep = ("arm", "plant", "truth", "said", "share")
    return table([{key: row[key] for key in keep} for row in BlindResult(tuple(rows)).misses()])


def baselines(result: BlindResult) -> str:
    """Simpler methods on the same cases, beside the diagnosis."""
    others = BlindResult.load(DOCS / "blind_baselines.jsonl")
    asked = {(row["arm"], row["seed"]) for row in others.rows}
    same = [row for row in result.rows if (row["arm"], row["seed"]) in asked]
    lines = [
        {
            "method": row["diagnosis"].rpartition(":")[2],
            **{k: row[k] for k in ("cases", "right", "named", "false", "shrink")},
        }
        for row in BlindResult((*others.rows, *same)).scores("diagnosis")
    ]
    return table(lines).replace("ask_gap_diagnoser", "GapDiagnoser")


def recordings() -> list[Row]:
    """Stored answers on measured records."""
    return [json.loads(line) for line in (DOCS / "blind_recorded.jsonl").read_text(encoding="utf-8").splitlines()]


def recorded(rows: Iterable[Row]) -> str:
    """Answers on measured records: free run on the test record."""
    return table(
        [
            {"recording": f"{row['recording'].removesuffix(WITHHELD)} / {row.get('unit', '')}",
             **{key: text(row.get(key, row.get("error", ""))) for key in ("verdict", "named", "right", "before", "after")}}
            for row in rows
        ]
    )  # fmt: skip


def text(value: object) -> str:
    """A cell: numbers with three digits, yes or no, a dash for nothing."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(f"{v:.3g}" for v in value) or "-"
    return "-" if value in (None, "") else str(value)


def runs(result: BlindResult) -> str:
    """Cases and right answers by commit, newest first."""
    lines = []
    for code in reversed(commits(result)):
        rows = [row for row in result.rows if row.get("code", "") == code]
        lines.append({"commit": code, "cases": len(rows), "right": sum(bool(row.get("right")) for row in rows)})
    return table(lines)


def picture(figure: Any, name: str, words: str) -> str:
    """Store a figure and refer to it; nothing where there is none."""
    if figure is None:
        return ""
    figure.savefig(DOCS / "_static" / f"{name}.png", dpi=100)
    return f"![{words}](_static/{name}.png)"


def parts(result: BlindResult) -> dict[str, str]:
    """Every generated part of the two pages, by the name in its marks."""
    withheld = [row for row in recordings() if row["recording"].endswith(WITHHELD)]
    fresh = BlindResult.load(DOCS / "blind_promises.jsonl").rows
    return {
        "promises": promised(fresh),
        "reliability": picture(
            reliability(probabilities(fresh)),
            "blind_reliability",
            "Stated probability against the share of names that act",
        ),
        "promises missed": missed(fresh),
        "count": count(result),
        "targets": targets(result),
        "arms": short(result.scores(), "arm"),
        "scores": picture(overview(result), "blind_scores", "Right answers by arm, detection, probabilities, shrink"),
        "detection": short(result.detection(), "gap/noise", ("cases", "named", "low", "high", "class")),
        "unknown": table(result.unknown()),
        "calibration": table(result.calibration()),
        "baselines": baselines(result),
        "withheld": recorded(withheld),
        "missing": picture(missing_terms(result.rows), "blind_missing", "Missing terms, estimated and true"),
        "learned": picture(recorded_terms(recordings()), "blind_recorded", "Missing terms on recordings"),
        "experiments": table(result.experiments()),
        "excitations": short(result.scores("excitation"), "excitation"),
        "plants": short(result.scores("plant"), "plant"),
        "kinds": table([{"kind of miss": row["failure"], "cases": row["count"]} for row in result.kinds()]),
        "runs": runs(result),
    }


def written(page: str, new: Mapping[str, str]) -> str:
    """The page with what stands between ``<!-- name: begin -->`` and ``<!-- name: end -->`` replaced."""
    for name, body in new.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        if begin in page:
            before, rest = page.split(begin)
            page = f"{before}{begin}\n\n{body}\n\n{end}{rest.split(end)[1]}"
    return page


def complete() -> None:
    """Rows that were stored without the gap beyond re-tuning get it; their cases are drawn again."""
    path = DOCS / "blind_rows.jsonl"
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    path.write_text("".join(json.dumps(with_retuning(row)) + "\n" for row in rows), encoding="utf-8")


if __name__ == "__main__":
    if "--complete" in sys.argv:
        complete()
    new = parts(BlindResult.load(DOCS / "blind_rows.jsonl"))
    for name in ("blind_check.md", "blind_appendix.md", "blind_tables.md"):
        page = DOCS / name
        page.write_text(written(page.read_text(encoding="utf-8"), new), encoding="utf-8")
