# Two commands for a newcomer: make demo, make test. Everything lives in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

BOUNDS_CACHE := $(CURDIR)/.bounds_cache
# Each process begins with a third of the tests and takes over what others have left: what a file makes is made once.
# Two cores have room for a third, since tests wait for cameras, gates and browsers.
ON_TWO_CORES := -n 3 --dist worksteal

.PHONY: demo console test test-all test-bounds test-rest durations freeze check fuzz bench docs site changelog format lock deb clean
.DELETE_ON_ERROR:

demo: $(VENV)/.installed
	$(BIN)/prooflight demo

# A job printed live on the simulated press, in the browser at http://127.0.0.1:8080. Ctrl-C ends it.
console: $(VENV)/.installed
	$(BIN)/prooflight serve --demo

# Tests that take more than a second are left out; pytest says at its start how long it takes and what is left out.
test: $(VENV)/.installed-dev
	$(BIN)/pytest $(ON_TWO_CORES) -m "not slow"

test-all: $(VENV)/.installed-dev
	$(BIN)/pytest $(ON_TWO_CORES)

# Runs all tests and records which of them are slow.
durations: $(VENV)/.installed-dev
	$(BIN)/pytest $(ON_TWO_CORES) --record-durations tests/durations.json

# Measures the frozen figures again, and how far other processors move them; only for a change that is meant to change
# these figures.
freeze: $(VENV)/.installed-dev
	$(BIN)/python -m tests.frozen

# Compiled code that looks whether each index lies within its array, which takes several times as long; what is compiled
# otherwise is kept apart. The tests of what calls kernels: rooms, and of rooms that hardly do the files that do. Commands,
# reports and studies call no others. Slow tests are left out, for time.
CALL_KERNELS := tests/kernels tests/scans tests/registration tests/detectors tests/prediction \
	tests/inspection/codes tests/inspection/test_inspector.py tests/inspection/test_lost_lines.py \
	tests/inspection/test_packed_design.py \
	tests/properties tests/simulation packages/line/tests/journal/test_damaged.py packages/line/tests/journal/test_replay.py \
	packages/line/tests/run/test_pager.py packages/line/tests/run/test_runner_parts.py packages/line/tests/run/test_working_memory.py \
	tests/pages/test_taking_together.py
test-bounds: $(VENV)/.installed-dev
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(BOUNDS_CACHE) $(BIN)/pytest $(ON_TWO_CORES) -m "not slow" $(CALL_KERNELS)

# All tests but those that test-bounds runs.
test-rest: $(VENV)/.installed-dev
	$(BIN)/pytest $(ON_TWO_CORES) --no-quick-of $(CALL_KERNELS)

check: $(VENV)/.installed-dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/codespell src packages studies tests validation examples docs changes README.md CONTRIBUTING.md CHANGELOG.md

# A minute of spoilt files for every reader: each must be read, or refused in one line.
fuzz: $(VENV)/.installed-dev
	$(BIN)/python -m tests.fuzz --seconds 60 --seed 1

bench: $(VENV)/.installed
	$(BIN)/prooflight bench

# The documents name files, functions and commands that exist, and their commands run.
docs: $(VENV)/.installed-dev
	$(BIN)/pytest tests/test_docs.py tests/docs

# The rendered documents: open site/index.html. Runs every file of examples/.
site: $(VENV)/.installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

format: $(VENV)/.installed-dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# The lock names all that is needed, so that pip need not search for what depends on what.
$(VENV)/.installed: requirements/run.txt pyproject.toml $(wildcard */pyproject.toml packages/*/pyproject.toml)
	@echo "Installing into $(VENV), which takes a minute or two"
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --no-deps --require-hashes -r requirements/run.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e . -e packages/line -e packages/console -e studies
	touch $@

$(VENV)/.installed-dev: requirements/dev.txt $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/dev.txt
	touch $@

$(VENV)/.installed-docs: requirements/docs.txt $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/docs.txt
	touch $@

# Moves the fragments of changes/ into CHANGELOG.md, under the version of pyproject.toml.
changelog: $(VENV)/.installed-dev
	$(BIN)/towncrier build --yes

# Rewrites all lock files from the packages' pyproject.toml; needs uv on the path. The extra gpu is left out: tests that need it skip.
PROJECTS := pyproject.toml packages/line/pyproject.toml packages/console/pyproject.toml studies/pyproject.toml
OURS := $(foreach name,prooflight prooflight-line prooflight-console,--no-emit-package $(name))
lock:
	uv pip compile $(PROJECTS) --extra pdf --extra demo --extra plant --extra hot-folder --group build \
		--universal --python-version 3.11 \
		--generate-hashes --no-header --quiet $(OURS) -o requirements/run.txt
	uv pip compile $(PROJECTS) --extra pdf --extra demo --extra viva --extra basler \
		--extra plant --extra hot-folder --extra records --extra otel --extra oidc --extra cluster --group build --group dev --universal --python-version 3.11 \
		--generate-hashes --no-header --quiet $(OURS) -c requirements/run.txt \
		-o requirements/dev.txt
	uv pip compile --group build --universal --python-version 3.11 --generate-hashes --no-header --quiet \
		-c requirements/run.txt -o requirements/build.txt
	uv pip compile pyproject.toml packages/line/pyproject.toml packages/console/pyproject.toml --extra pdf --extra demo \
		--extra plant --extra hot-folder --extra records --extra otel --extra oidc --universal --python-version 3.11 \
		--generate-hashes --no-header --quiet $(OURS) -c requirements/dev.txt -o requirements/image.txt
	uv pip compile --group docs --universal --python-version 3.11 \
		--generate-hashes --no-header --quiet -c requirements/run.txt -c requirements/dev.txt -o requirements/docs.txt

# dist/prooflight_VERSION_ARCH.deb, for the Debian of this machine.
deb:
	packaging/build-deb.sh

clean:
	rm -rf $(VENV) $(BOUNDS_CACHE) site .mypy_cache .ruff_cache .pytest_cache .import_linter_cache prooflight-demo
