"""The cases of the demo `zipping_or_folding.py` that are not its default."""

from __future__ import annotations

import pytest
from conftest import ROOT, on_demand
from demo_checks import check_panels, check_zipping

DEMOS = ROOT / "demos"


@pytest.mark.demo
def test_zipping(start, tmp_path):
    done = start(DEMOS / "zipping_or_folding.py", "--case", "zip", "--out", tmp_path, "--quiet",
                 check=True)  # fmt: skip
    check_zipping(tmp_path, done.stdout)


@on_demand
@pytest.mark.demo
def test_panels_that_meet(start, tmp_path):
    """Minutes: twice eight steps of a storey whose valleys meet."""
    done = start(DEMOS / "zipping_or_folding.py", "--case", "panels", "--out", tmp_path, "--quiet",
                 "--stroke", 6.8e-3, "--steps", 8, check=True)  # fmt: skip
    check_panels(tmp_path, done.stdout)
