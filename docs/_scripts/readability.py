"""Readability of the pages: ``python docs/_scripts/readability.py [FILE ...]``.

Reading ease: 206.835 - 1.015 words a sentence - 84.6 syllables a word (R. Flesch, *A new readability yardstick*, Journal of
Applied Psychology 32 (1948), 221-233). Grade: 0.39 words a sentence + 11.8 syllables a word - 15.59 (Kincaid and others,
1975). Code, tables and link targets are left out; syllables are counted as groups of vowels.
"""

import re
import sys
from pathlib import Path

DOCS = Path(__file__).parents[1]


def prose(text: str) -> str:
    """Sentences of a page without code, tables, directives and marks."""
    text = re.sub(r"```.*?```|<!--.*?-->", " ", text, flags=re.S)
    lines = [line for line in text.splitlines() if not line.lstrip().startswith(("|", "#", "!", ">>>"))]
    text = re.sub(r"`[^`]*`|\]\([^)]*\)|[*_\[\]]", " ", "\n".join(lines))
    return re.sub(r"\n\s*\n|\n- ", ". ", text)


def syllables(word: str) -> int:
    """Groups of vowels, a silent e at the end left out."""
    return max(1, len(re.findall(r"[aeiouy]+", re.sub(r"(?<=[^aeiouyl])e$", "", word.lower()))))


def ease(text: str) -> tuple[float, float, float]:
    """Reading ease, Kincaid's grade, and words a sentence."""
    sentences = [re.findall(r"[A-Za-z][A-Za-z'-]*", part) for part in re.split(r"[.!?:;]\s", prose(text))]
    sentences = [words for words in sentences if len(words) > 1]
    words = [word for sentence in sentences for word in sentence]
    length, spoken = len(words) / len(sentences), sum(map(syllables, words)) / len(words)
    return 206.835 - 1.015 * length - 84.6 * spoken, 0.39 * length + 11.8 * spoken - 15.59, length


def line(name: str, text: str) -> str:
    """One line of the table."""
    return "{:35s} {:6.1f} {:6.1f} {:6.1f}".format(name, *ease(text))


if __name__ == "__main__":
    files = [Path(name) for name in sys.argv[1:]] or [DOCS.parent / "README.md", *sorted(DOCS.glob("*.md"))]
    texts = {path: path.read_text() for path in files if len(prose(path.read_text()).split()) > 50}
    print(f"{'':35s}   ease  grade  words a sentence")
    print("\n".join(line(path.name, text) for path, text in texts.items()))
    print(line("all pages", "\n\n".join(texts.values())))
