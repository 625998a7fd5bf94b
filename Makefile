# make env    set up .venv (once; PYTHON=... names an interpreter)
# make demo   the two-turn helical actuator on 2 ranks
# make quick  the tests that a change of code needs most, in two minutes
# make test   the test suite, on all cores
# make hard   the table of hard cases and the random kills, into hard_cases.csv
# make fuzz   random scenes, paths near instabilities, and damaged files
# make peers  the same scenes here, in NGSolve, in FElupe and as plain scripts, timed into peers.csv
#             within ten minutes; make peers-full adds long ones and peers_in_time.csv.  LIMIT=SECONDS
#             ends a run that takes longer
# make bench  counts and seconds of ten fixed scenes, into build/bench.json
# make bench-compare  those beside the committed counts: fails if a count has changed
# make lint   ruff and mypy
# make api    pages of all public names from their docstrings, into build/api
# make pictures  those of README and pages
# make site   all pages as a web site with search and gallery, into build/site/html
# make gallery  the pictures and run times of the gallery, by running all demos (a quarter of an hour)
# make docker the container image (docker/README.md)
# make dist   source archive and wheel, checked, into dist/
# make deb    the Debian package, built and tried in the image, into build/deb
# make clean  remove what the targets above made, except results/

SHELL := /bin/bash
.DEFAULT_GOAL := env

# The stamp's name holds the folder's: a moved or copied .venv is set up anew.
READY := .venv/ready-$(firstword $(shell pwd | cksum))
RUN := PATH="$(CURDIR)/.venv/bin:$$PATH" OMP_NUM_THREADS=1

.PHONY: env demo quick test hard fuzz peers peers-full bench bench-compare lint api pictures site gallery docker dist deb clean

env: $(READY)

$(READY): pyproject.toml .ci/env
	@PYTHON="$(PYTHON)" .ci/env
	@rm -f .venv/ready-*
	@touch $@

demo: env
	$(RUN) mpirun -n 2 .venv/bin/python demos/hdea_two_turn.py --out results/hdea_two_turn

quick: env
	$(RUN) .venv/bin/python -m pytest -m "not slow and not mpi and not demo and not around"

# On all cores: a test that starts mpirun never runs beside another one that does.
test: env
	$(RUN) .venv/bin/python -m pytest -n auto --dist loadgroup

hard: env
	$(RUN) .venv/bin/python tests/hard/run.py

# What is compiled runs on a few cells only, and each scene twice or more.  All four run, whatever
# the others find.
FUZZ := DEA_FENICSX_CFLAGS="-O1 -g0" .venv/bin/python -m

fuzz: env
	$(RUN) sh -c 'found=0; \
	  $(FUZZ) tests.fuzz.physics --count 500 --seed 1 --jobs 2 || found=1; \
	  $(FUZZ) tests.fuzz.paths --count 30 --seed 1 || found=1; \
	  $(FUZZ) tests.fuzz.branches --count 200 --seed 1 || found=1; \
	  $(FUZZ) tests.fuzz.readers --count 50000 --seed 1 --jobs 2 || found=1; \
	  exit $$found'

peers: env
	.venv/bin/python -m pip install --quiet ngsolve felupe
	$(RUN) .venv/bin/python -m tests.peers.run --quick --limit $(or $(LIMIT),60) --out peers.csv

peers-full: env
	.venv/bin/python -m pip install --quiet ngsolve felupe
	$(RUN) .venv/bin/python -m tests.peers.run --limit $(or $(LIMIT),900) --out peers.csv
	$(RUN) .venv/bin/python -m tests.peers.time_run --limit $(or $(LIMIT),900) --out peers_in_time.csv

bench: env
	$(RUN) .venv/bin/python -m tests.bench.run --out build/bench.json

# Where a change of the counts is meant, the same command with --update writes the new ones.
bench-compare: bench
	.venv/bin/python -m tests.bench.compare build/bench.json tests/bench/counts.json

lint: env
	$(RUN) .ci/lint

api: env
	$(RUN) .venv/bin/python -m dea_fenicsx.docs.api build/api

pictures: env
	$(RUN) .venv/bin/python -m dea_fenicsx.docs.pictures

# What the site needs is asked of pip only where it is not there yet, so that the site is then built
# without a network.
SITE_NEEDS := import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["site"])

site: env
	@.venv/bin/python -c 'import sphinx, furo, myst_parser' 2>/dev/null || .venv/bin/python -m pip \
	  install --quiet --disable-pip-version-check $$(.venv/bin/python -c '$(SITE_NEEDS)')
	$(RUN) .venv/bin/python docs/build.py --out build/site

gallery: env
	$(RUN) .venv/bin/python docs/gallery.py

docker:
	docker/build

# Both come from one build, the wheel from the source archive.  The tools live in a venv of their own.
dist: env
	rm -rf dist build/tools && .venv/bin/python -m venv build/tools
	build/tools/bin/python -m pip install --quiet --disable-pip-version-check build twine
	build/tools/bin/python -m build --outdir dist . >build/dist.log || { tail -n 20 build/dist.log; exit 1; }
	build/tools/bin/twine check --strict dist/*

deb:
	packaging/deb container

clean:
	rm -rf hard_cases.csv peers.csv peers_in_time.csv growth.csv to_error.csv .venv build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find dea_fenicsx geometry demos tests -name __pycache__ -type d -prune -exec rm -rf {} +
