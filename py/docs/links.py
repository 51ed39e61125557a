"""Checks the links of a built site to its own pages, files and anchors.

python py/docs/links.py target/site/html
"""

from __future__ import annotations

import argparse
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """Links and anchors of a page."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(file.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Notes the links and the anchor of an element."""
        for name, value in attrs:
            if value and name in ("href", "src"):
                self.links.append(value)
            elif value and name == "id":
                self.anchors.add(value)


def lost(folder: Path) -> list[str]:
    """Links that lead nowhere, each with the page that it stands on.

    Raises:
        ValueError: If there are no pages.
    """
    pages = {file.resolve(): Page(file) for file in folder.resolve().rglob("*.html")}
    if not pages:
        found = "no .html file" if folder.is_dir() else "no folder"
        raise ValueError(f"{folder}: found {found}, expected a built site")
    wrong = []
    for file, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or file.name == "404.html":
                continue
            end = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            anchor = unquote(parts.fragment)
            found = end.exists() and (
                not anchor or end not in pages or anchor in pages[end].anchors
            )
            if not found:
                wrong.append(f"{file.relative_to(folder.resolve())}: {link}")
    return sorted(set(wrong))


def main() -> None:
    """Prints the links that lead nowhere; exit status 1 if there are any."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path, help="of the built site")
    try:
        missing = lost(parser.parse_args().folder)
    except ValueError as error:
        parser.error(str(error))
    if missing:
        sys.exit("links that lead nowhere:\n" + "\n".join(missing))


if __name__ == "__main__":
    main()
