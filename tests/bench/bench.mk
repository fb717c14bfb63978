# SPDX-License-Identifier: Apache-2.0
# Speed and its trade for accuracy: tests/bench/bench.py drives the program below.

BENCH_OBJECTS := $(patsubst %.cpp,$(OUT)/%.cpp.o,$(wildcard tests/bench/*.cpp))

# A struct and a function of one name are C, and shadowing to C++.
$(BENCH_OBJECTS): LP_CXXFLAGS += -Wno-shadow
$(OUT)/bench/bench: $(BENCH_OBJECTS) $(DAEMON_LIBS)
	@mkdir -p $(@D) && echo '  ld $@'
	@$(CXX) $(LP_LDFLAGS) -o $@ $^ $(LP_LDLIBS)

$(OUT)/bench/count_allocations.so: tests/bench/count_allocations.c
	@mkdir -p $(@D) && echo '  ld $@'
	@$(CC) $(LP_CPPFLAGS) $(LP_CFLAGS) -Wno-missing-prototypes -fPIC -shared -o $@ $<

.PHONY: bench bench-programs
bench-programs: $(OUT)/bench/bench $(OUT)/bench/count_allocations.so
bench: build $(BUILD)/scenes/blender.stamp ## measure the speed of presets, stages and baselines, and write docs/maintainers/speed.md; QUICK=1 only checks that it runs; ROUNDS=n; SCENES=folder: only the scenes there, one by one: still, with three exposures, and turning
	@$(MAKE) -j$(JOBS) bench-programs
	@$(VENV)/bin/python tests/bench/bench.py $(if $(QUICK),--quick) $(if $(SCENES),--scenes $(SCENES)) $(if $(ROUNDS),--rounds $(ROUNDS))

.PHONY: instructions
instructions: build ## record the instruction counts of the hot path (tests/bench/instructions.json); a test compares with them
	@$(MAKE) -j$(JOBS) bench-programs
	@$(VENV)/bin/python tests/bench/instructions.py --write

.PHONY: draws
draws: build ## show rooms to a daemon with six subscriptions that say what they draw: docs/users/clients.md (ten minutes)
	@OPENBLAS_NUM_THREADS=1 $(VENV)/bin/python tests/bench/draws.py --page

.PHONY: trade
trade: build $(BUILD)/scenes/blender.stamp ## measure what each choice costs and brings again: host_py/lightprobe/trade.json, docs/users/trade.md (half an hour)
	@$(MAKE) -j$(JOBS) bench-programs
	@$(VENV)/bin/python tests/bench/trade.py $(if $(ROUNDS),--rounds $(ROUNDS))
