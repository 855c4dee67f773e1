"""Rows to tables, and to one page."""

from __future__ import annotations

import html
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate._files import write_text
from sksurrogate.blind import _summaries
from sksurrogate.blind._cases import ARMS
from sksurrogate.blind._criteria import PROMISES, TARGETS, judged
from sksurrogate.blind._pictures import embedded, missing_terms, overview
from sksurrogate.blind._probabilities import name_stated
from sksurrogate.blind._robot_arms import ROBOT_ARMS
from sksurrogate.exceptions import DataError

Row = Mapping[str, Any]

#: Arms whose gap is about as large as the noise: no shares of it are given.
SMALL_GAP_ARMS = ("weak", "sizes")


@dataclass(frozen=True)
class BlindResult:
    """Scored cases.

    Attributes
    ----------
    rows : tuple of dict
        See :func:`sksurrogate.blind._score.score`.
    complete : bool
        False after an interrupt.

    Examples
    --------
    >>> from sksurrogate.blind import run_blind_check
    >>> result = run_blind_check(2, ["none"], seed=0)   # doctest: +SKIP
    >>> print(result.to_markdown())   # doctest: +SKIP
    """

    rows: tuple[Row, ...]
    complete: bool = True

    @classmethod
    def load(cls, path: Any) -> BlindResult:
        """From a file of rows (JSON lines).

        Raises
        ------
        DataError
            The file is not there or holds other lines.
        """
        if not Path(path).is_file():
            raise DataError(
                f"path={str(path)!r}: there is no such file in {Path.cwd()}; name the one that resume= of run_blind_check wrote."
            )
        rows = stored_rows(path)
        if not rows:
            raise DataError(
                f"path={str(path)!r} holds no row of a blind check (JSON lines); name the file that resume= of run_blind_check wrote."
            )
        return cls(tuple(rows))

    def scores(self, by: str = "arm") -> list[dict[str, Any]]:
        """One row of scores for each value of a column.

        Parameters
        ----------
        by : str, default="arm"
            Any column of the rows: "arm", "plant", "excitation", "sensors", "noise", "n_runs".

        Returns
        -------
        list of dict
            by, cases, right, named (share of true effects named up to twins), false (cases explained with a false name),
            place (up to exact twins), own place, class (mean size), covered (share of 90 % intervals that hold the truth),
            shrink, oracle (medians), seconds (median), calls (median), failed (no answer), region (mean F1), edge (median
            error of a limit, in standard deviations of its signal), moment (median error of a time, in lengths of the
            run), shape (median correlation of the missing term with the true one).
        """
        order = [*ARMS, *ROBOT_ARMS] if by == "arm" else sorted({str(row.get(by)) for row in self.rows})
        groups = [(name, [row for row in self.rows if str(row.get(by)) == name]) for name in order]
        return [{by: name, **summary(rows)} for name, rows in groups if rows]

    def calibration(self, edges: Sequence[float] = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)) -> list[dict[str, Any]]:
        """Stated probabilities against how often the very name was true: low, high, count, stated (mean), right (share)."""
        stated = [pair for row in self.rows if "error" not in row for pair in name_stated(row)]
        found = []
        for low, high in zip(edges[:-1], edges[1:]):
            inside = [(p, t) for p, t in stated if low <= p < high or (high == edges[-1] and p == high)]
            if inside:
                mean = float(np.mean([p for p, _ in inside]))
                share = float(np.mean([t for _, t in inside]))
                found.append({"low": low, "high": high, "count": len(inside), "stated": mean, "right": share})
        return found

    def failures(self, kind: str | None = None) -> list[tuple[str, list[Row]]]:
        """Wrong rows by kind of failure, most frequent first."""
        groups: dict[str, list[Row]] = {}
        for row in self.rows:
            label = failure(row)
            if label is not None and (kind is None or kind == label):
                groups.setdefault(label, []).append(row)
        return sorted(groups.items(), key=lambda item: -len(item[1]))

    def bars(self) -> list[dict[str, Any]]:
        """Figures beside the bars to be cleared: question, bar, figure, cases, low, high (90 %), cleared."""
        return judged(TARGETS, self.rows)

    def promises(self) -> list[dict[str, Any]]:
        """What a diagnosis promises: question, bar, figure, cases, low, high (90 %), cleared."""
        return judged(PROMISES, self.rows)

    def detection(self) -> list[dict[str, Any]]:
        """Share of true effects in the class named over bins of the gap in units of the noise; arms with one effect."""
        return _summaries.detection(self.rows)

    def unknown(self) -> list[dict[str, Any]]:
        """Recall and precision of the answer "unknown", and its place."""
        return _summaries.unknown_scores(self.rows)

    def experiments(self) -> list[dict[str, Any]]:
        """What the suggested next experiment was worth, beside the first run recorded once more."""
        return _summaries.experiments(self.rows)

    def misses(self) -> list[dict[str, Any]]:
        """Every missed case, grouped by kind; right names at another place stand at the end."""
        away = _summaries.misplaced(self.rows)
        return _summaries.misses([*self.failures(), ("right, but another likely place", away)])

    def kinds(self) -> list[dict[str, Any]]:
        """Kinds of failures: failure, count, for example."""
        return [{"failure": kind, "count": len(r), "for example": example(r[0])} for kind, r in self.failures()]

    def sections(self) -> list[tuple[str, list[dict[str, Any]]]]:
        """Titles and tables of the whole answer."""
        found = [
            ("What a diagnosis promises", self.promises()), ("By arm", self.scores()), ("Bars", self.bars()), ("Detection over the size of the gap", self.detection()),
            ("Unknown", self.unknown()), ("Stated probabilities", self.calibration()),
            ("The suggested next experiment", self.experiments()), ("Failures by kind", self.kinds()),
        ]  # fmt: skip
        return [(title, rows) for title, rows in found if rows]

    def to_markdown(self) -> str:
        """Tables: promises, by arm, bars, detection, unknown, probabilities, experiments, failures."""
        parts = [f"{title}\n\n{table(rows)}" for title, rows in self.sections()]
        return "\n\n".join([f"{len(self.rows)} cases", *parts]) + "\n"

    def to_html(self, path: Any = None) -> str:
        """One self-contained page; written to ``path`` where given. Figures need the extra ``plot``."""
        more = [
            ("By excitation", self.scores("excitation")), ("By plant", self.scores("plant")),
            ("By sensors", self.scores("sensors")), ("By number of runs", self.scores("n_runs")),
            ("By noise", self.scores("noise")), ("All missed cases", self.misses()),
        ]  # fmt: skip
        body = "".join(f"<h2>{title}</h2>{_html_table(rows)}" for title, rows in [*self.sections(), *more] if rows)
        texts = ("share of right answers, detection, calibration, shrink", "missing terms as learned and as they are")
        figures = (overview(self), missing_terms(self.rows))
        picture = "".join(
            f'<p><img alt="{text}" src="data:image/png;base64,{embedded(figure)}"></p>'
            for text, figure in zip(texts, figures)
            if figure is not None
        )
        page = (
            '<!doctype html><html lang="en"><meta charset="utf-8"><title>Check on withheld effects</title><style>'
            "body{font:15px/1.45 system-ui,sans-serif;max-width:1300px;margin:2em auto;padding:0 1em;color:#222}"
            "table{border-collapse:collapse;margin:.6em 0;display:block;overflow-x:auto;font-size:13px}td,th{padding:.2em .5em;border-bottom:1px solid #ddd;"
            "text-align:right;vertical-align:top}td:first-child,th:first-child,td.t{text-align:left}img{max-width:100%}"
            f"</style><h1>Check on withheld effects</h1><p>{len(self.rows)} cases.</p>{picture}{body}</html>\n"
        )
        if path is not None:
            write_text(path, page)
        return page

    def __str__(self) -> str:
        return self.to_markdown()

    def __repr__(self) -> str:
        return f"BlindResult({len(self.rows)} cases, {sum(bool(row.get('right')) for row in self.rows)} right)"

    def _repr_html_(self) -> str:
        return _html_table(self.scores())


#: Keys of rows that were stored earlier, and what they are called now.
FORMER_KEYS = {"accused": "likely_place", "abreast": "cases_at_once"}


def stored_rows(path: Any) -> list[dict[str, Any]]:
    """Rows of a file; a line that was broken off is left out, and a case that two processes have answered counts once."""
    rows, seen = [], set()
    if path is not None and Path(path).exists():
        try:
            lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
        except UnicodeDecodeError as error:
            raise DataError(f"{str(path)!r} is no file of rows ({error}): name another one.") from error
        for text in lines:
            try:
                row = json.loads(text)
            except (ValueError, RecursionError):
                continue
            if isinstance(row, dict) and {"arm", "seed"} <= row.keys():
                case = tuple(row.get(key) for key in ("arm", "seed", "diagnosis", "simulator", "record"))
                if case not in seen or row.get("seed") is None:
                    rows.append({FORMER_KEYS.get(str(key), str(key)): value for key, value in row.items()})
                seen.add(case)
    return rows


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Scores of some rows."""
    answered = [row for row in rows if "error" not in row]

    def mean(values: Iterable[Any]) -> float:
        given = [float(value) for value in values if value is not None]
        return float(np.mean(given)) if given else float("nan")

    def median(values: Iterable[Any]) -> float:
        given = [float(value) for value in values if value is not None]
        return float(np.median(given)) if given else float("nan")

    sought = [row for row in answered if row["truths"] and row["expected"] in ("explained", "either")]
    n_truths = sum(len(row["truths"]) for row in sought)
    return {
        "cases": len(rows),
        "right": mean(bool(row.get("right")) for row in rows if row.get("right") is not None),
        "named": sum(row["named"] for row in sought) / n_truths if n_truths else float("nan"),
        "false": mean(row["false_names"] > 0 and row["verdict"] == "explained" for row in answered),
        "place": mean(
            _summaries.place_up_to_twins(row) if row["expected"] != "none" else row["place"] for row in answered
        ),
        "own place": mean(row["place"] for row in answered),
        "class": mean(size for row in answered for size in row["classes"]),
        "covered": mean(value for row in answered for value in row["covered"]),
        "shrink": median(row["shrink"] for row in answered if row["arm"] not in SMALL_GAP_ARMS),
        "oracle": median(row["oracle"] for row in answered if row["arm"] not in SMALL_GAP_ARMS),
        "region": mean(row.get("region_f1") for row in answered),
        "edge": median(row.get("edge_error") for row in answered),
        "moment": median(row.get("time_error") for row in answered),
        "shape": median(row.get("shape") for row in answered),
        "seconds": median(row["seconds"] for row in answered),
        "calls": median(row["calls"] for row in answered),
        "failed": len(rows) - len(answered),
    }


def failure(row: Row) -> str | None:
    """What kind of failure a row is; None where it is right."""
    if "error" in row:
        return "no case drawn" if str(row["error"]).startswith("not drawn") else "no answer"
    if row["right"]:
        return None
    expected, said = row["expected"], row["verdict"]
    if expected == "none":
        return "a name where there is nothing" if row["effects"] else f"{said} where there is nothing"
    if expected == "unknown":
        if row.get("imitated"):
            return "unknown effect imitated by names that predict it"
        return f"{said} where it should be unknown"
    if row.get("gap_beyond_retuning", 4.0) < 4.0 and not row["named"]:
        return "an effect that re-tuning imitates"
    if row["named"] == len(row["truths"]):
        return "right names and a false one beside them" if row["false_names"] else f"right names, but said {said}"
    if row["named"]:
        return "one of two effects found" + (", and a false name" if row["false_names"] else "")
    return "another name instead" if row["effects"] else f"not named, said {said}"


def example(row: Row) -> str:
    """A failure in a line."""
    if "error" in row:
        return f"{row['arm']} {row['seed']}: {row['error']}"
    truths = [f"{t['name']} at {t['location']}" for t in row["truths"]]
    named = [f"{e['name']} at {e['location']}" for e in row["effects"]]
    return f"{row['plant']}, arm {row['arm']}, seed {row['seed']}: {' + '.join(truths) or 'nothing'} became {' + '.join(named) or row['verdict']}"


def cell(value: Any) -> str:
    """Text of a value."""
    if isinstance(value, (float, np.floating)):
        return "" if not np.isfinite(value) else f"{value:.3g}"
    return str(value)


def table(rows: Sequence[Row]) -> str:
    """A markdown table."""
    if not rows:
        return "(none)"
    head = list(rows[0])
    lines = [head, ["---"] * len(head), *([cell(row[key]) for key in head] for row in rows)]
    return "\n".join("| " + " | ".join(parts) + " |" for parts in lines)


def _html_table(rows: Sequence[Row]) -> str:
    """An HTML table."""
    if not rows:
        return "<p>(none)</p>"
    head = "".join(f"<th>{html.escape(str(key))}</th>" for key in rows[0])
    body = "".join(
        "<tr>"
        + "".join(
            f"<td{' class=t' if isinstance(value, str) else ''}>{html.escape(cell(value))}</td>"
            for value in row.values()
        )
        + "</tr>"
        for row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"
