# Needs only python3 with venv, make and git. Everything it makes stays in this folder, except system
# packages, for drawing pictures and for the browser tests, which tools/ensure_*.sh install for root.
.DEFAULT_GOAL := help
.PHONY: help setup run test test-system bounds extras dist docs bench bench-peers clean
UV_VERSION := 0.13.9
SEED ?= 1
BIN := .venv/bin

export UV_CACHE_DIR := $(CURDIR)/.cache/uv
export UV_PYTHON_DOWNLOADS := never
export UV_PYTHON_PREFERENCE := only-system
export UV_SYSTEM_CERTS := 1
export MESA_SHADER_CACHE_DIR := $(CURDIR)/.cache/mesa
unexport VIRTUAL_ENV PYTHONPATH PYTHONHOME
unexport PYTHONDONTWRITEBYTECODE  # without it, every start of Python compiles everything anew

help:  ## List the targets
	@sed -nE 's/^([a-z-]+):.*## (.*)/  make \1\t\2/p' Makefile | expand -t 20
setup: .venv/.synced  ## Make .venv from the lock file, and see that pictures can be drawn
	@tools/ensure_opengl.sh
run: setup  ## One trial under every disturbance, with its page (SEED=n for another)
	$(BIN)/pliant run --peg circle --condition all --seed $(SEED) --reasoner rules
test: setup  ## Style, types, layers, the wheel and the tests
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo --cache-dir .cache/import-linter
	tools/smoke_wheel.sh
	PYTHONWARNDEFAULTENCODING=1 $(BIN)/pytest -n auto
test-system: setup .cache/venv-system/.synced  ## Tests that need a server or a browser
	@tools/ensure_system.sh
	PYTHONWARNDEFAULTENCODING=1 .cache/venv-system/bin/pytest -m system -n 2 --dist loadfile --no-loadscope-reorder
bounds: setup  ## Tests with every dependency at its lowest, then at its highest version
	tools/try_bounds.sh lowest
	tools/try_bounds.sh highest
extras: setup  ## The wheel with each extra alone, on each Python that is here, and its types
	tools/smoke_extras.sh
dist: .tools/uv-$(UV_VERSION)  ## The wheels of pliant, its benchmark's cases and its own model, into dist
	tools/build_wheels.sh dist
docs: .cache/venv-docs/.synced  ## The documentation as a site that needs no network: site/index.html
	tools/build_docs.sh
bench: setup  ## Measure what a trial costs, into docs/speed.md
	$(BIN)/python benchmarks/speed.py --page docs/speed.md
bench-peers: setup  ## Measure speed beside robosuite's, which gets an environment of its own
	$(BIN)/python benchmarks/against_robosuite.py
clean:  ## Remove what make made, but not the results in runs/
	rm -rf .venv .tools .cache .hypothesis dist site
.tools/uv-$(UV_VERSION):
	python3 -m venv --clear .tools
	.tools/bin/pip install --quiet --no-cache-dir --disable-pip-version-check uv==$(UV_VERSION)
	touch $@
.venv/.synced: pyproject.toml uv.lock .tools/uv-$(UV_VERSION)
	.tools/bin/uv sync --frozen --quiet
	touch $@
.cache/venv-system/.synced: pyproject.toml uv.lock .tools/uv-$(UV_VERSION)
	UV_PROJECT_ENVIRONMENT=.cache/venv-system .tools/bin/uv sync --frozen --quiet --extra local --extra ray --extra rerun --extra ur5e --extra vlm --group system
	touch $@
.cache/venv-docs/.synced: pyproject.toml uv.lock .tools/uv-$(UV_VERSION)
	UV_PROJECT_ENVIRONMENT=.cache/venv-docs .tools/bin/uv sync --frozen --quiet --only-group docs
	touch $@
