# Everything the lab needs to run stands here; `make help` lists the commands.
PYTHON ?= python3
VENV := .venv
LAB := $(VENV)/.lab-installed
TOOLS := $(VENV)/.tools-installed
MINE ?= my-lab
NOTEBOOK ?= $(MINE)/00_start_here.ipynb
FUZZ_INPUTS ?= 100000

# Jupyter keeps its settings, layouts and tokens inside the environment: nothing of the user's own set-up is read or written.
JUPYTER_HOME := $(CURDIR)/$(VENV)/var/jupyter
JUPYTER_ENV := JUPYTER_CONFIG_DIR="$(JUPYTER_HOME)/config" JUPYTER_DATA_DIR="$(JUPYTER_HOME)/data" \
    JUPYTER_RUNTIME_DIR="$(JUPYTER_HOME)/runtime"
# JupyterLab asks nobody outside this machine for news, updates or extensions.
OFFLINE := --LabApp.news_url=None --LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate \
    --LabApp.extension_manager=readonly
# A message never waits for another before it leaves, and kernels do not report a moved slider back to the page that moved it.
QUICK := --ServerApp.kernel_websocket_connection_class=labkit.server.PromptConnection
JUPYTER_ENV += JUPYTER_WIDGETS_ECHO=0
AS_ROOT := $(if $(filter 0,$(shell id -u)),--allow-root)

PIP := $(VENV)/bin/python -m pip --disable-pip-version-check --quiet
UV := $(VENV)/bin/uv --quiet
# Both installers check the same hashes. uv needs a tenth of the time; pip is there for whoever has its mirrors and certificates set
# up in pip alone. Neither compiles: Python does so for what is used, a seventh of it, when it is used first.
install = $(UV) pip install --python $(VENV)/bin/python $(1) || $(PIP) install --no-compile $(1)

unexport PYTHONDONTWRITEBYTECODE  # else everything would be compiled again at every start

.PHONY: help lab test check fuzz bench notebooks stills lock clean

help:
	@echo "make lab         install what is missing and open the lab in $(MINE), your own copy (NOTEBOOK=... opens another one)"
	@echo "make test        install what is missing, the test tools too, and run every test"
	@echo "make check       form, lint and types: ruff and mypy, as .ci/run demands them"
	@echo "make fuzz        damaged input for every reader and command, $(FUZZ_INPUTS) pieces each (FUZZ_INPUTS=...)"
	@echo "make bench       measure speed: simulation, start-up, slider to picture"
	@echo "make notebooks   run every notebook and store the text that its checked cells print, and nothing else"
	@echo "make stills      draw the pictures of the README anew, from the experiments"
	@echo "make lock        choose the newest allowed versions and write requirements.lock and requirements-test.lock"
	@echo "make clean       remove the environment and everything generated"
	@echo "PYTHON=python3.12 in front or behind chooses the interpreter (3.11 to 3.14)."

lab: $(LAB)
	@$(VENV)/bin/python -m labkit.workcopy notebooks "$(MINE)"
	@$(VENV)/bin/python -m labkit.workcopy notebooks/reference "$(MINE)/reference"
	$(JUPYTER_ENV) $(VENV)/bin/python -m jupyterlab $(AS_ROOT) $(OFFLINE) $(QUICK) \
	    --ServerApp.root_dir="$(CURDIR)" --LabApp.default_url=/lab/tree/$(NOTEBOOK)

# How many processes: see tests/conftest.py.
test: $(TOOLS)
	$(VENV)/bin/python -m pytest -n auto

check: $(TOOLS)
	$(VENV)/bin/python -m ruff format --check .
	$(VENV)/bin/python -m ruff check .
	$(VENV)/bin/python -m mypy

# Every piece has a time limit of its own, so that the test as a whole needs none.
fuzz: $(TOOLS)
	FUZZ_INPUTS=$(FUZZ_INPUTS) $(VENV)/bin/python -m pytest tests/fuzz -o faulthandler_timeout=0

bench: $(TOOLS)
	$(VENV)/bin/python -m pytest tests/bench tests/browser -o python_files='bench_*.py' --benchmark-only

notebooks: $(TOOLS)
	$(VENV)/bin/python tests/notebooks/store_outputs.py

stills: $(TOOLS)
	PYTHONPATH=. $(VENV)/bin/python tests/notebooks/make_stills.py

# Locked packages with checked hashes first (uv itself before the others), then the lab, built with what is already there.
$(LAB): requirements.lock pyproject.toml | $(VENV)/bin/python
	-@sed -n '/^uv==/,/[^\]$$/p' requirements.lock | $(PIP) install --only-binary :all: --require-hashes -r /dev/stdin
	@$(call install,--no-deps --require-hashes -r requirements.lock)
	@$(call install,--no-deps --no-build-isolation -e .)
	@mkdir -p $(VENV)/share/jupyter/lab/settings
	@printf '%s\n' '{"@jupyterlab/apputils-extension:notification": {"fetchNews": "false", "checkForUpdates": false}}' \
	    > $(VENV)/share/jupyter/lab/settings/overrides.json
	@$(VENV)/bin/python -c 'import ipykernel.kernelapp, labkit.bench, pandas'  # compiled now, so that the first figure need not wait
	@touch $@

$(TOOLS): requirements-test.lock $(LAB)
	@$(call install,--no-deps --require-hashes -r requirements-test.lock)
	@touch $@

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15))' || \
	    { echo "The lab needs Python 3.11 to 3.14 as '$(PYTHON)'; name another one with: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { \
	    package=$$($(PYTHON) -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'); \
	    if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then apt-get update -qq && apt-get install -y -qq $$package; \
	    else echo "Python cannot create environments here; install its venv module (Debian: sudo apt-get install $$package)." >&2; \
	    exit 1; fi; }
	$(PYTHON) -m venv $(VENV)

# The second file holds what the tests need beyond the first; a package that the first has for some machines only stands in both.
# jsonschema does without a grammar of internationalised addresses; building it took two seconds of every start of the server.
COMPILE = $(UV) pip compile pyproject.toml --universal --python-version 3.11 --fork-strategy fewest --generate-hashes \
    --no-header --no-annotate --upgrade --no-emit-package rfc3987-syntax --no-emit-package lark
lock: $(LAB)
	$(COMPILE) --group build -o requirements.lock
	$(COMPILE) --all-extras --group check -c requirements.lock -o requirements-test.lock \
	    $$(sed -n 's/^\([a-z0-9.-]*\)==[^ ]* \\$$/--no-emit-package \1/p' requirements.lock)

clean:
	rm -rf $(VENV) .pytest_cache .hypothesis .benchmarks .mypy_cache .ruff_cache build dist
	find . -name __pycache__ -prune -exec rm -rf {} +
	find . -name .ipynb_checkpoints -prune -exec rm -rf {} +
