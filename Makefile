# Every target sets up what it needs: a virtual environment in .venv, and on a bare machine the two
# system libraries that OpenGL needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
MAPS ?= ../shared/hdri
SEQUENCES ?= ../shared/sequences
SEQUENCES2X ?= ../shared/sequences2x
VERSION := $(shell sed -n 's/^__version__ = "\(.*\)"/\1/p' asglight/__init__.py)
EXTENSION = dist/asglight-blender-$(VERSION).zip

# Bytecode is kept: without it, each worker of the tests takes twice as long to start.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup setup-dcc release results docs blender-extension test-blender blender-pictures demo bench bench-fit bench-motion bench-command gpu stress stress-short soak test test-fast test-usd test-dcc test-dcc-short \
  test-ball-truth dcc-picture lint format clean

help:            ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 14

setup: $(VENV)/.ready  ## make the virtual environment

$(VENV)/.ready: pyproject.toml constraints.txt hatch_build.py asglight/c_library.py $(wildcard asglight/*/compiled/*.[ch])
	@PYTHON=$(PYTHON) sh .ci/system-libraries
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt torch
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[view,farm,report,docs,dev]'
	@touch $@

demo: setup      ## the main job on the built-in sequence, ending in pictures (demo-output/)
	$(BIN)/asglight demo -o demo-output

bench: setup     ## error against run time, in two minutes each, held against the baseline (bench-output/)
	$(BIN)/asglight bench "$(MAPS)/lobby.exr" "$(SEQUENCES)/tunnel" --quick -o bench-output \
	  --gate benchmarks/bench-baseline.json

stress: setup    ## stiff, extreme and broken input, measured (stress-output/)
	$(BIN)/asglight stress -o stress-output

stress-short: setup  ## what changes over time, and a tenth of the other cases (stress-output/)
	$(BIN)/asglight stress --sample 0.1 -o stress-output

bench-fit: setup ## measure the fits on MAPS and SEQUENCES: tables, JSON, pictures (bench-fit/)
	$(BIN)/python -m benchmarks.fits --maps "$(MAPS)" --sequences "$(SEQUENCES)" -o bench-fit/

bench-motion: setup  ## light between frames and at them, on SEQUENCES2X and SEQUENCES (bench-motion/)
	$(BIN)/python -m benchmarks.motion.measure --sequences "$(SEQUENCES2X)" "$(SEQUENCES)" -o bench-motion

bench-command: setup  ## whole commands as ratios, held against the baseline (command-output/); BLESS=1 renews it
	$(BIN)/python -m benchmarks.command -o command-output $(if $(BLESS),--bless)

gpu:             ## all that is measured on a GPU, in eight minutes (gpu-output/, docs/results/gpu.md); WHEELS=DIR without network
	PYTHON=$(PYTHON) WHEELS="$(WHEELS)" sh .ci/gpu -o gpu-output --maps "$(MAPS)" --sequence "$(SEQUENCES)/day"

results: setup   ## every table and picture of README.md and docs/results from scratch: hours; PART=motion-tunnel for some
	$(BIN)/python -m benchmarks.results $(PART) --maps "$(MAPS)" --sequences "$(SEQUENCES)" --sequences2x "$(SEQUENCES2X)"

docs: setup      ## the pages of docs/ as a site (site/index.html), without a network
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

test: setup      ## all tests, a file of them on each core at a time
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

test-fast: setup ## the tests of less than ten seconds each
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder -m 'not slow'

soak: setup      ## 100,000 damaged files, 110 faults, 10,000 frames: within half an hour (soak-output/)
	ASGLIGHT_THOROUGH=1 $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder -m thorough
	OMP_NUM_THREADS=1 $(BIN)/python -m soak.measure -o soak-output

test-usd: setup  ## stages in other versions of USD and under NVIDIA's validator (.usd-versions/)
	.ci/usd-versions

setup-dcc: .venv-dcc/.ready  ## Blender and Mitsuba, in an environment of their own (.venv-dcc)

.venv-dcc/.ready: dcc/requirements.txt .ci/renderers
	@PYTHON=$(PYTHON) sh .ci/renderers

release: setup   ## wheel, source, extension (dist/); then the demo from that wheel in a clean environment
	PYTHON=$(BIN)/python sh .ci/release dist

blender-extension: setup  ## the zip that Blender installs (dist/)
	$(BIN)/python -m integrations.package -o dist

test-blender: setup setup-dcc blender-extension  ## shots of SEQUENCES in Blender through the extension (dcc-output/moving)
	$(BIN)/python -m pytest tests/integrations -m 'blender or not slow'
	$(BIN)/python -m dcc.moving.measure --sequences "$(SEQUENCES)" --zip $(EXTENSION) -o dcc-output/moving

blender-pictures: setup setup-dcc blender-extension  ## a moving shot in Blender beside its HDRI (docs/images/blender-day.png)
	$(BIN)/python -m dcc.moving.picture --sequences "$(SEQUENCES)" --zip $(EXTENSION) -o docs/images/blender-day.png

test-dcc: setup setup-dcc test-blender  ## stages of SEQUENCES in Blender and Mitsuba: tables, JSON (dcc-output/)
	$(BIN)/python -m dcc.measure --sequences "$(SEQUENCES)" -o dcc-output
	$(BIN)/python -m dcc.keyed.measure --sequences "$(SEQUENCES)" --stills "$(MAPS)/esplanade.exr" --zip $(EXTENSION) -o dcc-output/keyed

test-dcc-short: setup setup-dcc blender-extension  ## the same on the built-in sky, Blender only
	$(BIN)/python -m dcc.measure --short --size 12 --samples 1536 -o dcc-output/short
	$(BIN)/python -m pytest tests/integrations -m blender
	$(BIN)/python -m dcc.moving.measure --short --size 12 --samples 512 --zip $(EXTENSION) -o dcc-output/short-moving
	$(BIN)/python -m dcc.keyed.measure --short --samples 64 --zip $(EXTENSION) -o dcc-output/short-keyed

test-ball-truth: setup setup-dcc  ## what judges balls, and draws them, against Mitsuba: two tables
	$(BIN)/python -m dcc.ball_truth
	$(BIN)/python -m dcc.drawn_truth

dcc-picture: setup setup-dcc  ## what Blender shows, one picture; after test-dcc
	$(BIN)/python -m dcc.picture --measured dcc-output -o dcc-output/dcc.png

lint: setup      ## ruff, pyright, and the spelling of code and docs
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/codespell

format: setup    ## let ruff rewrite the sources
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:           ## remove what the targets made
	rm -rf $(VENV) .venv-dcc .venv-gpu .venv-release gpu-output command-output demo-output dcc-output bench-output bench-fit bench-motion results-output site stress-output test-artifacts .usd-versions dist .pytest_cache .ruff_cache .hypothesis soak-output
