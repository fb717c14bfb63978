# SPDX-License-Identifier: Apache-2.0
# The Python package, installed in editable form into build/venv with everything it and its tests need; EXTRAS=all:
# with what the command needs alone.
EXTRAS ?= dev

.PHONY: setup-python python check-python format-python
setup-python: $(STAMPS)/venv

$(STAMPS)/venv: host_py/pyproject.toml host_py/hatch_build.py host_py/lightprobe_pb2.py host_py/constraints.txt $(wildcard proto/*.proto proto/*.dbc proto/*.toml) proto/ranges.py | $(call apt,build)
	@echo 'setup: Python packages into $(VENV) (host_py/constraints.txt)'
	@[ -x $(VENV)/bin/python ] || $(PYTHON) -m venv $(VENV)
	@PIP_CONSTRAINT=host_py/constraints.txt $(VENV)/bin/pip install --quiet --disable-pip-version-check -e 'host_py[$(EXTRAS)]'
	@mkdir -p $(@D) && touch $@

# Tools find other programs beside their interpreter. The last one is there after `make firmware-avr`.
python: $(STAMPS)/venv daemon firmware-host
	@ln -sf ../../release/bin/lightprobed $(VENV)/bin/lightprobed
	@ln -sf ../../firmware/lightprobe-mcu-host ../../firmware/lightprobe-mcu-simavr $(VENV)/bin

RUFF := RUFF_CACHE_DIR=$(BUILD)/cache/ruff $(VENV)/bin/ruff --config host_py/pyproject.toml

check-python:
	@$(RUFF) format --check -q host_py tests docs proto clients packaging
	@$(RUFF) check -q host_py tests docs proto clients packaging
	@$(VENV)/bin/mypy --config-file host_py/pyproject.toml host_py/lightprobe
	@$(VENV)/bin/mypy --config-file host_py/pyproject.toml clients/blender/addon clients/blender/tools
	@$(VENV)/bin/mypy --config-file host_py/pyproject.toml packaging

format-python:
	@$(RUFF) format -q host_py tests docs proto clients packaging
	@$(RUFF) check -q --fix host_py tests docs proto clients packaging

.PHONY: package
package: setup-python ## build wheel and source distribution in build/dist
	@$(VENV)/bin/python -m build --outdir $(BUILD)/dist host_py

# Real panoramas, for the demo and the accuracy tests.
.PHONY: scenes
scenes: $(BUILD)/scenes/blender.stamp ## fetch CC0 panoramas (Debian's blender-data) into build/scenes

$(BUILD)/scenes/blender.stamp: packaging/fetch-scenes
	@packaging/fetch-scenes $(@D)
	@touch $@

.PHONY: evaluate
evaluate: build $(BUILD)/scenes/blender.stamp ## measure accuracy against exact truth: table, build/evaluate/accuracy.{json,png}
	@mkdir -p $(BUILD)/evaluate
	@$(VENV)/bin/lightprobe evaluate --scenes procedural --scenes blender --brackets float,1,2,3,4 \
		--settings preset=fast --settings preset=balanced --settings preset=accurate \
		--plot $(BUILD)/evaluate/accuracy.png --json-file $(BUILD)/evaluate/accuracy.json

.PHONY: accuracy
accuracy: build $(BUILD)/scenes/blender.stamp ## measure accuracy again and write docs/users/accuracy.md (two hours)
	@$(VENV)/bin/python tests/accuracy/report.py

.PHONY: accuracy-ring
accuracy-ring: build $(BUILD)/scenes/blender.stamp ## its parts about the ring of light sensors (a quarter of an hour)
	@$(VENV)/bin/python tests/accuracy/with_ring.py
.PHONY: accuracy-live
accuracy-live: build $(BUILD)/scenes/blender.stamp ## its part about turning cameras and changing lamps (an hour and a half)
	@$(VENV)/bin/python tests/accuracy/report.py --only-live

.PHONY: accuracy-polarization
accuracy-polarization: build ## its part about mirror images, polarizer and films (hours)
	@$(VENV)/bin/python tests/accuracy/films.py --page
	@$(VENV)/bin/python tests/accuracy/polarization.py --page
	@$(VENV)/bin/python tests/accuracy/polarization_live.py --page

.PHONY: probes
probes: build ## probes without the box, in simulated pictures: picture and tables of docs/users/probes.md (half an hour)
	@$(VENV)/bin/python tests/accuracy/probe_pictures.py
	@$(VENV)/bin/python tests/accuracy/rods.py --page
	@$(VENV)/bin/python tests/accuracy/dodecahedra.py --page
	@$(VENV)/bin/python tests/accuracy/objects.py --scenes 2 --page

.PHONY: constants
constants: build $(BUILD)/scenes/blender.stamp ## what the estimator's constants do: half and double of each, into docs/maintainers/constants.md (half an hour)
	@$(VENV)/bin/python tests/accuracy/constants.py
