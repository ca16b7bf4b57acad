# Everything here sets up what it needs by itself: a virtual environment in .venv with the pinned versions.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RUN := OMP_NUM_THREADS=1 $(BIN)/python
INSTALLED := $(VENV)/.installed

CHROMIUM ?= chromium

.PHONY: setup quickstart check test test-slow benchmark fidelity presets goal-pictures report-picture agents notebook docs types lint format clean

setup: $(INSTALLED)

$(INSTALLED): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $@

quickstart: $(INSTALLED)   ## some minutes: trains sac on stack2 until it stacks, shows what it learned, films it
	test -f runs/quickstart/result.json || $(BIN)/curiobench train --task stack2 --method sac --starts biased --seed 0 --machine.threads 2 --resume --out runs/quickstart
	$(BIN)/curiobench table runs/quickstart
	$(BIN)/curiobench video runs/quickstart --goal "a on b" --out runs/quickstart/a_on_b.gif

check: lint types   ## what CI runs: linter, types, all tests but the slow ones, and which branches they miss
	$(RUN) -m pytest -n 2 --durations 10 --cov --cov-report term:skip-covered

test: $(INSTALLED)   ## all tests but the slow ones
	$(RUN) -m pytest -n 2 --durations 10

test-slow: $(INSTALLED)   ## the checks that take minutes
	$(RUN) -m pytest -n 2 -m slow --durations 10

benchmark: $(INSTALLED)   ## ratios measured side by side; leave the machine alone meanwhile
	$(RUN) -m pytest tests/benchmarks --benchmark-only -m "slow or not slow" -p no:xdist -s

fidelity: $(INSTALLED)   ## measures the numbers of docs/fidelity.md and draws its pictures
	$(RUN) docs/make_fidelity.py

presets: $(INSTALLED)   ## writes tables of the docs from the runs in results/
	$(RUN) docs/make_presets.py
	$(RUN) docs/make_methods.py

goal-pictures: $(INSTALLED)   ## draws the pictures of goals that reports show
	$(RUN) docs/make_goal_pictures.py

report-picture: $(INSTALLED)   ## photographs the top of the report on results/v2; needs Chromium
	$(CHROMIUM) --headless --no-sandbox --disable-gpu --hide-scrollbars --disable-background-networking \
		--user-data-dir=$$(mktemp -d) --window-size=1280,1500 --screenshot=docs/images/report.png \
		file://$(CURDIR)/results/v2/report.html

agents: $(INSTALLED)   ## films the agents of a published set, SET=results/v2, for the page docs/agents.md
	$(RUN) docs/make_agents.py $(SET)

notebook: $(INSTALLED)   ## executes docs/notebook.ipynb in a clean folder and keeps its outputs; test-slow executes it, too
	rm -rf build/notebook
	mkdir -p build/notebook
	cp docs/notebook.ipynb build/notebook
	cd build/notebook && OMP_NUM_THREADS=1 $(CURDIR)/$(BIN)/jupyter execute --inplace notebook.ipynb
	cp build/notebook/notebook.ipynb docs

docs: $(INSTALLED)   ## builds the site from the README, docs/ and the docstrings into build/docs
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[docs]'
	$(RUN) -m sphinx --quiet --fresh-env --fail-on-warning --keep-going -c docs . build/docs
	cp build/docs/README.html build/docs/index.html

types: $(INSTALLED)   ## mypy on methods/ and tasks/
	mkdir -p build/types/curiobench
	ln -sfn $(CURDIR)/methods $(CURDIR)/tasks build/types/curiobench
	$(BIN)/mypy

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) build *.egg-info .coverage* .mypy_cache .pytest_cache .ruff_cache .hypothesis
