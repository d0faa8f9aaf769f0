# Everything the lab needs to run stands here; `make help` lists the commands.
PYTHON ?= python3
VENV := .venv
STAMP := $(VENV)/.installed
NOTEBOOK ?= notebooks/00_start_here.ipynb

# Jupyter keeps its settings, layouts and tokens inside the environment: nothing of the user's own set-up is read or written.
JUPYTER_HOME := $(CURDIR)/$(VENV)/var/jupyter
JUPYTER_ENV := JUPYTER_CONFIG_DIR="$(JUPYTER_HOME)/config" JUPYTER_DATA_DIR="$(JUPYTER_HOME)/data" \
    JUPYTER_RUNTIME_DIR="$(JUPYTER_HOME)/runtime"
# JupyterLab asks nobody outside this machine for news, updates or extensions.
OFFLINE := --LabApp.news_url=None --LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate \
    --LabApp.extension_manager=readonly
AS_ROOT := $(if $(filter 0,$(shell id -u)),--allow-root)

.PHONY: help lab test bench notebooks lock clean

help:
	@echo "make lab         install what is missing and open the lab (NOTEBOOK=notebooks/... opens another one)"
	@echo "make test        install what is missing and run every test"
	@echo "make bench       measure speed: simulation, start-up, slider to picture"
	@echo "make notebooks   run every notebook and store the text that its checked cells print, and nothing else"
	@echo "make lock        choose the newest allowed versions and write requirements.lock"
	@echo "make clean       remove the environment and everything generated"
	@echo "PYTHON=python3.12 in front or behind chooses the interpreter (3.11 or newer)."

lab: $(STAMP)
	$(JUPYTER_ENV) $(VENV)/bin/python -m jupyterlab $(AS_ROOT) $(OFFLINE) \
	    --ServerApp.root_dir="$(CURDIR)" --LabApp.default_url=/lab/tree/$(NOTEBOOK)

test: $(STAMP)
	$(VENV)/bin/python -m pytest

bench: $(STAMP)
	$(VENV)/bin/python -m pytest tests/bench tests/browser -o python_files='bench_*.py' --benchmark-only

notebooks: $(STAMP)
	$(VENV)/bin/python tests/notebooks/store_outputs.py

# Locked packages with checked hashes first, then the lab itself, built with what is already there.
$(STAMP): requirements.lock pyproject.toml | $(VENV)/bin/python
	$(VENV)/bin/python -m pip install --disable-pip-version-check --quiet --require-hashes -r requirements.lock
	$(VENV)/bin/python -m pip install --disable-pip-version-check --quiet --no-deps --no-build-isolation -e .
	@mkdir -p $(VENV)/share/jupyter/lab/settings
	@printf '%s\n' '{"@jupyterlab/apputils-extension:notification": {"fetchNews": "false", "checkForUpdates": false}}' \
	    > $(VENV)/share/jupyter/lab/settings/overrides.json
	@touch $@

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "The lab needs Python 3.11 or newer as '$(PYTHON)'; name another one with: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { \
	    package=$$($(PYTHON) -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'); \
	    if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then apt-get update -qq && apt-get install -y -qq $$package; \
	    else echo "Python cannot create environments here; install its venv module (Debian: sudo apt-get install $$package)." >&2; \
	    exit 1; fi; }
	$(PYTHON) -m venv $(VENV)

lock: $(STAMP)
	$(VENV)/bin/python -m pip install --disable-pip-version-check --quiet uv
	$(VENV)/bin/python -m uv pip compile pyproject.toml --all-extras --group build --universal --python-version 3.11 \
	    --fork-strategy fewest --generate-hashes --no-header --no-annotate --upgrade --quiet -o requirements.lock

clean:
	rm -rf $(VENV) .pytest_cache .hypothesis .benchmarks build dist
	find . -name __pycache__ -prune -exec rm -rf {} +
	find . -name .ipynb_checkpoints -prune -exec rm -rf {} +
