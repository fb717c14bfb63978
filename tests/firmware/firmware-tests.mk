# SPDX-License-Identifier: Apache-2.0
# Tests of the firmware: the flashed binary in simavr (pytest), the portable core natively (cmocka,
# sanitizers, libFuzzer).

FW_TESTS := $(FW_OUT)/tests

$(FW_TESTS)/test_link: $(FW_OUT)/asan/tests/firmware/test_link.o $(FW_OBJECTS_asan)
	@mkdir -p $(@D)
	$(CC) $(FLAGS_asan) -o $@ $^ -lcmocka -lm

# Budgets: flash; static RAM and the deepest stack seen in simavr while everything is asked of it.
# 30 720 bytes are left beside the largest boot loader of a Nano.
FW_FLASH_BYTES := 18432
FW_RAM_BYTES := 1536

.PHONY: firmware-size test-firmware test-firmware-parts test-firmware-long
firmware-size: $(FW_ELF) $(FW_SIMAVR) ## check flash, RAM and stack (measured in simavr) of the firmware against their budgets
	@$(VENV)/bin/python tests/firmware/size.py --flash-bytes $(FW_FLASH_BYTES) --ram-bytes $(FW_RAM_BYTES)

test-firmware-parts: $(FW_HEX) $(FW_SIMAVR) $(FW_HOST) $(FW_HOST)-asan $(FW_TESTS)/test_link

test-all: test-firmware
test-firmware: build ## test the flashed firmware in simavr and natively; lists the tests
	@$(MAKE) -j$(JOBS) test-firmware-parts
	@$(FW_TESTS)/test_link
	@$(MAKE) firmware-size

# Apart from `make test` for its time alone: half an hour, two processes.
MOVES ?= 10000
SEED ?= 1
test-firmware-long: build ## run 10 000 random wheel moves with random faults in simavr (half an hour); MOVES=n SEED=n
	@$(MAKE) -j$(JOBS) test-firmware-parts
	@$(MAKE) VARIANT=asan -j$(JOBS) daemon unit-tests
	@LP_LONG=1 $(BUILD)/asan/tests/test_link_envelope
	@LP_WHEEL_SECONDS=300 $(VENV)/bin/pytest -q -s tests/e2e/test_daemon_wheel.py -k random
	@$(VENV)/bin/python tests/firmware/campaign.py --moves $(MOVES) --seed $(SEED) --jobs $(JOBS)

.PHONY: ring-accuracy
ring-accuracy: build ## how good a calibrated ring is: the table of docs/builders/ring_files.md, simulated
	@$(MAKE) -j$(JOBS) $(FW_HOST)-asan
	@$(VENV)/bin/pytest -q -s tests/firmware/test_ring_accuracy.py -k host

# One of `make fuzz`'s targets, but of the firmware's own parts.
$(BUILD)/fuzz/fuzz/mcu: $(FW_OUT)/fuzz/tests/fuzz/fuzz_mcu.o $(FW_OBJECTS_fuzz)
	@mkdir -p $(@D)
	@$(CC) $(FLAGS_fuzz) -fsanitize=fuzzer -o $@ $^ -lm
$(BUILD)/asan/replay/mcu: $(FW_OUT)/asan/tests/fuzz/fuzz_mcu.o $(FW_OUT)/asan/tests/fuzz/replay.o $(FW_OBJECTS_asan)
	@mkdir -p $(@D)
	@$(CC) $(FLAGS_asan) -o $@ $^ -lm

.PHONY: check-firmware
check-c: check-firmware
check-firmware: $(DBC_H)
	@printf '%s\n' $(FW_CORE) $(wildcard $(FW)/board/host/*.c) | xargs -P$(JOBS) -I{} clang-tidy {} \
		--quiet --warnings-as-errors='*' -- -std=gnu17 -D_GNU_SOURCE -I$(FW) -I$(GEN) 2>&1 \
		| { grep -vE 'warnings? generated|^$$' || true; }

C_SOURCES += $(wildcard $(FW)/*.[ch] $(FW)/board/*.h $(FW)/board/*/*.[ch] $(FW)/simavr/*.[ch])
