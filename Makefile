# The project's commands. Each sets up the virtual environment by itself, once, and again when pyproject.toml or
# constraints.txt changes.

SHELL := /bin/bash
VENV ?= .venv
# A Python 3.11 or newer to build the environment with; found by itself if empty.
PYTHON ?=
# A package index that offers the build of torch you want; see "Which build of torch" in README.md.
TORCH_INDEX ?=
CONFIG ?= configs/demo.yaml
PYTEST_ARGS ?=

export VENV PYTHON TORCH_INDEX

INSTALLED := $(VENV)/.juicer-installed
CAN_DRAW := $(VENV)/.juicer-can-draw
RUN := $(VENV)/bin

.PHONY: help demo demo-images test slow-test check format setup lock gl looks clean

help: ## Show this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 20

demo: setup gl ## Run the whole loop on one_leg: from demonstrations to the comparison table
	@$(RUN)/juicer run $(CONFIG)

demo-images: setup gl ## The same with policies that act on images, in half an hour
	@$(RUN)/juicer run configs/demo_images.yaml

# Side by side, a file at a time: fixtures of a file, such as a server, are made once.
test: setup gl ## Run the tests
	@$(RUN)/pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder $(PYTEST_ARGS)

slow-test: setup gl ## Run the tests that take minutes
	@$(RUN)/pytest -m slow $(PYTEST_ARGS)

check: setup ## Check style, types and import contracts
	$(RUN)/ruff check .
	$(RUN)/ruff format --check .
	$(RUN)/mypy
	$(RUN)/lint-imports

format: setup ## Put the code into its standard form
	$(RUN)/ruff check --fix .
	$(RUN)/ruff format .

setup: $(INSTALLED) ## Make the virtual environment and install everything
	@:

$(INSTALLED): pyproject.toml constraints.txt scripts/setup.sh
	@scripts/setup.sh
	@touch $@

# Without the extra s3, whose libraries come with dev: given boto3 by name, pip searches for minutes for one that s3fs allows.
lock: setup ## Install the newest versions that pyproject.toml allows, and write them to constraints.txt
	$(RUN)/pip install --quiet --upgrade --upgrade-strategy eager \
		$(if $(TORCH_INDEX),--extra-index-url $(TORCH_INDEX)) --editable '.[dev,postgres,spacemouse]'
	scripts/write_constraints.sh

# Without OpenGL everything works but what looks at images or shows them. Its absence is told here; what needs it stops.
gl: $(INSTALLED)
	@test -e $(CAN_DRAW) || { scripts/ensure_gl.sh && touch $(CAN_DRAW); } || true

looks: setup ## Install the meshes of the real robot, for videos and reports
	@$(RUN)/pip install --quiet --no-deps dm-robotics-panda==0.4.8

clean: ## Remove the virtual environment and caches; data/ stays
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
