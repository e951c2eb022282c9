# Everything from a fresh clone: `make demo` shows it, `make test` checks it.

SCALE ?= paper
RECIPE ?=
PRESET ?= cpu
PYTHON ?= python3
WORKERS ?=
PIP_ARGS ?=
PORT ?= 8080
# Translators that ship, to stand beside those trained here.
SHIPPED ?=

# Libraries are installed without bytecode, which the first import writes; where this is forbidden,
# each process compiles them again.
export PYTHONDONTWRITEBYTECODE :=

BIN := .venv/bin
# A dataset and its runs go by the name of their recipe, and runs of another preset by that too.
NAME = $(or $(basename $(notdir $(RECIPE))),$(SCALE))
DATA = data/$(NAME)
RUNS = runs/$(NAME)$(if $(filter cpu,$(PRESET)),,-$(PRESET))
WORKERS_FLAG := $(if $(WORKERS),--workers $(WORKERS))
MINUTES_FLAG := $(if $(MINUTES),--minutes $(MINUTES))

# pytest's workers: one more than cores (tests/conftest.py), 8 at most; or as many as WORKERS says.
TEST := $(BIN)/python -m pytest -n $(or $(WORKERS),logical) --maxprocesses 8

SCHEMA := $(BIN)/check-jsonschema --builtin-schema

.PHONY: help demo test test-all setup system browser primitives simdata train-all evaluate report studio \
	regression lerobot-check bench check \
	wheel wheel-demo weights docs check-files clean distclean

help:
	@echo "make demo        everything at scale small: data, both translators, report  MINUTES="
	@echo "make test        install, then the test suite with the RMSE regression"
	@echo "make test-all    the same with the exhaustive tests (all bad inputs, all shapes)"
	@echo "make setup       virtual environment and pinned packages"
	@echo "make primitives  STEP, STL, mosaic plate and contact sheet of all shapes"
	@echo "make simdata     the paired dataset         SCALE=smoke|light|small|paper (paper), or RECIPE=open|FILE.toml"
	@echo "make train-all   both translators           SCALE=, PRESET=cpu|paper|smoke, MINUTES="
	@echo "make evaluate    the results table          SCALE=, SHIPPED=field"
	@echo "make report      the report                 SCALE=, SHIPPED=field"
	@echo "make studio      press, look and translate in a browser          PORT="
	@echo "make regression  RMSE on synthetic data held to its band"
	@echo "make lerobot-check  a converted dataset, read with LeRobot's own loader   SCALE="
	@echo "make bench       speed and fidelity, kept in benchmarks/results"
	@echo "make check       ruff, pyright, layers, import cycles, sizes of modules, sentences of the documents"
	@echo "make wheel       sdist and wheel in dist/, checked and tried from an empty folder"
	@echo "make wheel-demo  the demo of the wheel in dist/, in an empty folder   MINUTES= (3)"
	@echo "make weights     the pretrained networks as a zip file in dist/"
	@echo "make check-files workflows, issue forms, citation and pre-commit against their schemas"
	@echo "make docs        the documentation site, in build/site"
	@echo "make clean       delete build products: caches of tools and of Python, build folders"
	@echo "make distclean   delete these, data, runs and .venv"

demo: setup
	$(BIN)/t2twin demo $(MINUTES_FLAG)

test: setup browser
	$(TEST) -m "not exhaustive"

test-all: setup browser
	$(TEST)

setup: .venv/installed

.venv/installed: pyproject.toml constraints.txt | system
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15))' || \
		{ echo "$(PYTHON) will not do: Python 3.11 to 3.14 is needed; name it with PYTHON="; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check $(PIP_ARGS) \
		-c constraints.txt -e '.[dev]'
	touch $@

# Headless OpenGL (EGL) for pyrender and libGL for the CAD kernel: installed where we may, else named.
LIBRARIES := libegl1 libgl1 libgl1-mesa-dri
system:
	@ldconfig -p 2>/dev/null | grep -q 'libEGL.so.1' && ldconfig -p | grep -q 'libGL.so.1' && exit 0; \
	if [ "$$(uname)" != Linux ]; then exit 0; fi; \
	if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
		echo "installing $(LIBRARIES)"; \
		apt-get update -qq && apt-get install -y -qq $(LIBRARIES) >/dev/null; \
	else \
		echo "headless OpenGL is missing; install it with: sudo apt-get install $(LIBRARIES)"; exit 1; \
	fi

# A browser for the studio's tests, which are skipped without one.
browser:
	@if command -v chromium >/dev/null || [ "$$(uname)" != Linux ]; then exit 0; fi; \
	if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
		echo "installing chromium"; \
		apt-get update -qq && apt-get install -y -qq chromium >/dev/null && exit 0; \
	fi; \
	echo "there is no browser for the studio's tests; install it with: sudo apt-get install chromium"

primitives: setup
	$(BIN)/t2twin primitives --out data/primitives

simdata: setup
	$(BIN)/t2twin simdata $(if $(RECIPE),--recipe $(RECIPE),--scale $(SCALE)) --out $(DATA) $(WORKERS_FLAG)

train-all: setup
	$(BIN)/t2twin train touch2touch --data $(DATA) --preset $(PRESET) --out $(RUNS)/touch2touch $(MINUTES_FLAG)
	$(BIN)/t2twin train resnet18 --data $(DATA) --preset $(PRESET) --out $(RUNS)/resnet18 $(MINUTES_FLAG)

evaluate: setup
	$(BIN)/t2twin evaluate $(SHIPPED) $(RUNS)/touch2touch $(RUNS)/resnet18 --data $(DATA) --split both \
		--out $(RUNS)/evaluate

report: setup
	$(BIN)/t2twin report --data $(DATA) --runs $(SHIPPED) $(RUNS)/touch2touch $(RUNS)/resnet18 --out $(RUNS)/report

studio: setup
	$(BIN)/t2twin studio --port $(PORT)

regression: setup
	$(BIN)/python -m pytest tests/test_regression.py

# LeRobot pins an older torch and needs torchvision. Its loader runs in an environment of its own,
# where a stand-in replaces torchvision and torch is the project's.
LEROBOT := .venv/lerobot/bin/python
LEROBOT_PIP := $(LEROBOT) -m pip install --quiet --disable-pip-version-check $(PIP_ARGS)
lerobot-check: setup
	$(BIN)/python -m venv .venv/lerobot
	$(LEROBOT_PIP) 'av>=15,<16' 'datasets>=4.8,<5' deepdiff draccus einops gymnasium jsonlines psutil termcolor
	$(LEROBOT_PIP) --no-deps accelerate lerobot
	$(LEROBOT) -c 'import sysconfig; here = sysconfig.get_path("purelib"); \
		open(here + "/project.pth", "w").write(here.replace("/.venv/lerobot/", "/.venv/"))'
	rm -rf $(DATA)-lerobot
	$(BIN)/t2twin convert $(DATA) --to lerobot --out $(DATA)-lerobot
	HF_HUB_OFFLINE=1 $(LEROBOT) -m maintenance.check_lerobot $(DATA) $(DATA)-lerobot

bench: setup
	$(BIN)/python -m benchmarks

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports --no-logo --no-cache
	$(BIN)/python -m pytest -q --noconftest tests/test_structure.py tests/test_sentences.py

docs: setup
	NO_MKDOCS_2_WARNING=1 PYTHONPATH=. $(BIN)/mkdocs build --quiet

.venv/release: .venv/installed
	$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check $(PIP_ARGS) \
		-c constraints.txt build check-jsonschema check-wheel-contents pre-commit twine
	touch $@

# The wheel is built from the sdist.
wheel: .venv/release
	rm -rf build/lib build/bdist.* dist
	$(BIN)/python -m build --no-isolation --outdir dist
	$(BIN)/twine check --strict dist/*
	$(BIN)/check-wheel-contents dist/*.whl
	$(BIN)/python -m maintenance.check_wheel

wheel-demo: setup
	$(BIN)/python -m maintenance.check_wheel demo --minutes $(or $(MINUTES),3)

weights:
	mkdir -p dist
	cd translate/weights && $(abspath $(BIN))/python -m zipfile -c $(CURDIR)/dist/t2twin-weights.zip */

check-files: .venv/release
	$(SCHEMA) vendor.github-workflows .github/workflows/*.yml
	$(SCHEMA) custom.github-workflows-require-timeout .github/workflows/*.yml
	$(SCHEMA) vendor.github-issue-forms $(filter-out %/config.yml,$(wildcard .github/ISSUE_TEMPLATE/*.yml))
	$(SCHEMA) vendor.github-issue-config .github/ISSUE_TEMPLATE/config.yml
	$(SCHEMA) vendor.citation-file-format CITATION.cff
	$(BIN)/pre-commit validate-config

clean:
	rm -rf .pytest_cache .ruff_cache build dist *.egg-info
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

distclean: clean
	rm -rf data runs .venv
