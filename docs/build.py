"""``python docs/build.py [--out FOLDER]``: build the site, with warnings as errors, and check it.

The pages come from three places, and no text is written twice:

- docs/ holds the pages that the site alone has;
- README.md, demos/README.md, dea_fenicsx/docs/*.md and a few other files of the repository become
  pages as they are; links between them are turned into links between the pages;
- the gallery and the pages of public names are made from demos/ and from docstrings.

All of it is put together in FOLDER/source, and Sphinx writes FOLDER/html.  Nothing is downloaded.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path[:0] = [str(ROOT), str(DOCS)]

import assembled_api  # noqa: E402
import assembled_gallery  # noqa: E402
import check  # noqa: E402

PAGES = {
    "README.md": "index.md",
    "demos/README.md": "tutorials.md",
    "docker/README.md": "container.md",
    "CONTRIBUTING.md": "developers/contributing.md",
    "CHANGELOG.md": "developers/changelog.md",
    "tests/hard/README.md": "developers/hard_cases.md",
}
"""Pages that are files elsewhere in the repository.  Those of the package come on top."""

LINK = re.compile(r"(?<!\\)(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


def site_pages() -> dict[Path, str]:
    """For each file of the repository that is a page: its name in the site."""
    found = {ROOT / file: page for file, page in PAGES.items()}
    for file in sorted((ROOT / "dea_fenicsx" / "docs").glob("*.md")):
        found[file] = file.name
    for file in sorted(DOCS.rglob("*.md")):
        found[file] = file.relative_to(DOCS).as_posix()
    for file in sorted((ROOT / "demos").glob("*.py")):
        found[file] = f"gallery/{file.stem}.md"
    return {file.resolve(): page for file, page in found.items() if file.is_file()}


def with_site_links(text: str, file: Path, page: str, pages: dict[Path, str], source: Path) -> str:
    """The text of a file with its links turned into links from its page in the site.

    Pictures are copied beside the pages.  A link to a file that is no page becomes its text.
    """

    def replaced(match: re.Match) -> str:
        mark, words, target = match.groups()
        words = words if mark else LINK.sub(replaced, words)
        name, _, anchor = target.partition("#")
        if "://" in target or target.startswith("mailto:") or not name:
            return f"{mark}[{words}]({target})"
        goal = (file.parent / name).resolve()
        if mark:
            picture = source / "pictures" / goal.name
            picture.parent.mkdir(exist_ok=True)
            shutil.copyfile(goal, picture)
            place = f"pictures/{goal.name}"
        elif goal in pages:
            place = pages[goal]
        elif (source / Path(page).parent / name).is_file():  # a page that was made for the site
            return match.group(0)
        else:
            return words if words.startswith("`") else f"`{words}`"
        relative = os.path.relpath(place, Path(page).parent).replace(os.sep, "/")
        return f"{mark}[{words}]({relative}{'#' if anchor else ''}{anchor})"

    parts = re.split(r"(^```.*?^```[^\n]*$)", text, flags=re.M | re.S)
    parts[::2] = [LINK.sub(replaced, part) for part in parts[::2]]
    return "".join(parts)


def assemble(source: Path) -> None:
    """Put all pages of the site together in a folder."""
    pages = site_pages()
    assembled_gallery.write(ROOT / "demos", DOCS / "gallery", source / "gallery")
    assembled_api.write(source / "api")
    for file, page in pages.items():
        if file.suffix != ".md":
            continue
        text = with_site_links(file.read_text("utf-8"), file, page, pages, source)
        if page == "index.md":
            text += "\n" + (DOCS / "contents.txt").read_text("utf-8")
        target = source / page
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, "utf-8")


def build(out: Path) -> Path:
    """Build the site into out/html, and check it.

    Returns
    -------
    Path
        The folder with the pages.

    Raises
    ------
    SystemExit
        If Sphinx has warned of something, or a check has failed.
    """
    from sphinx.cmd.build import build_main

    source, html = out / "source", out / "html"
    for folder in (source, html):
        shutil.rmtree(folder, ignore_errors=True)
    source.mkdir(parents=True)
    assemble(source)
    status = build_main([
        "-b", "html", "-c", str(DOCS), "-d", str(out / "doctrees"), "-E", "-q", "-W",
        "--keep-going", str(source), str(html),
    ])  # fmt: skip
    if status:
        raise SystemExit(status)
    faults = check.faults(html)
    if faults:
        raise SystemExit("\n".join(faults))
    return html


def main() -> None:
    """Read the command line, and build."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "site", metavar="FOLDER")
    html = build(parser.parse_args().out.resolve())
    print(f"{len(list(html.rglob('*.html')))} pages, the first one is {html / 'index.html'}")


if __name__ == "__main__":
    main()
