"""Files that a project has by habit agree with each other and with the code."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.util import find_spec

import pytest
from conftest import ROOT, clean_environment

import dea_fenicsx as dea
from dea_fenicsx.results.provenance import package_versions

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
CITATION = ROOT / "CITATION.cff"
HOOKS = ROOT / ".pre-commit-config.yaml"
TEMPLATES = ROOT / ".github" / "ISSUE_TEMPLATE"
CI = ROOT / ".ci"


def yaml_of(file):
    """The content of a YAML file; the test is skipped where nothing reads YAML."""
    return pytest.importorskip("yaml").safe_load(file.read_text("utf-8"))


# ---- the version --------------------------------------------------------------------------------


def test_the_version_is_a_number_of_semantic_versioning():
    assert re.fullmatch(r"\d+\.\d+\.\d+(-[0-9A-Za-z.]+)?", dea.__version__)


def test_the_build_reads_the_version_from_the_package():
    assert "version" not in PROJECT["project"]
    assert PROJECT["project"]["dynamic"] == ["version"]
    source = PROJECT["tool"]["setuptools"]["dynamic"]["version"]["attr"]
    assert source == "dea_fenicsx.__version__"


@pytest.mark.skipif(find_spec("setuptools") is None, reason="setuptools is not installed")
def test_setuptools_finds_the_version_without_importing_the_package():
    """The package needs DOLFINx, which is not there where a wheel is built."""
    code = (
        "from setuptools import Distribution\n"
        "import sys\n"
        "found = Distribution()\n"
        "found.parse_config_files()\n"
        "assert 'dea_fenicsx' not in sys.modules\n"
        "print(found.metadata.version)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True,
                          timeout=60, env=clean_environment())  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == dea.__version__


def test_the_version_is_written_once_in_the_code():
    """No other file of the code holds the number."""
    for folder in ("dea_fenicsx", "geometry"):
        for file in (ROOT / folder).rglob("*.py"):
            found = file.read_text("utf-8").count(f'"{dea.__version__}"')
            assert found == (file == ROOT / "dea_fenicsx" / "__init__.py"), file


def test_results_and_the_command_tell_the_version(capsys):
    from dea_fenicsx.cli import main

    assert package_versions()["dea_fenicsx"] == dea.__version__
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out.strip() == f"dea_fenicsx {dea.__version__}"


def test_the_changelog_knows_the_version():
    """Sections are "Unreleased" or numbers; the newest number is the version of the code."""
    heads = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M)
    numbers = [re.match(r"\[?(\d+\.\d+\.\d+[^\]\s]*)", head) for head in heads]
    named = [number[1] for number in numbers if number]
    assert named[0] == dea.__version__
    others = [head for head, number in zip(heads, numbers, strict=True) if not number]
    assert others in ([], ["Unreleased"]) and (not others or heads[0] == "Unreleased")


# ---- citing, reporting ---------------------------------------------------------------------------


def test_the_citation_agrees_with_the_project():
    """The keys that CFF 1.2.0 demands, and what pyproject.toml says too."""
    text = CITATION.read_text("utf-8")
    single = dict(re.findall(r'^([a-z-]+): "?([^"\n]+?)"?$', text, re.M))
    project = PROJECT["project"]
    assert single["cff-version"] == "1.2.0" and single["message"] and single["type"] == "software"
    assert single["title"] == "dea_fenicsx" and project["name"] == "dea-fenicsx"
    assert single["abstract"] == project["description"]
    assert single["version"] == dea.__version__ and single["license"] == project["license"]
    authors = re.findall(r'^  - name: "?([^"\n]+?)"?$', text, re.M)
    assert authors == [author["name"] for author in project["authors"]]


def test_the_conda_recipe_has_the_version():
    text = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text("utf-8")
    assert re.findall(r'^  version: "(.*)"$', text, re.M) == [dea.__version__]


def test_the_citation_is_yaml():
    found = yaml_of(CITATION)
    known = {"cff-version", "message", "type", "title", "abstract", "version", "license",
             "authors", "keywords", "date-released", "doi", "repository-code", "url"}  # fmt: skip
    assert set(found) <= known
    assert all(isinstance(found[key], str) for key in ("cff-version", "version", "title"))
    assert found["keywords"] == PROJECT["project"]["keywords"]


@pytest.mark.parametrize("name", ["bug_report", "feature_request"])
def test_issue_templates(name):
    form = yaml_of(TEMPLATES / f"{name}.yml")
    assert form["name"] and form["description"]
    ids = [part["id"] for part in form["body"]]
    assert len(ids) == len(set(ids)) > 0
    for part in form["body"]:
        assert part["type"] in {"textarea", "input", "dropdown", "markdown", "checkboxes"}
        assert part["attributes"]["label"]


def test_the_pull_request_template_names_targets():
    text = (ROOT / ".github" / "pull_request_template.md").read_text("utf-8")
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.M))
    assert set(re.findall(r"`make ([a-z-]+)`", text)) <= targets


# ---- lint, coverage, markers ------------------------------------------------------------------


def test_hooks_run_what_lint_runs():
    """Each command of .ci/lint is a hook, with the same module and package."""
    lint = re.findall(r"^\"\$python\" -m (.*?) \|\|", (CI / "lint").read_text("utf-8"), re.M)
    hooks = re.findall(r"entry: \.venv/bin/python -m (.*)$", HOOKS.read_text("utf-8"), re.M)
    # pre-commit names the changed files itself, in the place of the folder.
    assert sorted(hooks) == sorted(command.removesuffix(" .") for command in lint) != []


def test_hooks_are_yaml():
    (repository,) = yaml_of(HOOKS)["repos"]
    assert repository["repo"] == "local"
    assert all(hook["language"] == "system" for hook in repository["hooks"])


def test_markers_of_make_quick_are_declared():
    makefile = (ROOT / "Makefile").read_text("utf-8")
    left_out = re.search(r'^quick: env\n\t.*pytest -m "(.*)"$', makefile, re.M)[1]
    markers = {m.partition(":")[0] for m in PROJECT["tool"]["pytest"]["ini_options"]["markers"]}
    named = set(re.findall(r"not (\w+)", left_out))
    assert {"slow", "mpi", "demo"} <= named <= markers


def test_coverage_is_told_by_room(tmp_path):
    report = tmp_path / "coverage.json"
    report.write_text(
        '{"files": {"dea_fenicsx/path/ramping.py": {"summary": {"num_statements": 30,'
        ' "covered_lines": 27}}, "dea_fenicsx/path/events.py": {"summary": {"num_statements": 10,'
        ' "covered_lines": 3}}, "geometry/hdea.py": {"summary": {"num_statements": 60,'
        ' "covered_lines": 60}}, "dea_fenicsx/demos/cube.py": {"summary": {"num_statements": 9,'
        ' "covered_lines": 0}}}}'
    )
    done = subprocess.run([sys.executable, str(CI / "coverage"), str(report)], text=True,
                          capture_output=True, timeout=60)  # fmt: skip
    told = "ci: coverage of lines: total 90 % (geometry 100 %, path 75 %)\n"
    assert done.stdout == told, done.stderr


def test_the_suite_does_not_need_coverage():
    """Only .ci/run asks for pytest-cov; where it is absent, `make test` works as it does."""
    assert "--cov" not in PROJECT["tool"]["pytest"]["ini_options"]["addopts"]
    assert "--cov" not in (ROOT / "Makefile").read_text("utf-8")
    assert "COVERAGE_CORE=sysmon" in (CI / "run").read_text("utf-8")


def test_the_image_holds_what_these_tests_read():
    copied = (ROOT / "docker" / "Dockerfile").read_text("utf-8")
    for name in ("CHANGELOG.md", "CONTRIBUTING.md", CITATION.name, HOOKS.name, ".github"):
        assert re.search(rf"\s{re.escape(name)}\s", copied), name
