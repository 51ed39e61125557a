"""Words of messages: the nearest known one, plain ones, plurals."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

_LIKE = 0.65
"""Likeness, up to 1, from which a known word is named: those of `edges` and `nodes` are 0.6."""


def nearest(word: str, known: Iterable[str]) -> str:
    """The part of a message between an unknown word and what was expected: the nearest known."""
    letters = {re.sub(r"[\W_]", "", name.lower()): name for name in known}
    near = difflib.get_close_matches(re.sub(r"[\W_]", "", word.lower()), letters, 1, _LIKE)
    return f", did you mean {letters[near[0]]!r}?" if near else ","


def counted(number: int, noun: str) -> str:
    """A number of things whose plural ends in s, as in ``1 episode``."""
    return f"{number} {noun}{'s' * (number != 1)}"


_UNKNOWN = re.compile(
    r"(?P<about>(?:found|unknown field|unknown variant) (?P<mark>[`'\"]?)(?P<word>[^\s,`'\"]+)"
    r"(?P=mark)), expected (?P<known>.+)"
)
"""Part of a message that has an unknown word, and what was expected in its place."""
_PLAIN = [
    (re.compile(pattern), words)
    for pattern, words in (
        (r"invalid (?:type|value): ", "found "),
        (r"\b(found|expected) (?:a )?sequence\b", r"\1 a list"),
        (r"\b(found|expected) (?:a )?map\b", r"\1 a mapping"),
        (r"\bexpected struct \w+", "expected a mapping"),
        (r"\bexpected usize\b|\bexpected u\d+\b", "expected a whole number from 0"),
        (r"\bexpected f\d+\b", "expected a number"),
    )
]
"""Words of serde in Rust, and what stands in their place."""
_NUMBER = re.compile(r"[-+.\d]+(e[-+]?\d+)?")
"""A word that is no misspelt other one."""
_NAME = re.compile(r"[\w-]+")
_OF_NO_LIST = ("none", "nothing", "one", "other", "another")
"""Words of sentences that stand where a list may stand."""
_BETWEEN = re.compile(r"one or more of |,? or |, |: |of | for |channels ")
"""Text between the words of a list."""


def plain_words(message: str) -> str:
    """A message without the words of serde, with the nearest known word if it names an unknown one.

    The native layer calls it for the text of each ``ValueError``.
    """

    def hinted(found: re.Match[str]) -> str:
        words = [word.strip("`'\"") for word in _BETWEEN.split(found["known"])]
        known = [word for word in words if _NAME.fullmatch(word) and word not in _OF_NO_LIST]
        word = found["word"]
        hint = "," if word in known or _NUMBER.fullmatch(word) else nearest(word, known)
        return f"{found['about']}{hint} expected {found['known']}"

    for pattern, words in _PLAIN:
        message = pattern.sub(words, message)
    return _UNKNOWN.sub(hinted, message)
