"""Checks of a built site: no foreign resource, no dead link, and a search index that finds.

``python docs/check.py build/site/html`` prints each fault; the exit status is 1 if there is one.
"""

from __future__ import annotations

import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

RESOURCES = {
    "script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src", "audio": "src",
    "embed": "src", "object": "data", "link": "href", "input": "src", "track": "src",
    "image": "href",
}  # fmt: skip
"""Elements that load something by themselves, and the attribute that tells what."""

IN_STYLE = re.compile(r"url\(\s*['\"]?([^'\")]+)|@import\s+['\"]([^'\"]+)")
WANTED = {"pull-in": "pull", "pre-stretch": "stretch", "electrode": "electrod"}
"""Words that a reader searches, and what the index must hold for them."""


class Page(HTMLParser):
    """What a page loads, where its links lead, and which anchors it has."""

    def __init__(self, text: str):
        super().__init__()
        self.resources: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = {name: value or "" for name, value in attrs}
        for name in ("id", "name"):
            if name in named:
                self.anchors.add(named[name])
        if tag == "a" and "href" in named:
            self.links.append(named["href"])
        if named.get(RESOURCES.get(tag, "")):
            self.resources.append(named[RESOURCES[tag]])
        for part in named.get("srcset", "").split(","):
            if part.strip():
                self.resources.append(part.split()[0])
        self.resources += found_in_style(named.get("style", ""))

    def handle_data(self, data: str) -> None:
        if self.cdata_elem == "style":
            self.resources += found_in_style(data)


def found_in_style(text: str) -> list[str]:
    """Addresses in a style sheet."""
    return [a or b for a, b in IN_STYLE.findall(text)]


def is_foreign(address: str) -> bool:
    """Whether an address is one of another host."""
    return bool(urlsplit(address).netloc)


def foreign_resources(html: Path, pages: dict[Path, Page]) -> list[str]:
    """A sentence for each thing that a page or a style sheet would load from another host."""
    loads = [(file, address) for file, page in pages.items() for address in page.resources]
    for sheet in html.rglob("*.css"):
        loads += [(sheet, address) for address in found_in_style(sheet.read_text("utf-8"))]
    return [f"{file.relative_to(html)} loads {address}, which is on another host."
            for file, address in loads if is_foreign(address)]  # fmt: skip


def dead_links(html: Path, pages: dict[Path, Page]) -> list[str]:
    """A sentence for each link or resource within the site that leads nowhere."""
    found = []
    for file, page in pages.items():
        for address in [*page.links, *page.resources]:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            goal = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            if goal.is_dir():
                goal /= "index.html"
            if not goal.is_file():
                found.append(f"{file.relative_to(html)} links to {address}, which does not exist.")
            elif goal in pages and unquote(parts.fragment) not in {"", *pages[goal].anchors}:
                found.append(f"{file.relative_to(html)} links to {address}: no such place.")
    return found


def missing_in_search(html: Path) -> list[str]:
    """A sentence for each word that the search index does not find."""
    script = (html / "searchindex.js").read_text("utf-8")
    index = json.loads(script[script.index("(") + 1 : script.rindex(")")])
    terms = {**index["terms"], **index["titleterms"]}
    return [f'The search does not find "{word}".' for word, stem in WANTED.items()
            if not any(term.startswith(stem) for term in terms)]  # fmt: skip


def faults(html: Path) -> list[str]:
    """All faults of a built site, each as a sentence."""
    html = html.resolve()
    pages = {file: Page(file.read_text("utf-8")) for file in sorted(html.rglob("*.html"))}
    if not pages:
        return [f"There are no pages in {html}."]
    return [*foreign_resources(html, pages), *dead_links(html, pages), *missing_in_search(html)]


if __name__ == "__main__":
    told = faults(Path(sys.argv[1]))
    print("\n".join(told) or "no faults")
    sys.exit(bool(told))
