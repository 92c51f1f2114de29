# From a bare checkout with Python 3.11 or newer, g++ and make:
#
#   make report                 fit a rock, ice and olivine, and write a page that grows with each fit
#   make study                  the same page with the whole study: all fits and the paper's statements
#                               (PRESET=paper for chains of full length, of both)
#   make test                   the fast test suite
#   make lint                   format, style and types
#   make docs                   the documentation site, build/site/index.html
#   make notebooks             run the notebooks and renew the outputs in notebooks/
#   make bench                  sampling benchmark against the paper's form, about 40 minutes
#   make clean                  remove what make wrote (never runs/, never CmdStan)
#
# PYTHON=/path/to/python picks the interpreter for the virtual environment.

PRESET ?= quick

VENV := .venv
BIN := $(VENV)/bin
CANDIDATES := python3 python3.14 python3.13 python3.12 python3.11

.PHONY: help report study test lint docs notebooks bench clean venv install cmdstan

help:
	@sed -n '2,/^$$/s/^# \{0,1\}//p' Makefile

report: cmdstan
	@echo "==> Running the main part of the study with preset '$(PRESET)'"
	@$(BIN)/python reports/study.py --main --preset $(PRESET) --out report

study: cmdstan
	@echo "==> Running the whole study with preset '$(PRESET)'"
	@$(BIN)/python reports/study.py --preset $(PRESET) --out report

test: cmdstan
	@echo "==> Running the fast test suite"
	@$(BIN)/python -m pytest -n logical --dist loadfile --no-loadscope-reorder

lint: $(VENV)/.lint-installed
	@echo "==> Checking format, style and types"
	@$(BIN)/ruff format --check
	@$(BIN)/ruff check
	@$(BIN)/mypy
	@echo "==> Listing sentences that are hard to read at once (they fail nothing)"
	@$(BIN)/python docs/site/sentences.py

docs: cmdstan $(VENV)/.docs-installed
	@echo "==> Building the site: its pages run their commands, which takes some minutes"
	@$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going -c docs/site . build/site
	@echo "==> build/site/index.html"

notebooks: cmdstan $(VENV)/.docs-installed
	@echo "==> Running the notebooks, which takes some minutes"
	@$(BIN)/python docs/site/notebook_runs.py notebooks/*.ipynb

bench: cmdstan $(VENV)/.installed
	@echo "==> Measuring the sampler against the paper's form"
	@$(BIN)/python benchmarks/sampling.py
	@echo "==> Measuring gradients with both solvers"
	@$(BIN)/python benchmarks/solvers.py

clean:
	@echo "==> Removing the virtual environment, caches and report/"
	@rm -rf $(VENV) report build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache
	@find . -name __pycache__ -type d -not -path './runs/*' -prune -exec rm -rf {} +

venv: $(VENV)/.created

install: $(VENV)/.installed

cmdstan: $(VENV)/.installed
	@echo "==> Making sure that CmdStan is there"
	@$(BIN)/pyburgers install-cmdstan

# The files below mark finished steps, so that a second run starts at once and a step that was
# interrupted is done again.

$(VENV)/.created:
	@python='$(PYTHON)'; \
	suits='import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))'; \
	for candidate in $(if $(PYTHON),,$(CANDIDATES)); do \
	  if "$$candidate" -c "$$suits" >/dev/null 2>&1; then python=$$candidate; break; fi; \
	done; \
	if [ -z "$$python" ]; then \
	  echo "No suitable Python was found among $(CANDIDATES): Python 3.11 or newer with the" \
	    "modules venv and ensurepip is needed (on Debian and Ubuntu: apt-get install" \
	    "python3-venv); PYTHON=/path/to/python names another one." >&2; \
	  exit 1; \
	fi; \
	echo "==> Creating the virtual environment $(VENV) with $$("$$python" --version)"; \
	"$$python" -m venv --clear $(VENV)
	@touch $@

$(VENV)/.installed: pyproject.toml $(VENV)/.created
	@echo "==> Installing pyburgers and its dependencies into $(VENV) (about a minute)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test]'
	@touch $@

$(VENV)/.docs-installed: $(VENV)/.installed
	@echo "==> Installing Sphinx into $(VENV)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test,docs]'
	@touch $@

$(VENV)/.lint-installed: $(VENV)/.installed
	@echo "==> Installing ruff, mypy and type stubs into $(VENV)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test,docs,lint]'
	@touch $@
