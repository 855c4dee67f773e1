"""Write the table of docs/verdict_rules.md from the rules: ``python docs/_scripts/verdict_page.py``."""

from pathlib import Path

from sksurrogate.gap.decide._rules import RULES

PAGE = Path(__file__).parents[1] / "verdict_rules.md"
HEADING = "## The rules in their order\n"


def table() -> str:
    """The rules as a table: the first that applies decides."""
    rows = [f"| {k} | `{rule.name}` | `{rule.verdict}` | {rule.sentence} |" for k, rule in enumerate(RULES, 1)]
    return "\n".join(
        ["The first rule that applies decides. `report.reasons` gives its name and its numbers. The *correction* is all named effects",
         "and re-tuned parameters.", "",
         "| | rule | verdict | meaning |", "| --- | --- | --- | --- |", *rows, ""]
    )  # fmt: skip


def page(text: str) -> str:
    """The page with its table as the rules are now; the table is its last section."""
    return text.split(HEADING)[0] + HEADING + "\n" + table()


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
