# SPDX-License-Identifier: Apache-2.0
# C from the schemas, by nanopb's generator. (Python: host_py/hatch_build.py.)

PROTO_C := $(GEN)/proto/lightprobe.pb.c
PROTO_H := $(GEN)/proto/lightprobe.pb.h

$(PROTO_C) $(PROTO_H) &: proto/lightprobe.proto proto/lightprobe.options | $(call apt,build)
	@mkdir -p $(GEN)/proto
	@protoc -Iproto --plugin=protoc-gen-nanopb=/usr/bin/protoc-gen-nanopb \
		'--nanopb_out=-I proto -f proto/lightprobe.options:$(GEN)/proto' lightprobe.proto
	@touch $(PROTO_C) $(PROTO_H)

# C packers of the microcontroller's messages, by cantools (from the venv). No floating point: raw integers.
DBC_C := $(GEN)/dbc/mcu.c
DBC_H := $(GEN)/dbc/mcu.h

$(DBC_C) $(DBC_H) &: proto/mcu.dbc | $(STAMPS)/venv
	@mkdir -p $(GEN)/dbc
	@$(VENV)/bin/python -m cantools generate_c_source --no-floating-point-numbers \
		--database-name mcu -o $(GEN)/dbc proto/mcu.dbc >/dev/null
	@touch $(DBC_C) $(DBC_H)

# The microcontroller's faults, for firmware and daemon. (Python reads the table itself.)
MCU_FAULTS_H := $(GEN)/dbc/mcu_faults.h

$(MCU_FAULTS_H): proto/mcu_faults.toml proto/mcu_faults.py
	@mkdir -p $(@D)
	@$(PYTHON) proto/mcu_faults.py --header $@

# What each number of a message may be, for the daemon. (Python reads the table itself.)
RANGES_H := $(GEN)/proto/ranges.h

$(RANGES_H): proto/lightprobe.proto proto/lightprobe.options proto/ranges.toml proto/ranges.py proto/ranges_code.py | $(STAMPS)/venv
	@mkdir -p $(@D)
	@$(VENV)/bin/python proto/ranges_code.py --header $@

# Flags of estimates and lights, for the daemon. (Python's are committed: host_py/lightprobe/flags.py.)
FLAGS_H := $(GEN)/proto/flags.h

$(FLAGS_H): proto/lightprobe.proto proto/flags_code.py
	@mkdir -p $(@D)
	@$(PYTHON) proto/flags_code.py --header $@
