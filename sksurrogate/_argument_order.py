"""The order of a command line: simulator and data may stand anywhere, behind an option with many values too."""

from __future__ import annotations

from collections.abc import Sequence

#: Options that take all values behind them; those that take none.
MANY = (
    "--free",
    "--exclude",
    "--plausible",
    "--effects",
    "--bounds",
    "--prior",
    "--columns",
    "--json",
    "--readings",
    "--commands",
)
FLAGS = ("--quiet", "-h", "--help")
#: How names of data files end.
DATA = (".csv", ".tsv", ".txt", ".dat", ".npz", ".mcap")


def positionals_first(argv: Sequence[str]) -> list[str]:
    """Arguments of ``diagnose`` with the simulator and the data before the options; other commands stay as they are.

    >>> positionals_first(["diagnose", "--free", "k", "c", "plant.py:plant", "data.csv", "--run", "r"])
    ['diagnose', 'plant.py:plant', 'data.csv', '--free', 'k', 'c', '--run', 'r']
    """
    if not argv or argv[0] != "diagnose":
        return list(argv)
    found: list[str] = []
    rest: list[str] = []
    option = ""
    for word in argv[1:]:
        if word.startswith("-") and not _is_number(word):
            option = "" if word in FLAGS or "=" in word else word
            rest.append(word)
        elif option in MANY and not _is_place(word):
            rest.append(word)
        elif option and option not in MANY:
            rest.append(word)
            option = ""
        else:
            found.append(word)
    return ["diagnose", *found, *rest]


def _is_place(word: str) -> bool:
    """Whether a word names a simulator in a file, or a file of data."""
    return ".py:" in word or word.lower().endswith(DATA)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
