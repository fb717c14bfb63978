# SPDX-License-Identifier: Apache-2.0
# The box: printable parts, pictures, schematic, tables. Everything lies in build/hw.

HW := hw
# The servo's travel: 180 (geared 3:2 up) or 270 degrees (straight), with an output of its own.
HW_SERVO ?= 180
HW_OUT := $(BUILD)/hw$(if $(filter-out 180,$(HW_SERVO)),-$(HW_SERVO))
HW_PARTS := wheel_front wheel_comb wheel_back servo_gear plate sensor_carrier cradle module_cradle module_pair ring_cap base ring lid \
	headset_base pi_mount
HW_ITEMS := wheel_front wheel_comb wheel_back film plate roller_0 roller_1 roller_2 fork_0 fork_1 \
	sensor_carrier_0 sensor_carrier_1 servo servo_gear cradle module_cradle module ring_cap camera camera_plug screws base board ring lid headset_base
HW_VIEWS := box open headset module wheel
HW_STL := $(HW_PARTS:%=$(HW_OUT)/stl/%.stl)
HW_ASSEMBLED := $(HW_ITEMS:%=$(HW_OUT)/assembled/%.stl)
HW_PNG := $(HW_VIEWS:%=$(HW_OUT)/%.png) $(HW_PARTS:%=$(HW_OUT)/parts/%.png)
HW_SCAD := $(wildcard $(HW)/cad/*.scad)
HW_PYTHON := $(VENV)/bin/python

# OpenSCAD says on standard error what is wrong with a file; a warning is an error here.
OPENSCAD := $(HW)/tools/openscad -D servo_travel_deg=$(HW_SERVO)
HW_STL_FROM := -D 'stl="../../$(HW_OUT)/stl/"'
OPENSCAD_PNG := xvfb-run -a $(OPENSCAD) --colorscheme=Tomorrow

.SECONDARY: $(call apt,hw)

.PHONY: hw hw-parts hw-docs test-hw check-hw
hw: setup $(STAMPS)/venv-hw ## build the box: STL and PNG of every part, schematic, tables: build/hw
	@$(MAKE) -j$(JOBS) hw-parts
	@$(MAKE) -j$(JOBS) $(HW_PNG) $(HW_OUT)/schematic.svg
	@echo 'hw: parts, pictures and schematic are in $(HW_OUT)'

hw-parts: $(HW_STL) $(HW_ASSEMBLED)

$(HW_OUT)/stl/%.stl: $(HW_SCAD) | $(call apt,hw)
	@mkdir -p $(@D) && echo '  openscad $@'
	@$(OPENSCAD) -D 'part="$*"' -o $@ $(HW)/cad/part.scad
$(HW_OUT)/assembled/%.stl: $(HW_STL)
	@mkdir -p $(@D)
	@$(OPENSCAD) -D 'view="item"' $(HW_STL_FROM) -D 'item="$*"' -o $@ $(HW)/cad/assembly.scad

HW_CAMERA_box := 0,0,-42,74,0,152,600
HW_CAMERA_open := 0,0,-42,68,0,330,600
HW_CAMERA_headset := 0,0,-50,72,0,150,560
HW_CAMERA_module := 0,0,-22,74,0,330,480
HW_CAMERA_wheel := 0,0,0,60,0,140,300
$(HW_VIEWS:%=$(HW_OUT)/%.png): $(HW_OUT)/%.png: $(HW_STL)
	@echo '  openscad $@'
	@$(OPENSCAD_PNG) --imgsize=900,900 --camera=$(HW_CAMERA_$*) -D 'view="$*"' $(HW_STL_FROM) -o $@ $(HW)/cad/assembly.scad
$(HW_OUT)/parts/%.png: $(HW_OUT)/stl/%.stl
	@mkdir -p $(@D) && echo '  openscad $@'
	@echo 'import("../stl/$*.stl");' >$(@:.png=.scad)
	@$(OPENSCAD_PNG) --imgsize=600,600 --autocenter --viewall --camera=0,0,0,50,0,30,0 -o $@ $(@:.png=.scad)

# Drawn from circuit*.yml, and compared with them.
$(HW_OUT)/schematic.svg: $(wildcard $(HW)/circuit*.yml) $(HW)/tools/schematic.py $(HW)/tools/sheet.py $(HW)/tools/circuit.py \
	| $(STAMPS)/venv-hw $(call apt,hw)
	@echo '  schematic $@'
	@$(HW_PYTHON) $(HW)/tools/schematic.py $(@D)

# What only this room needs of Python.
$(STAMPS)/venv-hw: host_py/pyproject.toml host_py/constraints.txt | $(STAMPS)/venv
	@echo 'setup: Python packages of hw/'
	@PIP_CONSTRAINT=host_py/constraints.txt $(VENV)/bin/pip install --quiet --disable-pip-version-check -e 'host_py[hw]'
	@touch $@
.SECONDARY: $(STAMPS)/venv-hw

hw-docs: hw ## write the tables of hw/README.md (bill, budgets, pins, tolerances) and the pictures of hw/ again
	@$(HW_PYTHON) $(HW)/tools/readme.py
	@$(HW_PYTHON) $(HW)/tools/pictures.py

# Part of `make test`: all but the rendered parts, which take minutes.
test-all: test-hw
test-hw: build $(STAMPS)/venv-hw $(call apt,hw) ## test bill, circuit, tolerances and udev rules
	@$(VENV)/bin/pytest -q tests/hw --ignore=tests/hw/test_parts.py

check-hw: test-hw ## render and measure every part, for both servos: complete, printable, fitting, no collisions
	@for servo in 180 270; do \
		$(MAKE) -j$(JOBS) HW_SERVO=$$servo hw-parts && \
		HW_SERVO=$$servo $(VENV)/bin/pytest -q tests/hw/test_parts.py || exit 1; \
	done

check-python: check-hw-python
.PHONY: check-hw-python
check-hw-python: $(STAMPS)/venv-hw
	@$(RUFF) format --check -q $(HW)
	@$(RUFF) check -q $(HW)
	@MYPYPATH=$(HW)/tools $(VENV)/bin/mypy --config-file host_py/pyproject.toml $(wildcard $(HW)/tools/*.py)
