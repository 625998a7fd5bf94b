"""Importing the package changes nothing of the process, and its hook stays out of other people's.

A script learns of errors in one sentence once it has made the first collective call.
"""

from __future__ import annotations

import subprocess
import sys

import pytest
from conftest import ROOT, clean_environment

from dea_fenicsx.cli.doctor import hiding_folder

WATCHED = """
import atexit, builtins, json, signal, sys, threading, warnings
import importlib.abc, importlib.machinery  # what the finder of an editable install loads
registered = []
atexit.register = lambda *a, **k: registered.append(a)
def seen():
    return {
        "excepthook": sys.excepthook, "unraisablehook": sys.unraisablehook, "exit": sys.exit,
        "displayhook": sys.displayhook, "argv": list(sys.argv), "path": list(sys.path),
        "meta_path": list(sys.meta_path), "path_hooks": list(sys.path_hooks),
        "stdout": sys.stdout, "stderr": sys.stderr, "flags": sys.flags,
        "recursion": sys.getrecursionlimit(), "trace": sys.gettrace(), "profile": sys.getprofile(),
        "tools": [sys.monitoring.get_tool(k) for k in range(6)],
        "thread hook": threading.excepthook, "threads": threading.active_count(),
        "names of sys": sorted(vars(sys)), "builtins": sorted(vars(builtins)),
        "signals": [signal.getsignal(k) for k in (1, 2, 15)], "filters": list(warnings.filters),
    }
sys.argv.append("--debug")
before = seen()
import dea_fenicsx
after = seen()
changed = [name for name in before if before[name] != after[name]]
heavy = {"numpy", "scipy", "mpi4py", "dolfinx", "petsc4py", "ufl", "gmsh", "h5py", "argparse"}
print(json.dumps([changed, len(registered), sorted(heavy & set(sys.modules))]))
"""


def run(text, *, arguments=("-c",), **options):
    return subprocess.run(
        [sys.executable, *arguments, text], capture_output=True, text=True, timeout=120, cwd=ROOT,
        env=clean_environment(), **options,
    )  # fmt: skip


def test_import_changes_nothing():
    done = run(WATCHED)
    assert done.stdout == "[[], 0, []]\n", done.stdout + done.stderr


def test_only_importing_leaves_errors_to_python():
    done = run("import dea_fenicsx as dea\nraise dea.InputError('Wrong.')")
    assert done.returncode == 1
    assert done.stderr.startswith("Traceback")
    assert done.stderr.splitlines()[-1].endswith("InputError: Wrong.")


def test_a_folder_of_the_same_name_hides_nothing(tmp_path):
    """As an earlier run's cache or results may leave it beside a script."""
    (tmp_path / "dea_fenicsx" / "0123456789ab").mkdir(parents=True)
    (tmp_path / "script.py").write_text(
        "import sys, dea_fenicsx as dea\n"
        "print([f for f in sys.meta_path if 'editable' in getattr(f, '__module__', '')])\n"
        "print(dea.InputError.__name__)\n"
    )
    env = {k: v for k, v in clean_environment().items() if k != "PYTHONPATH"}
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, env=env, text=True,
                          capture_output=True, timeout=60)  # fmt: skip
    if done.stdout.startswith("[<") or "No module" in done.stderr:
        pytest.skip("the package was not installed by this version's `make env`")
    assert done.stdout.endswith("InputError\n"), done.stderr


def test_the_doctor_names_a_folder_that_hides_the_package(monkeypatch, tmp_path):
    package = ROOT / "dea_fenicsx"
    assert hiding_folder(ROOT, package) is None
    assert hiding_folder(tmp_path, package) is None
    (tmp_path / "dea_fenicsx").mkdir()
    monkeypatch.setattr(sys, "path", [str(tmp_path), str(ROOT)])
    assert hiding_folder(tmp_path, package) is None  # the real package is on the path
    monkeypatch.setattr(sys, "path", ["", str(tmp_path)])
    assert hiding_folder(tmp_path, package) == tmp_path / "dea_fenicsx"
    monkeypatch.setattr(sys, "path", [str(tmp_path), str(ROOT)])
    (tmp_path / "dea_fenicsx" / "__init__.py").touch()
    assert hiding_folder(tmp_path, package) == tmp_path / "dea_fenicsx"


CALLS = {
    "read_gmsh": "dea.read_gmsh('nowhere.msh')",
    "solve": "dea.solve(None, None)",
    "a Parser": "dea.Parser('A script.', 'out').parse_args(['--wrong'])",
}


@pytest.mark.parametrize("call", CALLS)
def test_a_script_gets_one_sentence(call):
    """With -c, from standard input, or from a file: a plain script that uses no Parser, too."""
    done = run(f"import dea_fenicsx as dea\n{CALLS[call]}")
    assert done.returncode == 2
    assert done.stderr.startswith("Error: ") and done.stderr.count("\n") == 1


APPLICATION = """
import sys
import dea_fenicsx as dea
def mine(kind, error, trace):
    print("mine:", kind.__name__)
{before}
try:
    dea.read_gmsh("nowhere.msh")
except dea.InputError:
    pass
{after}
raise {error}
"""


@pytest.mark.parametrize(
    ("before", "after", "error", "told", "status"),
    [
        ("sys.excepthook = mine", "", "dea.InputError('Wrong.')", "mine: InputError", 1),
        ("sys.excepthook = mine", "", "KeyError(1)", "mine: KeyError", 1),
        ("", "sys.excepthook = mine", "dea.InputError('Wrong.')", "mine: InputError", 1),
        ("sys.ps1 = '>'", "", "dea.InputError('Wrong.')", "InputError: Wrong.", 1),
        ("", "", "dea.InputError('Wrong.')", "Error: Wrong.", 2),
        ("", "", "KeyError(1)", "KeyError: 1", 1),
        ("", "", "SystemExit(5)", "", 5),
    ],
)
def test_the_hook_of_an_application_stays(before, after, error, told, status):
    """On one rank; and nothing is installed where a person types."""
    done = run(APPLICATION.format(before=before, after=after, error=error))
    assert done.returncode == status
    assert told in done.stdout + done.stderr
    assert ("Traceback" in done.stderr) == (told in ("InputError: Wrong.", "KeyError: 1"))


def test_nothing_in_an_interpreter():
    """`python -i` stays open after an error."""
    text = "import sys, dea_fenicsx as dea\ndea.read_gmsh('nowhere.msh')\n"
    done = run(text, arguments=("-i", "-c"), input="print('still', sys.excepthook.__name__)\n")
    assert "still excepthook" in done.stdout
    assert "InputError" in done.stderr


def test_a_small_run_leaves_slow_modules_alone():
    """What no part of the run calls is not imported: integration, optimisation and the like."""
    done = run(
        "import sys\n"
        "import dea_fenicsx as dea\n"
        "from dea_fenicsx.geometry import BoxStack, Layer\n"
        "strip = dea.device(BoxStack(1e-3, None, [Layer('film', 1e-4)], divisions=(2,)))\n"
        "scene = dea.Scene(strip, {'film': dea.Material(dea.NeoHookean(5e4))},\n"
        "                  supports=[dea.Clamp('x_min')], kinematics=dea.PlaneStrain(),\n"
        "                  loads=[dea.DeadLoad('x_max', (1e2, 0.0))])\n"
        "dea.solve(scene, dea.Ramp('load', steps=1), quiet=True)\n"
        "slow = ('integrate', 'interpolate', 'optimize', 'spatial', 'special')\n"
        "print([name for name in slow if f'scipy.{name}' in sys.modules], 'h5py' in sys.modules)\n"
    )
    assert done.stdout == "[] False\n", done.stdout + done.stderr
