"""The report of a run: one HTML file, in which names are data, and what a browser makes of it."""

from __future__ import annotations

import base64
import gzip
import importlib.util
import json
import os
import re
import sys
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest
import site_browser
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.cli import main
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.pictures import report as front
from dea_fenicsx.pictures import skin

report = sys.modules["dea_fenicsx.pictures.report"]
pytest.importorskip("pyvista")
HOSTILE = "</script><script>window.broken = 1</script><b>\"'&"
L, VOLTS = 1e-3, 6e3


@pytest.fixture(scope="module")
def run(tmp_path_factory, small_compile):
    """A soft and a stiff film under a conductor, held at one end; with hostile names."""
    layers = [Layer("soft", 0.3 * L), Layer("stiff", 0.3 * L), Layer("metal", 0.1 * L)]
    device = dea.read_gmsh(BoxStack(2 * L, L, layers, (2, 1)), MPI.COMM_SELF)

    def film(mu, eps=None):
        return dea.Material(dea.NeoHookean(mu), eps and dea.IdealDielectric(eps))

    scene = dea.Scene(
        device, {"soft": film(5e4, 3.0), "stiff": film(2e5, 6.0), "metal": film(1e5)},
        [dea.Electrode("interface_2", VOLTS), dea.Ground("bottom")], [dea.Clamp("x_min")],
    )  # fmt: skip
    out = tmp_path_factory.mktemp("report") / "run <i> & 'x'"
    made = dea.solve(
        scene, dea.Ramp(steps=2), {"tip_m": dea.MeanDisplacement("x_max", "z")}, out=out,
        quiet=True, stability="never",
    )  # fmt: skip
    made.add(note=HOSTILE)
    return made


@pytest.fixture
def no_library(monkeypatch):
    """A library without content in place of plotly, which need not be installed."""
    fake = SimpleNamespace(get_plotlyjs=lambda: "/* library </script> */")
    monkeypatch.setitem(sys.modules, "plotly", SimpleNamespace(offline=fake))
    monkeypatch.setitem(sys.modules, "plotly.offline", fake)


def parts(text):
    """What a page tells, and its arrays by name."""
    told = json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1])
    packed = re.search(r'id="numbers">(.*?)</script>', text, re.S)[1]
    raw = BytesIO(gzip.decompress(base64.b64decode(packed)))
    arrays = {
        name: np.frombuffer(raw.read(4 * size), "<i4" if kind == "i" else "<f4")
        for name, kind, size in told["arrays"]
    }
    assert not raw.read()
    return told, arrays


def test_what_the_page_holds(run, no_library):
    told, arrays = parts(report.page(run.out))
    assert told["device"]["steps"] == [0, 1, 2]
    assert sorted(told["device"]["electrodes"]) == ["bottom", "interface_2"]
    points = arrays["points"].reshape(3, -1).T
    assert len(points) == told["device"]["points"]
    assert np.ptp(points, axis=0) == pytest.approx([2, 1, 0.7], rel=1e-6)  # mm
    corners = points[arrays["triangles"].reshape(-1, 3)].astype(float)
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(sides, axis=1).sum() / 2 == pytest.approx(2 * (2 + 1.4 + 0.7))
    # the outline of an electrode is the border of the lower face
    pairs = arrays["line/bottom"].reshape(-1, 2)
    ends = arrays["lines"].reshape(3, -1).T[pairs].astype(float)
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum() == pytest.approx(6)
    assert ends[..., 2] == pytest.approx(0.0)
    name, label, low, high = told["device"]["fields"][0]
    assert (name, label, low) == ("field_strength_MV_per_m", "Electric field (MV/m)", 0.0)
    last = arrays[f"{name}/2"]
    assert np.isnan(last).any() and high == pytest.approx(np.nanmax(last))
    labels = [label for _, label, *_ in told["device"]["fields"]]
    assert any(label.startswith("Von Mises stress") for label in labels)
    label, values = told["curves"]["columns"]["voltage_V"]
    assert (label, values) == ("Voltage (kV)", [0.0, 3.0, 6.0])
    assert (told["curves"]["x"], told["curves"]["events"]) == ("voltage_V", ["", "", ""])
    assert {"versions", "settings", "wall_s"} <= {key for key, _ in told["about"]}


def test_texts_of_a_run_are_no_code(run, no_library):
    text = report.page(run.out)
    told, _ = parts(text)
    assert told["title"] == run.out.name
    assert dict(told["about"])["note"] == HOSTILE
    assert "window.broken" not in re.sub(r'id="data">.*?</script>', "", text, flags=re.S)
    assert text.count("</script>") == text.count("<script") == 4  # a library has no end within
    assert "<b>" not in text and "<i>" not in text
    framed = report.Shown(text)._repr_html_()
    assert framed.count("<") == 2 and "sandbox" in framed


def test_the_command_and_the_notebook(run, no_library, tmp_path, capsys):
    target = tmp_path / "one.html"
    options = ["--field", "cauchy_stress_xx_Pa", "--out", str(target)]
    assert main(["report", str(run.out), *options]) == 0
    assert capsys.readouterr().out.strip() == str(target)
    told, _ = parts(target.read_text("utf-8"))
    assert [name for name, *_ in told["device"]["fields"]] == ["cauchy_stress_xx_Pa"]
    assert "srcdoc" in run.show()._repr_html_()
    with pytest.raises(dea.InputError, match="no field 'heat'"):
        front(run.out, fields=["heat"])
    with pytest.raises(dea.InputError, match=r"no history\.csv"):
        front(tmp_path)


def test_plotly_is_missing(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(dea.InputError, match="needs plotly; pip install plotly"):
        front(run.out)


def test_without_fields_at_nodes_and_thinned(run, no_library, tmp_path, monkeypatch):
    """An earlier run has no nodal.xdmf; a large surface keeps its size with fewer points."""
    import shutil

    folder = tmp_path / "earlier"
    shutil.copytree(run.out, folder)
    (folder / "nodal.xdmf").unlink()
    (folder / "summary.json").unlink()
    monkeypatch.setattr(skin, "MOST_POINTS_OF_REPORT", 20)
    monkeypatch.setattr(skin, "MOST_BYTES_OF_REPORT", 1)
    told, arrays = parts(report.page(folder))
    assert told["device"]["points"] <= 20 and told["device"]["steps"] == [0, 2]
    points = arrays["points"].reshape(3, -1).T.astype(float)
    assert np.ptp(points, axis=0) == pytest.approx([2, 1, 0.7], rel=1e-6)
    assert np.isfinite(arrays["displacement_m/1"]).all()


# ---------------------------------------------------------------------------------- in a browser


@pytest.mark.slow
@pytest.mark.skipif("SITE" not in os.environ, reason="a part of .ci/run opens reports in a browser")
@pytest.mark.skipif(importlib.util.find_spec("plotly") is None, reason="plotly is not installed")
@pytest.mark.skipif(site_browser.found() is None, reason="there is no Chromium")
def test_a_browser_shows_it(run, tmp_path):
    """No error, no request, the colours of the field and of the electrodes; steps differ."""
    from matplotlib.image import imread

    page = front(run.out, tmp_path / "report.html")
    assert page.stat().st_size < 8e6
    browser = site_browser.Browser(tmp_path / "profile", draws=True)
    try:
        browser.open(page.as_uri())
        browser.wait_for("document.body.dataset.ready === 'yes'", 60)

        def shot(name):
            picture = base64.b64decode(browser.call("Page.captureScreenshot")["data"])
            (tmp_path / name).write_bytes(picture)
            return imread(tmp_path / name)[..., :3]

        def share(image, colour, apart=0.06):
            return float((np.abs(image - np.array(colour)).max(axis=-1) < apart).mean())

        last = shot("last.png")
        assert share(last, [0xB8 / 255] * 3) > 0.01  # the conductor
        assert share(last, [0xD6 / 255, 0x27 / 255, 0x28 / 255]) > 1e-4  # an electrode
        strong = (last[..., 0] > 0.5) & (last[..., 1] > 0.5) & (last[..., 2] < 0.25)
        assert strong.mean() > 0.01  # the soft film, at the upper end of the scale
        browser.ask("(at('step').value = 0, at('step').oninput().then(() => 1))")
        assert browser.ask("at('load').textContent").startswith("step 0, Voltage (kV): 0")
        first = shot("first.png")
        assert (np.abs(first - last).max(axis=-1) > 0.1).mean() > 0.01
        browser.ask("(at('field').value = 'displacement_m', at('field').onchange().then(() => 1))")
        assert (np.abs(shot("other.png") - first).max(axis=-1) > 0.1).mean() > 0.005
        assert browser.ask("at('title').textContent") == run.out.name
        assert browser.ask("window.broken") is None and browser.errors == []
        assert [u for u in browser.requests if not u.startswith(("file:", "data:", "blob:"))] == []
    finally:
        browser.close()
