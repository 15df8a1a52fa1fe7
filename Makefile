# Two commands matter: `make run` (the main job) and `make test` (everything).
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Installing builds the operator's page from these.
PAGE := hatch_build.py $(wildcard $(foreach kind,css html json mjs svg ts,\
  $(addprefix web/,$(foreach depth,* */* */*/* */*/*/*,$(depth).$(kind)))))
PAGE := $(filter-out web/node_modules/% web/.test-build/%,$(PAGE))

# The cheap tests: the rules of the house, the units, formats, the command line.
DEAR := $(addprefix tests/,test_missing_programs.py test_own_rules.py test_second_chance.py \
  test_wheels_on_arm.py app/test_beliefs.py app/test_hardware_camera.py app/test_hardware_run.py \
  app/test_live_settings.py app/test_operator_sends.py app/test_implement_of_ones_own.py \
  app/test_pose_by_hand.py app/test_taught_rows.py gis/test_many_weeds.py \
  gis/test_weed_files.py autonomy/control/test_follower.py)
QUICK := $(filter-out $(DEAR),$(wildcard $(addprefix tests/,test_*.py $(addsuffix /test_*.py,\
  app core autonomy autonomy/control autonomy/weeds gis ros/messages)))) \
  tests/cli/test_help.py tests/cli/test_hostile_input.py

WORKERS := -n auto --dist loadfile --no-loadscope-reorder
AGAIN := --second-chance
NIGHTLY := -m nightly --nightly-results tests/nightly-results.csv
AS_CODES = $(BIN)/python -m pytest $(WORKERS) -p tests.facts_as_codes
# Words of one shard are joined by +; the last one is everything else.
FARM := tests/mission/test_farm_mission.py
SHARDS := $(FARM) tests/mission+--ignore=$(FARM) tests/ui tests/lab tests/autonomy \
  tests+--ignore=tests/mission+--ignore=tests/ui+--ignore=tests/lab+--ignore=tests/autonomy

# Tests start `agribot` some hundred times: where Python may not keep what it has compiled, each
# start and each test process compiles all of it anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run test nightly facts-as-codes quick quick-tests check pages generate format lint types clean

run: $(VENV)/.run
	$(BIN)/agribot run farm --ui --speed 1

# Two workers more than cores, up to four (tests/conftest.py); a file's tests stay together, and slow
# files come first. What fails is repeated once, alone (tests/second_chance.py).
# Part of it: `make test TESTS=tests/gis`; the dearest twenty: `make test TESTS='--cpu-times 20'`.
test: $(VENV)/.dev
	$(BIN)/python -m pytest $(WORKERS) $(AGAIN) $(TESTS)

# Statistics, long drives, whole missions and browser journeys: all shards, and the tests of the day
# with codes for texts; or `make nightly TESTS=tests/mission`. The table is in CONTRIBUTING.md, the
# last results are in tests/nightly-results.csv.
nightly: $(VENV)/.dev
	failed=0; for shard in $(or $(TESTS),$(SHARDS)); do \
	  $(BIN)/python -m pytest $(WORKERS) $(AGAIN) $(NIGHTLY) $$(echo $$shard | tr + ' ') || failed=1; \
	done; $(if $(TESTS),,$(AS_CODES) || failed=1;) exit $$failed

# Codes and numbers in place of the texts of facts (tests/facts_as_codes.py): what fails depends on
# wording, and is not repeated with the texts. Left out are the tests of the texts themselves, which
# are marked `wording`.
facts-as-codes: $(VENV)/.dev
	$(AS_CODES) $(TESTS)

# While working: it proves less than `make test`.
quick: $(VENV)/.dev
	$(MAKE) --no-print-directory --output-sync --jobs lint types quick-tests

quick-tests: $(VENV)/.dev
	$(BIN)/python -m pytest -q $(WORKERS) -m 'not slow' $(QUICK)

check: lint types test

# The pages that are made from the code: references, architecture, the table of rooms.
pages: $(VENV)/.dev
	$(BIN)/python scripts/write_pages.py

format: $(VENV)/.dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .
	$(BIN)/python scripts/lint_page.py --fix

# What the operator's page and the boards take from Python: messages, the list of screens.
generate: $(VENV)/.dev
	$(BIN)/python scripts/generate_wire.py
	$(BIN)/python scripts/generate_board_wire.py

lint: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/python scripts/lint_language.py
	$(BIN)/python scripts/count_words.py
	$(BIN)/python scripts/lint_page.py

types: $(VENV)/.dev
	$(BIN)/mypy

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "AGRIBOT needs Python 3.11 or newer; set PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)

# The versions of constraints.txt are resolved together, with wheels for Python 3.11 to 3.14 on
# Linux, x86-64 and ARM; pip alone takes the newest of the day.
$(VENV)/.run: $(VENV)/bin/python pyproject.toml constraints.txt $(PAGE)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[sim,ui]'
	@touch $@

# The exact torch is the one whose wheel is a CPU build on the machines that run these tests;
# training elsewhere takes any version that pyproject.toml allows. Python compiles what it loads at
# its first start; pip would compile all of it, for half a minute.
$(VENV)/.dev: $(VENV)/bin/python pyproject.toml constraints.txt $(PAGE)
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt 'torch==2.13.0' --editable '.[sim,ui,train,ros,dds,foxglove,maps,view,sweep,dev]'
	@touch $@
