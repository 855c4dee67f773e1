"""Mistakes in the words of a command, told without the whole usage: the option that was meant, or what is missing."""

from __future__ import annotations

import argparse
import difflib
import sys
from collections.abc import Iterable
from itertools import takewhile
from typing import Any, NoReturn


class CommandParser(argparse.ArgumentParser):
    """A parser that prints no usage before an error, and says which option an unknown one may stand for."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As the base, once every option is a known one: that is said before what is missing for want of it."""
        words = list(sys.argv[1:] if args is None else args)
        own = words if self._subparsers is None else takewhile(lambda word: word.startswith("-"), words)
        if (said := unknown_option(own, self._option_string_actions)) is not None:
            self.error(said)
        known, rest = super().parse_known_args(words, namespace)
        if rest:
            self.error(f"{rest[0]!r} belongs to no option")
        return known, rest

    def error(self, message: str) -> NoReturn:
        """The mistake, where the help is, and exit status 2."""
        self.exit(2, f"sksurrogate: {message}\n{self.prog} --help lists all options.\n")


def unknown_option(words: Iterable[str], options: Iterable[str]) -> str | None:
    """The first option that is none of ``options`` or their beginnings, and the nearest one; None where all are known.

    >>> unknown_option(["plant.py:plant", "--time-limt", "5"], ["--time", "--time-limit"])
    'unknown option --time-limt; did you mean --time-limit?'
    >>> unknown_option(["--time-l=5", "--jobs", "-1"], ["--time", "--time-limit", "--jobs"])
    """
    options = list(options)
    for word in words:
        name = word.partition("=")[0]
        if not _looks_like_an_option(word) or any(option.startswith(name) for option in options):
            continue
        close = difflib.get_close_matches(name, options, n=1)
        return f"unknown option {name}" + (f"; did you mean {close[0]}?" if close else "")
    return None


def _looks_like_an_option(word: str) -> bool:
    """Whether argparse would not take a word for a value."""
    try:
        float(word)
    except ValueError:
        return word.startswith("-") and word.strip("-") != "" and " " not in word
    return False
