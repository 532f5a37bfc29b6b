# `make demo` and `make test` need Python >= 3.11 and make, nothing else: they create .venv.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin

.PHONY: demo test slow everywhere lowest plugin prereleases package clocks verify verify-tenth distributed lint docs site studies bench clean

demo: .venv/test-installed
	$(BIN)/stochvi demo --out out

test: .venv/test-installed
	$(BIN)/python -m pytest -n auto --dist worksteal

# tests that take over a second of CPU time
slow: .venv/test-installed
	$(BIN)/python -m pytest -n auto --dist worksteal -m "slow and not verify"

everywhere: .venv/test-installed
	$(BIN)/python .ci/everywhere.py

# the demo and a part of the suite with the lowest versions that pyproject allows
lowest: .venv/bin/python
	$(BIN)/python .ci/versions.py lowest

# the same with the newest versions, finished or not
prereleases: .venv/bin/python
	$(BIN)/python .ci/versions.py prereleases

# the wheel and the source distribution, as they would be published
package: .venv/package-installed
	rm -rf dist
	$(BIN)/validate-pyproject pyproject.toml docs/plugin/pyproject.toml
	$(BIN)/python -m build --no-isolation
	$(BIN)/twine check --strict dist/*
	$(BIN)/check-wheel-contents dist/*.whl

# the example of a package with parts of its own, installed into a folder of its own
plugin: .venv/test-installed
	folder=$$(mktemp -d) && $(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --no-deps --no-build-isolation --no-index --target $$folder docs/plugin && \
	PYTHONPATH=$$folder $(BIN)/python -m pytest -p no:cacheprovider -c docs/plugin/pyproject.toml docs/plugin && \
	rm -r $$folder

# the suite with clocks that are fast, as on a slow machine, and slow
clocks: .venv/test-installed
	for speed in 6 0.5; do \
	  CLOCK_SPEED=$$speed PYTHONPATH=.ci/clock $(BIN)/python -m pytest -n auto --dist worksteal || exit 1; \
	done

verify: .venv/test-installed
	$(BIN)/python -m pytest -n auto --dist worksteal -m verify

# the tenth of it that was run longest ago; tests/verify_log.csv, to be committed, says which
verify-tenth: .venv/test-installed
	$(BIN)/python .ci/verify_tenth.py --log

distributed: .venv/test-installed .venv/distributed-installed
	$(BIN)/python -m pytest -m "" tests/motion/test_long_runs.py tests/sampling -k "dask or cluster"

lint: .venv/dev-installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python docs/_extensions/docstrings.py

docs: .venv/docs-installed
	$(BIN)/python -m sphinx --jobs auto --write-all --fail-on-warning --keep-going --nitpicky -b html docs docs/_build/html
	$(BIN)/python docs/_extensions/links.py docs/_build/html

# the manual beside those of other versions that stand in `site`, among which readers choose
site: docs
	$(BIN)/python docs/_extensions/manuals.py docs/_build/html site

studies: .venv/test-installed
	for study in studies/*/run.py; do $(BIN)/python $$study || exit 1; done

bench: .venv/bench-installed
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python studies/02_cost_of_accuracy/run.py --libraries
	$(BIN)/python studies/23_time_of_every_job/run.py --history

.venv/bin/python:
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "stochvi needs Python 3.11 or newer"'
	$(PYTHON) -m venv .venv

.venv/%-installed: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[$*]'
	touch $@

clean:
	rm -rf .venv out dist docs/_build
