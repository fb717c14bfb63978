# SPDX-License-Identifier: Apache-2.0
# lightprobed, and one static library per room of it. VARIANT chooses how it is built:
#   release   what ships           asan   address + undefined-behaviour sanitizers (tests)
#   tsan      thread sanitizer     cov    line coverage        arm64  cross-built
#   fuzz      clang, for libFuzzer  gpiod2 as release, with libgpiod 2 whatever the system has (make gpiod2)

VARIANT ?= release
OUT := $(BUILD)/$(VARIANT)
VERSION := 0.1.0

# Another processor's libraries lie in a folder of their own; empty: this machine's.
SYSROOT_arm64 := $(BUILD)/sysroot-arm64
SYSROOT := $(SYSROOT_$(VARIANT))
CROSS_arm64 := aarch64-linux-gnu-
CC := $(if $(filter fuzz,$(VARIANT)),clang,$(CROSS_$(VARIANT))gcc)$(SYSROOT:%= --sysroot=%)
CXX := $(if $(filter fuzz,$(VARIANT)),clang++,$(CROSS_$(VARIANT))g++)$(SYSROOT:%= --sysroot=%)
AR := $(CROSS_$(VARIANT))ar
PKG_CONFIG_arm64 := PKG_CONFIG_SYSROOT_DIR=$(SYSROOT) \
	PKG_CONFIG_LIBDIR=$(SYSROOT)/usr/lib/aarch64-linux-gnu/pkgconfig:$(SYSROOT)/usr/share/pkgconfig
PKG_CONFIG_gpiod2 := PKG_CONFIG_PATH=$(BUILD)/libgpiod2
PKG_CONFIG := $(PKG_CONFIG_$(VARIANT)) pkg-config

# Optional libraries: 0 or 1. A missing one is an error that names the package and the way without.
WITH_SYSTEMD ?= 1
WITH_SIM ?= 1
WITH_LIBUSB ?= 1
WITH_GPIOD ?= 1
WITH_LIBCAMERA ?= 1
WITH_OSC ?= 1
WITH_WEBSOCKETS ?= 1
WITH_IIO ?= 1
WITH_MQTT ?= 1
WITH_OPTIONS := SYSTEMD SIM LIBUSB GPIOD LIBCAMERA OSC WEBSOCKETS IIO MQTT
PACKAGE_SYSTEMD := libsystemd
DEBIAN_SYSTEMD := libsystemd-dev
PACKAGE_LIBUSB := libusb-1.0
DEBIAN_LIBUSB := libusb-1.0-0-dev
PACKAGE_GPIOD := libgpiod
DEBIAN_GPIOD := libgpiod-dev
PACKAGE_LIBCAMERA := libcamera
DEBIAN_LIBCAMERA := libcamera-dev
PACKAGE_OSC := libcurl jansson
DEBIAN_OSC := libcurl4-openssl-dev libjansson-dev
PACKAGE_WEBSOCKETS := libwebsockets openssl
PACKAGE_IIO := libiio
DEBIAN_IIO := libiio-dev
DEBIAN_WEBSOCKETS := libwebsockets-dev libwebsockets-evlib-uv libssl-dev
PACKAGE_MQTT := libmosquitto openssl
DEBIAN_MQTT := libmosquitto-dev libssl-dev
# Of libgpiod there are two, which have nothing in common: version 1 (Debian 12) and 2 (Debian 13).
GPIOD_MAJOR := $(if $(filter 1,$(WITH_GPIOD)),$(firstword $(subst ., ,$(shell $(PKG_CONFIG) --modversion libgpiod 2>/dev/null))))
LP_EXCLUDE := $(if $(filter 0,$(WITH_GPIOD)),daemon/drivers/wheel/pca9685/%, \
		daemon/drivers/wheel/pca9685/index_gpiod$(if $(filter 1,$(GPIOD_MAJOR)),2,1).c) \
	$(if $(filter 0,$(WITH_LIBCAMERA)),daemon/drivers/source/libcamera/%) \
	$(if $(filter 0,$(WITH_OSC)),daemon/drivers/source/osc/%) \
	$(if $(filter 0,$(WITH_LIBUSB)),daemon/drivers/source/ptp/%) \
	$(if $(filter 0,$(WITH_WEBSOCKETS)),daemon/drivers/publisher/websocket/%) \
	$(if $(filter 0,$(WITH_IIO)),daemon/drivers/orientation/iio.c) \
	$(if $(filter 0,$(WITH_MQTT)),daemon/drivers/publisher/mqtt/%)
LP_PACKAGES := libuv libturbojpeg inih $(foreach o,$(WITH_OPTIONS),$(if $(filter 1,$(WITH_$o)),$(PACKAGE_$o)))

# What ships: a write beyond an array or a stack ends the program at once.
HARDENING := -U_FORTIFY_SOURCE -D_FORTIFY_SOURCE=3 -fstack-protector-strong -fstack-clash-protection \
	-Wl,-z,relro,-z,now
FLAGS_release := -O2 $(HARDENING)
FLAGS_arm64 := -O2 $(HARDENING)
FLAGS_gpiod2 := -O2 $(HARDENING)
# gcc does not count a float that no int can hold as `undefined`.
SANITIZERS := address,undefined,float-cast-overflow
FLAGS_asan := -O2 -fsanitize=$(SANITIZERS) -fno-sanitize-recover=all -fno-omit-frame-pointer
FLAGS_fuzz := -O1 -fsanitize=fuzzer-no-link,$(SANITIZERS) -fno-sanitize-recover=all
FLAGS_tsan := -O1 -fsanitize=thread
FLAGS_cov := -O0 --coverage
WARNINGS := -Wall -Wextra -Werror -Wshadow -Wpointer-arith -Wvla -Wundef
# x86: SSE4.1 and what comes with it, in every processor since 2009. ARM: NEON is part of the base.
ARCH_FLAGS := $(if $(filter x86_64-%,$(shell $(CC) -dumpmachine 2>/dev/null)),-march=x86-64-v2)
C_WARNINGS := $(WARNINGS) -Wstrict-prototypes -Wmissing-prototypes

LP_CPPFLAGS = -D_GNU_SOURCE -DLP_VERSION='"$(VERSION)"' \
	$(foreach o,$(WITH_OPTIONS),-DWITH_$o=$(WITH_$o)) \
	-Idaemon -Idaemon/include -I$(GEN) -isystem $(SYSROOT)/usr/include/opencv4 $(NANOPB_CPPFLAGS) -MMD -MP
# Debian 13 has nanopb's headers in a folder of their own.
NANOPB_CPPFLAGS := $(addprefix -isystem ,$(wildcard $(SYSROOT)/usr/include/nanopb))
# PREFIX_MAP: how a package hides the folder in which it is built, so that its bytes do not depend on it.
PREFIX_MAP ?=
LP_CFLAGS = -std=c17 -g $(PREFIX_MAP) $(ARCH_FLAGS) $(FLAGS_$(VARIANT)) $(C_WARNINGS) $(LP_PACKAGE_CFLAGS)
# Asked for when first needed, and once.
LP_PACKAGE_CFLAGS = $(eval LP_PACKAGE_CFLAGS := $(shell $(PKG_CONFIG) --cflags $(LP_PACKAGES)))$(LP_PACKAGE_CFLAGS)
LP_CXXFLAGS = -std=c++17 -g $(PREFIX_MAP) $(ARCH_FLAGS) $(FLAGS_$(VARIANT)) $(WARNINGS) $(LIBCAMERA_CFLAGS)
LP_LDFLAGS = $(FLAGS_$(VARIANT))
LP_LDLIBS = $(shell $(PKG_CONFIG) --libs $(LP_PACKAGES)) -lopencv_imgproc -lopencv_core \
	-lprotobuf-nanopb -lstdc++ -lpthread -lm

# Its headers are not held to our warnings.
LIBCAMERA_CFLAGS = $(if $(filter 1,$(WITH_LIBCAMERA)),$(subst -I,-isystem ,$(shell $(PKG_CONFIG) --cflags libcamera)))

# In one file alone, so that ccache knows the objects of variants with the same flags.
$(OUT)/daemon/app/main.c.o: LP_CPPFLAGS += -DLP_VARIANT='"$(VARIANT)"'

# Two of a walk's registers in one vector register would cost every step four more moves.
$(OUT)/daemon/vision/jpeg/walk.c.o: LP_CFLAGS += -fno-tree-slp-vectorize

DAEMON_ROOMS := app serve estimate drivers vision light base
# Sources of one room, in all of its folders: $(call sources,ROOM,PATTERN...)
sources = $(foreach p,$(2),$(wildcard daemon/$(1)/$(p) daemon/$(1)/*/$(p) daemon/$(1)/*/*/$(p)))
# Sources that a variant compiles itself; of all others it has the objects of the release. Empty: all.
OWN_gpiod2 := daemon/drivers/wheel/pca9685/% %/main.c
OWN := $(or $(OWN_$(VARIANT)),%)
# Objects of one room: $(call objects,ROOM)
built = $(filter-out $(LP_EXCLUDE),$(call sources,$(1),*.c *.cpp))
objects = $(patsubst %,$(OUT)/%.o,$(filter $(OWN),$(call built,$(1)))) \
	$(patsubst %,$(BUILD)/release/%.o,$(filter-out $(OWN),$(call built,$(1))))
# Everything but main() is in libraries, so that tests link what the daemon links.
DAEMON_LIBS := $(foreach r,$(DAEMON_ROOMS),$(OUT)/lib/liblp_$(r).a)

.PHONY: daemon
daemon: $(OUT)/bin/lightprobed

$(OUT)/bin/lightprobed: $(OUT)/daemon/app/main.c.o $(DAEMON_LIBS)
	@mkdir -p $(@D) && echo '  ld $@'
	@$(CC) $(LP_LDFLAGS) -o $@ $^ $(LP_LDLIBS)

$(OUT)/lib/liblp_serve.a: $(OUT)/proto/lightprobe.pb.c.o
$(OUT)/lib/liblp_drivers.a: $(OUT)/dbc/mcu.c.o
define lp_library
$(OUT)/lib/liblp_$(1).a: $(filter-out %/main.c.o,$(call objects,$(1)))
	@mkdir -p $$(@D) && rm -f $$@
	@$(AR) qcs $$@ $$^ # appends: several folders have a sim.c
endef
$(foreach r,$(DAEMON_ROOMS),$(eval $(call lp_library,$(r))))

$(OUT)/%.c.o: %.c $(OUT)/packages.stamp | $(PROTO_H) $(RANGES_H) $(FLAGS_H) $(DBC_H) $(MCU_FAULTS_H)
	@mkdir -p $(@D) && echo '  cc $@'
	@$(CC) $(LP_CPPFLAGS) $(LP_CFLAGS) -c -o $@ $<

$(OUT)/%.cpp.o: %.cpp $(OUT)/packages.stamp | $(PROTO_H) $(FLAGS_H)
	@mkdir -p $(@D) && echo '  c++ $@'
	@$(CXX) $(LP_CPPFLAGS) $(LP_CXXFLAGS) -c -o $@ $<

$(OUT)/proto/%.c.o: $(GEN)/proto/%.c
	@mkdir -p $(@D) && echo '  cc $@'
	@$(CC) $(LP_CPPFLAGS) $(filter-out -Wundef,$(LP_CFLAGS)) -c -o $@ $<

$(OUT)/dbc/%.c.o: $(GEN)/dbc/%.c
	@mkdir -p $(@D) && echo '  cc $@'
	@$(CC) $(LP_CPPFLAGS) $(filter-out -Wundef,$(LP_CFLAGS)) -c -o $@ $<

# Optional libraries are asked for once per variant and choice.
WITH_CHOICE := $(foreach o,$(WITH_OPTIONS),WITH_$o=$(WITH_$o))
$(OUT)/packages.stamp: daemon/daemon.mk $(OUT)/with.choice $(SYSROOT:$(BUILD)/%=$(STAMPS)/%)
	@mkdir -p $(@D)
	@$(foreach o,$(WITH_OPTIONS),if [ '$(WITH_$o)' = 1 ] && ! $(PKG_CONFIG) --exists libuv $(PACKAGE_$o); then \
		echo 'build: $(PACKAGE_$o) is missing: apt-get install $(DEBIAN_$o), or build without: make daemon WITH_$o=0' >&2; \
		exit 1; fi;)
	@touch $@
$(OUT)/with.choice: FORCE
	@mkdir -p $(@D)
	@echo '$(WITH_CHOICE)' | cmp -s - $@ || echo '$(WITH_CHOICE)' >$@
FORCE:

DAEMON_SOURCES = $(foreach r,include $(DAEMON_ROOMS),$(call sources,$(r),*.[ch] *.cpp *.hpp))

.PHONY: check-c format-c
# The analyzer follows every path through a function: ten times the time of all other checks together.
TIDY_CHECKS := -clang-analyzer-*
.PHONY: check-c-paths
check-c-paths: ## as check-c, with clang's static analyzer (ten minutes)
	@$(MAKE) check-c TIDY_CHECKS=clang-analyzer-*
check-c: $(PROTO_H) $(RANGES_H) $(FLAGS_H) ## clang-format and clang-tidy over the C and C++ sources
	@clang-format --dry-run -Werror $(C_SOURCES)
	@printf '%s\n' $(filter-out $(LP_EXCLUDE),$(filter %.c,$(DAEMON_SOURCES))) | xargs -P$(JOBS) -I@ clang-tidy --quiet \
		--checks='$(TIDY_CHECKS)' --warnings-as-errors='*' @ -- -std=c17 -DLP_VARIANT='""' $(filter-out -MMD -MP,$(LP_CPPFLAGS)) 2>&1 \
		| { grep -vE 'warnings? generated|^$$' || true; }
format-c:
	@clang-format -i $(C_SOURCES)

-include $(shell find $(OUT) -name '*.d' 2>/dev/null)
