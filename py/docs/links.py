"""Checks the links of a built site to its own pages, files and anchors.

python py/docs/links.py target/site/html
python py/docs/links.py target/site/html --external  # and README's and its own to other sites
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from html.parser import HTMLParser
from pathlib import Path
from urllib.error import HTTPError
from urllib.parse import unquote, urlsplit
from urllib.request import Request, urlopen

README = Path(__file__).resolve().parents[2] / "README.md"
OUTSIDE = re.compile(r"\]\((https?://[^)\s]+)\)")
"""Links of Markdown to other sites."""
SECONDS = 20
"""Time that another site has to answer (s)."""


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


def read(folder: Path) -> dict[Path, Page]:
    """Pages of a built site.

    Raises:
        ValueError: If there are none.
    """
    pages = {file.resolve(): Page(file) for file in folder.resolve().rglob("*.html")}
    if not pages:
        found = "no .html file" if folder.is_dir() else "no folder"
        raise ValueError(f"{folder}: found {found}, expected a built site")
    return pages


def lost(folder: Path) -> list[str]:
    """Links that lead nowhere, each with the page that it stands on.

    Raises:
        ValueError: If there are no pages.
    """
    pages = read(folder)
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


def external(folder: Path) -> set[str]:
    """Links of a built site and of README to other sites."""
    links = {link for page in read(folder).values() for link in page.links}
    outside = {link for link in links if urlsplit(link).scheme in ("http", "https")}
    return outside | set(OUTSIDE.findall(README.read_text()))


def dead(links: Iterable[str]) -> list[str]:
    """Links that other sites do not have or that nothing answers, each with the reason.

    A site that refuses a program, as many publishers do, counts as there.
    """

    def reason(link: str) -> str:
        try:
            urlopen(Request(link, headers={"User-Agent": "Mozilla/5.0"}), timeout=SECONDS).close()
        except HTTPError as error:
            return str(error) if error.code in (404, 410) else ""
        except OSError as error:
            return str(error)
        return ""

    links = sorted(links)
    with ThreadPoolExecutor(8) as pool:
        reasons = list(pool.map(reason, links))
    return [f"{link}: {why}" for link, why in zip(links, reasons, strict=True) if why]


def main() -> None:
    """Prints the links that lead nowhere; exit status 1 if there are any."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path, help="of the built site")
    parser.add_argument(
        "--external", action="store_true", help="also links to other sites, README's among them"
    )
    options = parser.parse_args()
    try:
        missing = lost(options.folder)
        if options.external:
            missing += dead(external(options.folder))
    except ValueError as error:
        parser.error(str(error))
    if missing:
        sys.exit("links that lead nowhere:\n" + "\n".join(missing))


if __name__ == "__main__":
    main()
