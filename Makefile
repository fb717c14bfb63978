# SPDX-License-Identifier: Apache-2.0
# The only entry. `make help` lists the targets. Everything generated lives under build/.
# Each room brings its own rules: <room>/<room>.mk.

BUILD := build
GEN := $(BUILD)/gen
VENV := $(BUILD)/venv
STAMPS := $(BUILD)/stamps
PYTHON ?= python3
JOBS ?= $(shell nproc)
BITS ?= $(shell getconf LONG_BIT)
SECONDS ?=
CAMERA ?=

# Compilers by way of ccache, where it is installed: what was compiled before, in any clone, is taken from there.
export PATH := /usr/lib/ccache:$(PATH)
export CCACHE_NOHASHDIR := 1
# Python keeps what it has compiled, whatever the environment says: the tests start it a thousand times.
export PYTHONDONTWRITEBYTECODE :=

MAKEFLAGS += --no-builtin-rules --no-print-directory
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.SUFFIXES:
.DEFAULT_GOAL := help

.PHONY: help
help: ## list the targets
	@echo 'lightprobe: make TARGET'
	@grep -hE '^[a-z0-9-]+:.*?## ' $(MAKEFILE_LIST) | sort | awk -F':.*## ' '{printf "  %-18s %s\n", $$1, $$2}'

include packaging/packaging.mk
include packaging/deb/deb.mk
include proto/proto.mk
include docs/docs.mk
include daemon/daemon.mk
include host_py/host_py.mk
include tests/tests.mk
include clients/clients.mk
include tests/kernel/kernel.mk
include tests/bench/bench.mk
include tests/arm64/arm64.mk
include tests/debian/debian.mk
include packaging/image/image.mk
-include $(wildcard firmware/firmware.mk hw/hw.mk)

.PHONY: setup supported build demo test check format clean

# Times and sizes are of 64 bits all through, and what a 32-bit system would need is tested nowhere.
supported:
	@[ '$(BITS)' = 64 ] || { echo 'setup: this system has $(BITS) bits, and lightprobe needs one of 64 (amd64 or arm64):' \
		'on a Raspberry Pi 3 to 5 install the 64-bit Raspberry Pi OS' >&2; exit 2; }

setup: supported setup-build setup-python ## install what building and testing need (apt, venv); fast when nothing is missing

build: setup ## build the daemon, the Python package, the viewer, the firmware
	@$(MAKE) -j$(JOBS) daemon python firmware web

demo: build $(if $(CAMERA),,$(BUILD)/scenes/blender.stamp) ## run the whole system live: simulated room (or CAMERA=v4l2:/dev/video0), daemon, view and web page; SECONDS=n ends it
	@$(VENV)/bin/lightprobe demo $(if $(SECONDS),--seconds $(SECONDS)) $(if $(CAMERA),--source $(CAMERA))

test: build ## build everything and run all tests that need no hardware and no kernel
	@$(MAKE) check
	@$(MAKE) test-all

check: build ## check format, lint, types, include rules and names in the pages
	@$(MAKE) check-c check-python check-rules

format: setup ## rewrite sources in the project's format
	@$(MAKE) format-c format-python

clean: ## delete everything generated
	rm -rf $(BUILD)
