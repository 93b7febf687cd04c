# `make train` and `make test` work on a fresh machine: they make .venv first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DOCS_STAMP := $(VENV)/.docs-installed
# Processes for CPU training and tests: Warp's CPU device is single-threaded, so one per core, up to two.
WORKERS ?= $(shell nproc 2>/dev/null | awk '{print ($$1 > 2) ? 2 : $$1}')
HAS_GPU := $(shell nvidia-smi -L 2>/dev/null | head -1)
TRAIN_MINUTES ?= 5
# Expanded once, so that the video shows what was trained; `make train RUN=runs/first` names another folder.
RUN := runs/train-$(shell date +%Y%m%d-%H%M%S)

.PHONY: setup train reproduce test mutants lint format type docs bench clean

setup: $(STAMP)

$(STAMP): pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "Installing into $(VENV): once, about four minutes, most of them for torch"
	@$(BIN)/python -m pip install --disable-pip-version-check torch==2.13.0
	@$(BIN)/python -m pip install --disable-pip-version-check -e '.[dev]'
	@touch $@

train: setup
	@echo "Trains for $(TRAIN_MINUTES) minutes, evaluates for one or two, and makes a video. After five minutes on two cores expect"
	@echo "a policy that reaches half of the goals in wide corridors (level 0 in the progress line is 1.6 m, level 1 the"
	@echo "benchmark's 1.0 m) and hardly any of the benchmark's. nav-cvo, which is shipped, took 80 minutes."
ifeq ($(HAS_GPU),)
	OMP_NUM_THREADS=1 $(BIN)/torchrun --nproc-per-node=$(WORKERS) -m spin_rl.cli.train \
		run_dir=$(RUN) max_minutes=$(TRAIN_MINUTES) evaluate=25 $(ARGS)
else
	$(BIN)/spin-train run_dir=$(RUN) max_minutes=$(TRAIN_MINUTES) evaluate=100 $(ARGS)
endif
	OMP_NUM_THREADS=1 $(BIN)/spin-play policy=$(RUN) difficulty=easy episodes=2 seed=0 samples=1 \
		task.episode_s=15 video=$(RUN)/play.mp4
	@echo "After 80 minutes it looks like this: $(BIN)/spin-play policy=nav-cvo"

# Whole files go to a process, which keeps what their tests share; both fill one cache of compiled kernels.
test: setup
	@echo "All tests, $(WORKERS) at a time: about five minutes on two idle cores. Without the slow ones:"
	@echo "    make test ARGS='-m \"not slow\"'"
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses $(WORKERS) --dist loadfile $(ARGS)

# Every training and evaluation of the comparison with the paper: hours. ARGS=run=false lists them, ARGS=only=fixcam or
# ARGS=minutes=120 takes a part, and the next call goes on. What is measured goes into docs/results.md.
reproduce: setup
	$(BIN)/spin-reproduce run=true $(ARGS); status=$$?; \
	$(BIN)/spin-eval table=all out=docs/results.md >/dev/null && exit $$status

# Whether the tests notice what breaks; some minutes.
mutants: setup
	OMP_NUM_THREADS=1 $(BIN)/python tests/mutants/run.py $(ARGS)

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

type: setup
	$(BIN)/pyright

# The site, from docs/ and docstrings; a warning is an error. Open site/index.html.
docs: $(DOCS_STAMP)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

$(DOCS_STAMP): $(STAMP)
	@$(BIN)/python -m pip install --disable-pip-version-check -e '.[docs]'
	@touch $@

bench: setup
	$(BIN)/spin-bench what=all $(ARGS)

clean:
	rm -rf $(VENV) build dist site .pytest_cache .ruff_cache
