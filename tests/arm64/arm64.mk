# SPDX-License-Identifier: Apache-2.0
# The daemon as an ARM64 board runs it: cross-built, and run by an emulator of the processor.

# Unit tests of VARIANT=arm64 run through it; empty where the processor is this machine's.
EMULATOR_arm64 := $(if $(filter aarch64,$(shell uname -m)),,qemu-aarch64-static -L $(SYSROOT_arm64))

$(OUT)/tests/numbers: $(OUT)/tests/arm64/numbers.c.o $(DAEMON_LIBS)
	@mkdir -p $(@D)
	@$(CC) $(LP_LDFLAGS) -o $@ $^ $(LP_LDLIBS) -ljpeg

.PHONY: test-arm64 arm64 numbers
numbers: $(OUT)/tests/numbers

# The libraries that the daemon and its unit tests are built with.
SYSROOT_LISTS := packaging/apt/build.txt packaging/apt/checks.txt
$(STAMPS)/sysroot-arm64: $(SYSROOT_LISTS) packaging/sysroot $(call apt,arm64)
	@packaging/sysroot arm64 $(SYSROOT_arm64) $(SYSROOT_LISTS)
	@touch $@

arm64: $(STAMPS)/sysroot-arm64 build
	@$(MAKE) VARIANT=arm64 -j$(JOBS) daemon unit-tests numbers
	@$(MAKE) VARIANT=release -j$(JOBS) numbers

test-arm64: arm64 ## cross-build for ARM64; run unit tests, replay and comparisons on an emulated processor; check for NEON
	@$(MAKE) VARIANT=arm64 EMULATOR='$(EMULATOR_arm64)' run-unit-tests
	@EMULATOR='$(EMULATOR_arm64)' $(VENV)/bin/pytest -q tests/arm64
