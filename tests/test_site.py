"""The site: it is built without a warning, loads nothing from elsewhere, and works in a browser.

Skipped where Sphinx or Chromium is missing.  SITE=FOLDER in the environment names a site that is
built already.
"""

from __future__ import annotations

import inspect
import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
import site_browser
from conftest import ROOT

DOCS = ROOT / "docs"
DEMOS = ROOT / "demos"
sys.path += [str(DOCS), str(DOCS / "_ext")]
import assembled_gallery  # noqa: E402
import build  # noqa: E402
import check  # noqa: E402
import public_names  # noqa: E402

TOOLS = ("sphinx", "furo", "myst_parser")
WIDTHS = (1200, 380)
"""Widths of the window in pixels: a desk and a telephone."""


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The folder of the built site."""
    if "SITE" in os.environ:
        return Path(os.environ["SITE"]).resolve()
    if not all(find_spec(tool) for tool in TOOLS):
        pytest.skip("the extra \"site\" is not installed; `make site` installs it")
    out = tmp_path_factory.mktemp("site")
    done = subprocess.run([sys.executable, DOCS / "build.py", "--out", out], capture_output=True,
                          text=True, timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return out / "html"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if site_browser.found() is None:
        pytest.skip("there is no Chromium here")
    opened = site_browser.Browser(tmp_path_factory.mktemp("profile"))
    yield opened
    opened.close()


def pages(site: Path) -> list[Path]:
    return sorted(site.rglob("*.html"))


# ---- the checks themselves -----------------------------------------------------------------------


@pytest.fixture
def small(tmp_path) -> Path:
    """A site of one page without a fault."""
    (tmp_path / "index.html").write_text('<p id="a"><a href="#a">a</a> <a href="https://x.org">b</a>')
    (tmp_path / "searchindex.js").write_text(
        'Search.setIndex({"terms":{"pull":0,"stretch":0,"electrod":0},"titleterms":{}})'
    )
    assert check.faults(tmp_path) == []
    return tmp_path


@pytest.mark.parametrize("text", [
    '<script src="https://cdn.org/a.js"></script>',
    '<img src="//cdn.org/a.png">',
    '<link rel="stylesheet" href="http://cdn.org/a.css">',
    '<p style="background: url(https://cdn.org/a.png)">',
    '<style>@import "https://cdn.org/a.css";</style>',
    '<img srcset="https://cdn.org/a.png 2x">',
])  # fmt: skip
def test_a_foreign_resource_is_found(small, text):
    (small / "index.html").write_text(text)
    (fault,) = check.faults(small)
    assert "cdn.org" in fault and fault.endswith("which is on another host.")


def test_a_foreign_resource_of_a_style_sheet_is_found(small):
    (small / "a.css").write_text("p { background: url('https://cdn.org/a.png') }")
    (fault,) = check.faults(small)
    assert fault.startswith("a.css loads https://cdn.org/a.png")


@pytest.mark.parametrize("link", ["missing.html", "#b", "index.html#b"])
def test_a_dead_link_is_found(small, link):
    (small / "index.html").write_text(f'<p id="a"><a href="{link}">b</a>')
    (fault,) = check.faults(small)
    assert f"links to {link}" in fault


def test_a_word_that_is_not_found_is_told(small):
    (small / "searchindex.js").write_text('Search.setIndex({"terms":{"pull":0},"titleterms":{}})')
    assert len(check.faults(small)) == 2


# ---- sources of the site -------------------------------------------------------------------------


@pytest.mark.parametrize("link, expected", [
    ("[a](guide.md)", "[a](../guide.md)"),  # of the same folder, which becomes the top
    ("[a](theory.md#elements)", "[a](../theory.md#elements)"),
    ("[a](../../demos/cube.py)", "[a](../gallery/cube.md)"),
    ("[a](../../LICENSE)", "`a`"),  # a file that is no page
    ("[a](https://x.org/y.md)", "[a](https://x.org/y.md)"),
    ("[a](#here)", "[a](#here)"),
    ("![a](pictures/helix.png)", "![a](../pictures/helix.png)"),
    ("```sh\n[a](guide.md)\n```", "```sh\n[a](guide.md)\n```"),  # code stays
])  # fmt: skip
def test_links_lead_to_the_pages_of_the_site(tmp_path, link, expected):
    page = ROOT / "dea_fenicsx" / "docs" / "scripts.md"
    pages = build.site_pages()
    assert build.with_site_links(link, page, "deep/scripts.md", pages, tmp_path) == expected
    assert (tmp_path / "pictures" / "helix.png").is_file() == link.startswith("!")


def test_signs_of_markup_in_a_docstring_stay_as_they_are():
    given = ["The energy |F P|^2 of **kwargs, `size`^2 of ``a*b``:", "", "    W = |F|^2 * mu", ""]
    assert public_names.plain(given) == [
        r"The energy \|F P\|^2 of \*\*kwargs, `size`\ ^2 of ``a*b``:", "", "::", "",
        "    W = |F|^2 * mu", "",
    ]  # fmt: skip


def test_formulas_in_the_words_of_a_demo_become_blocks():
    text = "The stretch is a_b*c:\n\n    l = a^2,\n    b = 1\n\nSee `x_y`."
    assert assembled_gallery.as_markdown(text) == (
        "The stretch is a\\_b\\*c:\n\n```text\nl = a^2,\nb = 1\n```\n\nSee `x_y`."
    )


def test_every_demo_is_in_one_group_of_the_gallery():
    listed = [name for names in assembled_gallery.groups(DEMOS).values() for name in names]
    assert sorted(listed) == sorted(file.name for file in DEMOS.glob("*.py"))


def test_every_kept_picture_has_its_demo_and_its_commit():
    import json

    results = json.loads((DOCS / "gallery" / "results.json").read_text("utf-8"))
    for picture in (DOCS / "gallery").glob("*.png"):
        told = results[f"{picture.stem}.py"]
        assert (DEMOS / f"{picture.stem}.py").is_file()
        assert len(told["commit"].rstrip("+")) == 12
        assert told["seconds"] > 0
        assert told["command"].startswith(f"python demos/{picture.stem}.py")
        assert picture.stat().st_size < 150_000


# ---- the built site ------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_site_has_no_fault(site):
    assert check.faults(site) == []


@pytest.mark.slow
def test_every_demo_and_every_public_name_is_there(site):
    from importlib import import_module

    from dea_fenicsx.docs.api import ROOMS

    gallery = (site / "gallery" / "index.html").read_text("utf-8")
    for demo in DEMOS.glob("*.py"):
        assert f'href="{demo.stem}.html"' in gallery
        page = (site / "gallery" / f"{demo.stem}.html").read_text("utf-8")
        assert "highlight-python" in page and f"{demo.name}</span>" in page
    told = "".join(page.read_text("utf-8") for page in (site / "api").glob("*.html"))
    for room in ROOMS:
        module = import_module(f"dea_fenicsx{room}")
        for name in module.__all__:
            if name == "__version__" or inspect.ismodule(getattr(module, name)):
                continue
            assert f'.{name}"' in told, f"{room} {name}"


@pytest.mark.slow
def test_formulas_are_drawn_without_a_script(site):
    assert "<math" in (site / "theory.html").read_text("utf-8")
    loaded = check.Page((site / "theory.html").read_text("utf-8")).resources
    assert not [name for name in loaded if "math" in name.lower() or "tex" in name.lower()]


@pytest.mark.slow
def test_every_page_loads_and_fits_on_a_small_screen(site, browser):
    """No error on the console, no request to another host, no page wider than the window."""
    faults = []
    for page in pages(site):
        # The wide window is for the pages at the top alone: the others are laid out like them.
        for width in WIDTHS if page.parent == site else WIDTHS[-1:]:
            browser.open(page.as_uri(), width)
            faults += [f"{page.name} at {width}: {error}" for error in browser.errors]
            faults += [f"{page.name} asks for {url}" for url in browser.requests
                       if not url.startswith(("file:", "data:"))]  # fmt: skip
            wide = browser.ask("document.documentElement.scrollWidth")
            if wide > width:
                faults.append(f"{page.name} is {wide} pixels wide in a window of {width}")
            there = "[...document.images].every(i => i.loading == 'lazy' || i.naturalWidth)"
            if not browser.ask(there):
                faults.append(f"{page.name}: a picture is not there")
    assert not faults


@pytest.mark.slow
@pytest.mark.parametrize("words, page", [
    ("pull-in", "gallery/pull_in.html"),
    ("lost ramp", "howto/lost_ramp.html"),
    ("PreStretch", "howto/prestretch.html"),
    ("Ramp", "api/path.html"),
])  # fmt: skip
def test_the_search_finds(site, browser, words, page):
    browser.open(f"{(site / 'search.html').as_uri()}?q={words.replace(' ', '+')}")
    links = "[...document.querySelectorAll('#search-results li a')].map(a => a.href)"
    browser.wait_for(f"{links}.some(link => link.includes({page!r}))")
    assert not browser.errors


if __name__ == "__main__":  # pictures of some pages, to look at
    shots = Path(sys.argv[2])
    shots.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(shots / "profile", ignore_errors=True)
    opened = site_browser.Browser(shots / "profile")
    for name in sys.argv[3:]:
        for width in WIDTHS:
            opened.open((Path(sys.argv[1]) / name).resolve().as_uri(), width)
            opened.picture(shots / f"{name.replace('/', '_')}_{width}.png")
    opened.close()
