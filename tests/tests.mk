# SPDX-License-Identifier: Apache-2.0
# Tests by tier. C unit tests: one binary per tests/unit/test_*.c (or .cpp), linked with the daemon's libraries
# in the asan variant. Python tests: pytest.

C_SOURCES = $(DAEMON_SOURCES) $(wildcard tests/*/*.[ch] tests/*/*.cpp)

UNIT_SOURCES := $(filter-out $(if $(filter 0,$(WITH_LIBCAMERA)),%_libcamera.cpp) $(if $(filter 0,$(WITH_OSC)),%_osc.c) $(if $(filter 0,$(WITH_LIBUSB)),%_ptp.c) $(if $(filter 0,$(WITH_WEBSOCKETS)),%_websocket_handshake.c) $(if $(filter 0,$(WITH_GPIOD)),%_pca9685.c) $(if $(filter 0,$(WITH_MQTT)),%_mqtt.c),$(wildcard tests/unit/test_*.c tests/unit/test_*.cpp))
# ONLY: some of them, by their sources.
ONLY ?=
UNIT_TESTS := $(patsubst tests/unit/%,$(OUT)/tests/%,$(basename $(if $(ONLY),$(filter $(ONLY),$(UNIT_SOURCES)),$(UNIT_SOURCES))))

link_unit_test = mkdir -p $(@D) && $(CC) $(LP_LDFLAGS) $(WRAPPED:%=-Wl,--wrap=%) -o $@ $^ $(LP_LDLIBS) -lcmocka -ljpeg
$(OUT)/tests/%: $(OUT)/tests/unit/%.c.o $(DAEMON_LIBS)
	@$(link_unit_test)
$(OUT)/tests/%: $(OUT)/tests/unit/%.cpp.o $(DAEMON_LIBS)
	@$(link_unit_test)
# Calls that a test answers itself, instead of the system or of another file.
$(OUT)/tests/test_source_contract: WRAPPED := open close ioctl mmap lp_v4l2_nodes_read lp_v4l2_hotplug_open \
	lp_v4l2_hotplug_read lp_v4l2_reset_port lp_ptp_usb_open
$(OUT)/tests/test_source_ptp: WRAPPED := lp_ptp_usb_open
$(OUT)/tests/test_codec: WRAPPED := lp_clock_suspended_ns
$(OUT)/tests/test_link_i2c $(OUT)/tests/test_ring_i2c: WRAPPED := open ioctl
$(OUT)/tests/test_link_can: WRAPPED := socket bind setsockopt ioctl
$(OUT)/tests/test_rotator_pca9685: WRAPPED := open ioctl lp_index_open lp_index_fd lp_index_read lp_index_is_on \
	lp_index_close
.PRECIOUS: $(OUT)/%.c.o $(OUT)/%.cpp.o

# The expected values of the golden bytes, as C.
$(GEN)/golden.inc: proto/golden/v1.json tests/unit/golden.py
	@mkdir -p $(@D)
	@$(PYTHON) tests/unit/golden.py header >$@
$(OUT)/tests/unit/test_golden.c.o: $(GEN)/golden.inc

.PHONY: unit-tests run-unit-tests test-unit test-python test-all
unit-tests: $(UNIT_TESTS)
# EMULATOR: what runs another processor's programs. What a test prints is shown when it has ended.
run-unit-tests: unit-tests
	@printf '%s\n' $(UNIT_TESTS) | xargs -P$(JOBS) -I@ sh -c \
		'out=$$($(EMULATOR) @ 2>&1); status=$$?; printf "== %s\n%s\n" @ "$$out"; exit $$status'

# These send thousands of frames through the pipeline: five times as slow with the sanitizers (make test-sanitized).
MANY_FRAMES := tests/unit/test_bracket.c tests/unit/test_bracket_delays.c
SANITIZED_BY_DAY := $(filter-out $(MANY_FRAMES),$(UNIT_SOURCES))

test-unit: ## run the C unit tests, nearly all with the address and undefined-behaviour sanitizers
	@$(MAKE) VARIANT=asan -j$(JOBS) unit-tests replays ONLY='$(SANITIZED_BY_DAY)'
	@$(MAKE) VARIANT=release -j$(JOBS) unit-tests ONLY='$(MANY_FRAMES)'
	@$(MAKE) VARIANT=release run-unit-tests ONLY='$(MANY_FRAMES)'
	@$(MAKE) VARIANT=asan run-unit-tests run-replays ONLY='$(SANITIZED_BY_DAY)'

# Several processes, because many tests wait: for daemons to start, for frames to come. A test has its
# own folder and port. They share the processors: threads of BLAS in each would only wait for each other.
export OPENBLAS_NUM_THREADS := 1
PYTEST_JOBS ?= $(shell expr $(JOBS) + 1)
PYTEST_ALONE = $(VENV)/bin/pytest -q -o cache_dir=$(abspath $(BUILD))/cache/pytest
PYTEST = $(PYTEST_ALONE) -n $(PYTEST_JOBS) --no-loadscope-reorder
PYTEST_ROOMS := accuracy bench e2e extremes unit firmware package

# A client for Open Spherical Cameras, from npm.
$(BUILD)/osc_client/stamp: tests/e2e/osc_client/package.json tests/e2e/osc_client/package-lock.json | $(call apt,build)
	@echo 'npm: tests/e2e/osc_client'
	@mkdir -p $(@D) && cp $^ $(@D)/
	@cd $(@D) && npm ci --silent --no-audit --no-fund
	@touch $@

test-parts: build $(BUILD)/scenes/blender.stamp $(BUILD)/osc_client/stamp
	@$(MAKE) VARIANT=asan -j$(JOBS) daemon
	@$(MAKE) -j$(JOBS) firmware firmware-avr test-firmware-parts bench-programs

# Tests of programs in real time may fail where others leave them no processor. One or two that failed (status 1) are
# named and run once more, alone; what then fails, fails, and so do three (tests/again.py). Both runs are printed.
AGAIN = --last-failed --last-failed-no-failures none
define run-and-again
	@$(PYTEST) --durations=25 -m $(1) $(PYTEST_ROOMS:%=tests/%) || { [ $$? -eq 1 ] && \
		$(VENV)/bin/python tests/again.py $(BUILD)/cache/pytest && \
		$(PYTEST_ALONE) -x -m $(1) $(AGAIN) $(PYTEST_ROOMS:%=tests/%); }
endef
test-python: test-parts
	$(call run-and-again,'not long and not nightly')

.PHONY: test-parts test-long
test-long: test-parts ## run the tests that take too long for `make test`: random faults, instruction counts, other Pythons
	$(call run-and-again,'long and not nightly')

# Local: tests that the files which differ from BASE can touch (tests/changed.py). BASE: origin/main, or HEAD~1 there.
BASE ?=
.PHONY: test-changed
test-changed: test-parts ## run the tests that your changes can touch, and count those skipped; BASE=commit to compare with (origin/main)
	@$(VENV)/bin/python tests/changed.py --base '$(BASE)' --out $(BUILD)/changed
	@if [ -s $(BUILD)/changed/unit ]; then $(MAKE) VARIANT=asan -j$(JOBS) run-unit-tests \
		ONLY="$$(xargs <$(BUILD)/changed/unit)"; fi
	@if [ -s $(BUILD)/changed/python ]; then \
		xargs $(PYTEST) -m 'not long and not nightly' <$(BUILD)/changed/python || [ $$? -eq 5 ]; fi
	@if [ -s $(BUILD)/changed/targets ]; then xargs $(MAKE) <$(BUILD)/changed/targets; fi

.PHONY: test-nightly-python
test-nightly-python: test-parts ## run the tests that only `make test-nightly` runs: accuracy in more rooms, motions and sizes
	$(call run-and-again,nightly)

.PHONY: test-sanitized
test-sanitized: test-parts ## run the tests with many frames once more, with the sanitizers, as test-nightly does
	@$(MAKE) VARIANT=asan -j$(JOBS) run-unit-tests ONLY='$(MANY_FRAMES)'
	@SANITIZED=1 $(PYTEST) -m 'many_frames and not long and not nightly' $(PYTEST_ROOMS:%=tests/%)

$(STAMPS)/venv-renderer: host_py/pyproject.toml host_py/constraints.txt | $(STAMPS)/venv
	@echo 'setup: Mitsuba (host_py[renderer])'
	@PIP_CONSTRAINT=host_py/constraints.txt $(VENV)/bin/pip install --quiet --disable-pip-version-check -e 'host_py[renderer]'
	@touch $@

.PHONY: test-renderer seen seen-study seen-beside furnished
test-renderer: build $(STAMPS)/venv-renderer ## compare measured polarization, light at a place, and AR pictures, with a physically based renderer (Mitsuba, half an hour)
	@$(VENV)/bin/pytest -q -s -m '' tests/accuracy/test_polarization_references.py tests/accuracy/test_furnished.py tests/seen
seen: build web $(STAMPS)/venv-renderer ## compare AR pictures with renders of the real object again, and write docs/users/seen.md (half an hour)
	@$(VENV)/bin/python tests/seen/seen.py
seen-study: $(STAMPS)/venv ## cut the pictures of docs/users/seen.md for lightprobe study, into build/seen/study
	@$(VENV)/bin/python tests/seen/study.py
seen-beside: build $(STAMPS)/venv-renderer ## compare AR pictures, mirror balls and shadows beside a probe that moves with renders again, and write docs/users/seen.md (an hour)
	@$(VENV)/bin/python tests/seen/shadow_beside.py --page
	@$(VENV)/bin/python tests/seen/mirror_ball.py --page
	@$(VENV)/bin/python tests/seen/beside.py
furnished: build $(STAMPS)/venv-renderer ## measure ambient light beside a probe in rendered rooms again, and write docs/users/places.md (an hour)
	@$(VENV)/bin/python tests/accuracy/furnished.py --page

# Babylon.js, from npm, to read what `lightprobe export` writes.
BABYLON := $(BUILD)/babylon
$(BABYLON)/page.bundle.js: $(wildcard tests/engines/babylon/*) tests/engines/babylon/.npmrc | $(call apt,web)
	@echo 'npm: tests/engines/babylon'
	@mkdir -p $(@D) && cp tests/engines/babylon/* tests/engines/babylon/.npmrc $(@D)
	@cd $(@D) && npm ci --silent --no-audit --no-fund
	@cd $(@D) && node_modules/.bin/esbuild page.js --bundle --outfile=page.bundle.js --log-level=warning

.PHONY: test-engines
test-engines: build $(BABYLON)/page.bundle.js ## read exported files in Babylon.js (108 MB from npm), test lightprobe-webxr.js and the components in pages of other engines, and the Blender extension (350 MB from PyPI)
	@$(VENV)/bin/pytest -q -s tests/engines/test_babylon.py
	@$(MAKE) test-webxr
	@$(MAKE) test-components
	@$(MAKE) test-blender

test-all: test-unit test-python test-js test-csharp

.PHONY: test-nightly
test-nightly: test test-engines test-long test-nightly-kernel test-nightly-python test-sanitized test-nightly-js check-c-paths test-firmware-long test-renderer check-hw test-arm64 test-debian test-deb test-image fuzz ## run all tests, also what takes too long for .ci/run (hours): before a release, as `make -k test-nightly`, which goes on after a failure

.PHONY: check-rules
check-rules: build
	@$(VENV)/bin/python tests/rules/check_includes.py
	@$(VENV)/bin/pytest -q tests/rules

.PHONY: soak
soak: build ## process an hour of simulated frames as fast as possible: memory must not grow; FRAMES=n
	@$(VENV)/bin/python tests/e2e/soak.py $(if $(FRAMES),--frames $(FRAMES))

# One libFuzzer target per tests/fuzz/fuzz_NAME.c, and per fuzz_NAME.py (with atheris); what it finds on its way stays
# under build/. `mcu` links the firmware's own parts.
FUZZ_LEFT_OUT := $(if $(filter 0,$(WITH_OSC)),osc osc_camera) $(if $(filter 0,$(WITH_LIBUSB)),ptp) \
	$(if $(filter 0,$(WITH_WEBSOCKETS)),websocket)
FUZZ_TARGETS := $(filter-out $(FUZZ_LEFT_OUT),$(patsubst tests/fuzz/fuzz_%.c,%,$(wildcard tests/fuzz/fuzz_*.c)))
RUNS ?= 1000000

$(OUT)/fuzz/%: $(OUT)/tests/fuzz/fuzz_%.c.o $(DAEMON_LIBS)
	@mkdir -p $(@D)
	@$(CXX) $(LP_LDFLAGS) -fsanitize=fuzzer -o $@ $^ $(LP_LDLIBS) -ljpeg

$(STAMPS)/venv-fuzz: host_py/pyproject.toml host_py/constraints.txt | $(STAMPS)/venv
	@echo 'setup: atheris (host_py[fuzz])'
	@PIP_CONSTRAINT=host_py/constraints.txt $(VENV)/bin/pip install --quiet --disable-pip-version-check -e 'host_py[fuzz]'
	@touch $@

.PHONY: fuzz fuzz-targets
fuzz-targets: $(FUZZ_TARGETS:%=$(OUT)/fuzz/%)
fuzz: build $(call apt,fuzz) $(STAMPS)/venv-fuzz ## run every fuzz target for RUNS=1000000 inputs (half an hour on four cores); fails if one finds something or runs fewer
	@$(MAKE) VARIANT=fuzz -j$(JOBS) fuzz-targets
	@$(VENV)/bin/python tests/fuzz/run.py --runs $(RUNS) --jobs $(JOBS) --out $(BUILD)/fuzz/found \
		$(FUZZ_TARGETS:%=$(BUILD)/fuzz/fuzz/%) $(wildcard tests/fuzz/fuzz_*.py)

# Every corpus through its target, without libFuzzer: what was found once must not come back.
$(OUT)/replay/%: $(OUT)/tests/fuzz/fuzz_%.c.o $(OUT)/tests/fuzz/replay.c.o $(DAEMON_LIBS)
	@mkdir -p $(@D) && $(CC) $(LP_LDFLAGS) -o $@ $^ $(LP_LDLIBS) -ljpeg
.PHONY: replays run-replays
replays: $(FUZZ_TARGETS:%=$(OUT)/replay/%)
run-replays: replays
	@printf '%s\n' $(FUZZ_TARGETS) | xargs -P$(JOBS) -I@ sh -c \
		'out=$$($(OUT)/replay/@ tests/fuzz/corpus/@ 2>&1) || { printf "== replay @\n%s\n" "$$out"; exit 1; }'
	@echo 'replay: the corpora of $(FUZZ_TARGETS) find nothing'
