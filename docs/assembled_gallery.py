"""Pages of the gallery: each demo with its picture, its run time, its words and its script."""

from __future__ import annotations

import ast
import html
import json
import re
import shutil
from pathlib import Path


def words_of(script: Path) -> tuple[str, str]:
    """Title and text of a demo, from its docstring."""
    text = ast.get_docstring(ast.parse(script.read_text("utf-8"))) or script.stem
    title, _, rest = text.partition("\n")
    return title.strip().rstrip("."), rest.strip("\n")


def as_markdown(text: str) -> str:
    """A docstring as Markdown: what is indented is a formula or a command, and stays as it is."""
    blocks = []
    for block in re.split(r"\n\s*\n", text):
        if not block.strip():
            continue
        if all(line.startswith("    ") for line in block.splitlines()):
            lines = [line[4:] for line in block.splitlines()]
            blocks.append("\n".join(["```text", *lines, "```"]))
        else:
            parts = re.split(r"(`[^`]*`)", block)
            parts[::2] = [re.sub(r"([*<>$|\[\]]|(?<=\w)_)", r"\\\1", part) for part in parts[::2]]
            blocks.append("".join(parts))
    return "\n\n".join(blocks)


def groups(demos: Path) -> dict[str, list[str]]:
    """Demos in the order and in the groups of the tables in demos/README.md."""
    found: dict[str, list[str]] = {}
    heading = "Others"
    seen: set[str] = set()
    for line in (demos / "README.md").read_text("utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| script "):
            heading = "Tutorials"
        elif line.startswith("|") and "](" not in line and cells[0].strip("- "):
            heading = cells[0][0].upper() + cells[0][1:]
        elif line.startswith("|"):
            for name in re.findall(r"\]\((\w+\.py)\)", line):
                if name not in seen:
                    found.setdefault(heading, []).append(name)
                    seen.add(name)
    rest = sorted(f.name for f in demos.glob("*.py") if f.name not in seen)
    return {**found, "Others": [*found.get("Others", []), *rest]} if rest else found


def page(script: Path, result: dict, picture: Path | None) -> str:
    """The page of one demo."""
    title, text = words_of(script)
    lines = [f"# {title}", ""]
    if picture is not None:
        lines += [f"```{{image}} {picture.name}", f":alt: {title}", ":class: demo", "```", ""]
    if result:
        lines += [
            f"This command took **{result['seconds']:g} s** on one core, with the code of commit "
            f"`{result['commit']}` and compiled forms at hand.  The picture shows its result.", "",
            "```sh", result["command"], "```", "",
        ]  # fmt: skip
    lines += [as_markdown(text), "", "## The script", "",
              f"{{download}}`{script.name}`; `--help` shows its options with their units.", "",
              f"```{{literalinclude}} {script.name}", ":language: python", "```", ""]  # fmt: skip
    return "\n".join(lines)


def card(script: Path, result: dict, picture: Path | None) -> str:
    """The entry of one demo in the gallery, as HTML."""
    title = html.escape(words_of(script)[0])
    image = '<span class="none">no picture</span>'
    if picture is not None:
        image = f'<img loading="lazy" src="../_images/{picture.name}" alt="">'
    seconds = f" ({result['seconds']:g} s)" if result else ""
    return (f'<a href="{script.stem}.html">{image}<b>{script.stem}{seconds}</b>'
            f"<small>{title}</small></a>")  # fmt: skip


def write(demos: Path, kept: Path, folder: Path) -> None:
    """Write the pages of the gallery.

    Parameters
    ----------
    demos : Path
        The folder of the scripts.
    kept : Path
        The folder with the pictures and the results of docs/gallery.py.
    folder : Path
        Where the pages go.
    """
    folder.mkdir(parents=True, exist_ok=True)
    results = json.loads((kept / "results.json").read_text("utf-8"))
    lines = ["# Gallery", "",
             "Each demo is a script that you can run, read and change.  Its page has a picture, "
             "the run time on one core, and the script.", ""]  # fmt: skip
    names = []
    for heading, scripts in groups(demos).items():
        cards = []
        for name in scripts:
            script, result = demos / name, results.get(name, {})
            stored = kept / f"{script.stem}.png"
            picture = stored if stored.is_file() else None
            if picture is not None:
                shutil.copyfile(picture, folder / picture.name)
            shutil.copyfile(script, folder / script.name)
            (folder / f"{script.stem}.md").write_text(page(script, result, picture), "utf-8")
            cards.append(card(script, result, picture))
            names.append(script.stem)
        lines += [f"## {heading}", "", '<div class="demos">', *cards, "</div>", ""]
    lines += ["```{toctree}", ":hidden:", "", *names, "```", ""]
    (folder / "index.md").write_text("\n".join(lines), "utf-8")
