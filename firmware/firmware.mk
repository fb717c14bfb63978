# SPDX-License-Identifier: Apache-2.0
# The microcontroller's firmware: the binary that is flashed, the same code as a Linux process, and the sizes that
# it must keep to.

FW := firmware
FW_OUT := $(BUILD)/firmware
FW_ELF := $(FW_OUT)/lightprobe-mcu.elf
FW_HEX := $(FW_OUT)/lightprobe-mcu.hex
FW_HOST := $(FW_OUT)/lightprobe-mcu-host
FW_CORE := $(wildcard $(FW)/*.c)
FW_CPPFLAGS := -I$(FW) -I$(GEN) -MMD -MP

# gcc-avr 5.4 has C17 under the name of the standard that it corrects.
AVR_CC := avr-gcc
AVR_MCU := atmega328p
AVR_CODE := -mmcu=$(AVR_MCU) -Os -flto -mcall-prologues -mstrict-X
AVR_CFLAGS := $(AVR_CODE) -DF_CPU=16000000UL -std=gnu11 -ffreestanding -fno-fat-lto-objects \
	-ffunction-sections -fdata-sections -Wall -Wextra -Werror -Wshadow -Wstrict-prototypes -Wundef
AVR_LDFLAGS := $(AVR_CODE) -Wl,--gc-sections -mrelax
FW_AVR_OBJECTS := $(patsubst %.c,$(FW_OUT)/avr/%.o,$(FW_CORE) $(wildcard $(FW)/board/atmega328p/*.c)) \
	$(FW_OUT)/avr/mcu.o

.PHONY: firmware firmware-host firmware-avr flash
firmware: $(FW_HEX) ## build the microcontroller's binary: build/firmware/lightprobe-mcu.{elf,hex}

$(FW_OUT)/avr/%.o: %.c $(DBC_H) $(MCU_FAULTS_H) | $(call apt,firmware)
	@mkdir -p $(@D)
	@echo '  avr-cc $@' && $(AVR_CC) $(FW_CPPFLAGS) $(AVR_CFLAGS) -c -o $@ $<
$(FW_OUT)/avr/mcu.o: $(DBC_C) | $(call apt,firmware)
	@mkdir -p $(@D)
	@echo '  avr-cc $@' && $(AVR_CC) $(FW_CPPFLAGS) $(filter-out -Wundef,$(AVR_CFLAGS)) -c -o $@ $<
$(FW_ELF): $(FW_AVR_OBJECTS)
	@echo '  avr-ld $@' && $(AVR_CC) $(AVR_LDFLAGS) -Wl,-Map=$(@:.elf=.map) -o $@ $^
$(FW_HEX): $(FW_ELF)
	@avr-objcopy -j .text -j .data -O ihex $< $@

# The portable core and the host board, once per variant; the process, and what tests/ links.
FW_HOST_CFLAGS = -std=gnu17 -g $(PREFIX_MAP) -D_GNU_SOURCE $(FLAGS_$(1)) $(C_WARNINGS) $(FW_CPPFLAGS)
FW_BOX := world boot stk500 console line frame_log
FW_HOST_PARTS := $(FW)/board/host/board.c $(FW_BOX:%=$(FW)/board/host/%.c)
define fw_host
FW_OBJECTS_$(1) := $$(patsubst %.c,$$(FW_OUT)/$(1)/%.o,$$(FW_CORE) $$(FW_HOST_PARTS)) $$(FW_OUT)/$(1)/mcu.o
$$(FW_OUT)/$(1)/%.o: %.c $$(DBC_H) $$(MCU_FAULTS_H)
	@mkdir -p $$(@D)
	@echo '  cc $$@' && $$(CC) $$(call FW_HOST_CFLAGS,$(1)) -c -o $$@ $$<
$$(FW_OUT)/$(1)/mcu.o: $$(DBC_C)
	@mkdir -p $$(@D)
	@echo '  cc $$@' && $$(CC) $$(filter-out -Wundef,$$(call FW_HOST_CFLAGS,$(1))) -c -o $$@ $$<
endef
$(foreach v,release asan fuzz,$(eval $(call fw_host,$(v))))

firmware-host: $(FW_HOST) ## build the same firmware as a Linux process on a pty
$(FW_HOST): $(FW_OUT)/release/$(FW)/board/host/main.o $(FW_OBJECTS_release)
	@echo '  ld $@' && $(CC) -o $@ $^ -lm
$(FW_HOST)-asan: $(FW_OUT)/asan/$(FW)/board/host/main.o $(FW_OBJECTS_asan)
	@echo '  ld $@' && $(CC) $(FLAGS_asan) -o $@ $^ -lm

# The flashed binary in simavr, in the same box.
FW_SIMAVR := $(FW_OUT)/lightprobe-mcu-simavr
FW_SIMAVR_OBJECTS := $(patsubst %.c,$(FW_OUT)/release/%.o,$(wildcard $(FW)/simavr/*.c))

firmware-avr: $(FW_SIMAVR) $(FW_ELF) ## build the flashed firmware as a process, in simavr
$(FW_SIMAVR_OBJECTS): | $(call apt,firmware)
$(FW_SIMAVR): $(FW_SIMAVR_OBJECTS) $(FW_BOX:%=$(FW_OUT)/release/$(FW)/board/host/%.o)
	@echo '  ld $@' && $(CC) -o $@ $^ -lsimavr -lelf -lm

PORT ?= /dev/ttyUSB0
FLASH_BAUD ?= 115200
flash: $(FW_HEX) ## write the firmware to an Arduino Nano: PORT=/dev/ttyUSB0; old boot loader: FLASH_BAUD=57600
	avrdude -p m328p -c arduino -P $(PORT) -b $(FLASH_BAUD) -U flash:w:$<:i

include tests/firmware/firmware-tests.mk
-include $(shell find $(FW_OUT) -name '*.d' 2>/dev/null)
