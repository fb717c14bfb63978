# SPDX-License-Identifier: Apache-2.0
# Tests on a real kernel: Debian's, in QEMU, with devices made in software (README.md here).

UVC_CAMERA := $(BUILD)/kernel/bin/uvc_camera
UVC_CAMERA_OBJECTS := $(patsubst %.c,$(BUILD)/kernel/obj/%.o,$(notdir $(wildcard tests/kernel/uvc_camera/*.c)))
GYRO_SAMPLES := $(BUILD)/kernel/bin/gyro_samples
KERNEL_PICTURES := $(BUILD)/kernel/pictures
GROUP ?=
C_SOURCES += $(wildcard tests/kernel/*.c tests/kernel/uvc_camera/*.[ch])

.PHONY: test-kernel test-nightly-kernel kernel-coverage kernel-shell kernel-list kernel-setup
test-kernel: kernel-setup ## run the tests on Debian's kernel in QEMU; GROUP=uvc for one group, make kernel-list lists them
	@$(PYTHON) tests/kernel/run.py $(GROUP)

test-nightly-kernel: kernel-setup ## run them all, also those that only test-nightly runs; GROUP=uvc for one group
	@$(PYTHON) tests/kernel/run.py --nightly $(GROUP)

kernel-coverage: kernel-setup ## run the kernel tests with line coverage of the daemon
	@$(MAKE) VARIANT=cov -j$(JOBS) daemon
	@$(PYTHON) tests/kernel/run.py --variant=cov $(GROUP)

kernel-shell: kernel-setup ## open a shell in the guest of the kernel tests, with all devices
	@$(PYTHON) tests/kernel/run.py --shell

kernel-list:
	@$(PYTHON) tests/kernel/run.py --list

kernel-setup: $(call apt,kernel) build $(UVC_CAMERA) $(GYRO_SAMPLES) $(KERNEL_PICTURES)/truth.json
	@$(MAKE) -j$(JOBS) firmware-host
	@$(MAKE) gpiod2
	@$(PYTHON) tests/kernel/kernel_package.py

# The daemon on libgpiod 2 (build/gpiod2/bin), as on Debian 13; the system's may be version 1.
.PHONY: gpiod2
gpiod2: $(BUILD)/libgpiod2/libgpiod.pc
	@$(MAKE) VARIANT=release -j$(JOBS) daemon
	@$(MAKE) VARIANT=gpiod2 -j$(JOBS) daemon

$(BUILD)/libgpiod2/libgpiod.pc: tests/kernel/build-libgpiod2 | setup
	@echo 'setup: libgpiod 2 from the source in its Python package'
	@$< $(VENV)/bin/pip $(@D)

$(KERNEL_PICTURES)/truth.json: tests/kernel/make_pictures.py $(wildcard host_py/lightprobe/*.py host_py/lightprobe/imaging/*.py host_py/lightprobe/sim/*.py) | setup
	@$(VENV)/bin/python $< $(@D)

$(UVC_CAMERA): $(UVC_CAMERA_OBJECTS)
	@mkdir -p $(@D)
	gcc -o $@ $^ -lturbojpeg -lpthread -lm

# The daemon's driver of gyroscopes alone.
$(GYRO_SAMPLES): $(OUT)/tests/kernel/gyro_samples.c.o $(DAEMON_LIBS)
	@mkdir -p $(@D)
	@$(CC) $(LP_LDFLAGS) -o $@ $^ $(LP_LDLIBS)

$(BUILD)/kernel/obj/%.o: tests/kernel/uvc_camera/%.c | $(call apt,build)
	@mkdir -p $(@D)
	gcc -std=c17 -D_GNU_SOURCE -O2 -g $(C_WARNINGS) -MMD -MP -c -o $@ $<
-include $(UVC_CAMERA_OBJECTS:.o=.d)
