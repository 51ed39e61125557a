"""Hooks of mkdocs for the pages of the site: lines break where a reader would break them."""

from __future__ import annotations

import html
import re
from typing import Any

PARTS = re.compile(r"(<pre.*?</pre>|<code[^>]*>[^<]*</code>|<[^>]*>)", re.DOTALL)
"""Tags, preformatted blocks, and code within a line."""
WORD = re.compile(r"[^\s<>]+(?![^<]*>)")
LONGEST = 24
"""Letters of the longest word of code that a phone has room for."""


def on_page_content(content: str, **_: Any) -> str:
    """Keep a number with its per cent sign, and words of code such as ``--out`` in one line."""
    return "".join(fitted(part) for part in PARTS.split(content))


def fitted(part: str) -> str:
    """A part of a page that breaks at spaces alone."""
    if part.startswith("<code"):
        return WORD.sub(lambda word: whole(word[0]), part)
    return part if part.startswith("<") else re.sub(r"(?<=\d) (?=%)", "\N{NO-BREAK SPACE}", part)


def whole(word: str) -> str:
    """A word of code that does not break at its hyphens, points and brackets."""
    if len(html.unescape(word)) > LONGEST or not re.search(r"[-./\[?]", word):
        return word
    return f'<span class="whole">{word}</span>'
