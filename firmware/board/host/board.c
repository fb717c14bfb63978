/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>

#include "board/host/boot.h"
#include "board/host/host.h"
#include "ring.h"

#define FRAME_US 20000
#define EEPROM_WRITE_US 3400

struct host host;

void host_init(uint32_t seed)
{
	memset(&host, 0, sizeof(host));
	memset(host.eeprom, 0xFF, sizeof(host.eeprom));
	world_init(&host.world, seed);
	host.reset_cause = RESET_CAUSE_POWER_ON;
	host.programmer = (struct stk500){.flash = host.flash, .flash_bytes = HOST_FLASH_BYTES};
}

/* --- boot loader ---------------------------------------------------------------------------- */

static uint8_t mcusr(void)
{
	switch (host.reset_cause) {
	case RESET_CAUSE_POWER_ON:
		return BOOT_POWER_ON;
	case RESET_CAUSE_EXTERNAL:
		return BOOT_EXTERNAL;
	case RESET_CAUSE_BROWN_OUT:
		return BOOT_BROWN_OUT;
	default: /* all others are made by the watchdog */
		return BOOT_WATCHDOG;
	}
}

void host_boot(void)
{
	struct boot boot = boot_after((enum boot_loader)host.world.boot_loader, mcusr());
	uint64_t wait_us = boot.waits ? (uint64_t)(host.world.boot_wait_ms * 1000) : 0;

	host.reset_asked = false;
	stk500_start(&host.programmer);
	host.sample_us = 0;
	host.boot_us = boot.hangs ? UINT64_MAX : host.t_us + wait_us;
}

bool host_booting(void)
{
	return host.t_us < host.boot_us;
}

/* --- time ----------------------------------------------------------------------------------- */

/* As the chip's interrupt does. */
static void see_index(uint8_t levels)
{
	struct board_index *index = &host.index;
	uint8_t quarter_before = index->levels ^ index->levels >> 1;
	uint8_t step = ((levels ^ levels >> 1) - quarter_before) & 3;

	index->levels = levels;
	index->changes++;
	index->count += step == 1 ? 1 : step == 3 ? -1 : 0;
	index->errors += step == 2;
}

static uint16_t convert(uint8_t slot)
{
	double mv = host.world.bandgap_mv;

	if (slot < BOARD_LDRS)
		mv = world_ldr_mv(&host.world, slot);
	if (slot == BOARD_SLOT_FEEDBACK)
		mv = world_feedback_mv(&host.world);
	double level = world_adc_mv(&host.world, mv) * 1024 / host.world.supply_mv;
	return level > 1023 ? 1023 : (uint16_t)level;
}

static void sample(void)
{
	uint8_t slot = host.slot;

	host.sample_next_us += host.sample_us;
	if (slot < BOARD_LDRS - 1) {
		host.slot++;
	} else if (slot == BOARD_LDRS - 1) {
		host.slot = host.supply_turn ? BOARD_SLOT_SUPPLY : BOARD_SLOT_FEEDBACK;
		host.supply_turn = !host.supply_turn;
	} else {
		host.slot = 0;
	}
	board_on_conversion(slot, convert(slot));
}

static void step(void)
{
	host.t_us += WORLD_STEP_US;
	while (host.t_us >= host.frame_us) {
		host.frame_us += FRAME_US;
		if (host.servo_half_us)
			world_pulse(&host.world, host.servo_half_us / 2.0);
	}
	world_step(&host.world);
	if (host.world.index_levels != host.index.levels)
		see_index(host.world.index_levels);
	while (host.sample_us && host.t_us >= host.sample_next_us)
		sample();
}

void host_pass(uint32_t us)
{
	for (uint32_t passed_us = 0; passed_us < us; passed_us += WORLD_STEP_US)
		step();
}

uint32_t board_time_us(void)
{
	return (uint32_t)host.t_us;
}

/* --- the contract --------------------------------------------------------------------------- */

void board_init(struct board_info *info)
{
	info->kind = BOARD_HOST;
	info->carrier = host.carrier;
	info->reset_cause = host.reset_cause;
	info->boot_count = ++host.boot_count;
	host.reset_asked = false;
	host.frame_us = host.t_us;
	host.index = (struct board_index){.levels = host.world.index_levels};
	host.in_first = host.in_end;
	host.zeros = 0;
	host.sample_us = 0;
}

/* There is no watchdog and no stack to guard here: the operating system has both. */
void board_alive(void)
{
}

bool board_stack_ok(void)
{
	return true;
}

uint16_t board_stack_free_bytes(void)
{
	return UINT16_MAX;
}

void board_idle(void)
{
}

void board_reset(enum reset_cause cause)
{
	board_servo(0);
	host.reset_cause = cause;
	host.reset_asked = true;
}

void board_servo(uint16_t half_us)
{
	host.servo_half_us = half_us;
	world_power(&host.world, half_us != 0);
}

void board_index(struct board_index *index)
{
	*index = host.index;
}

void board_sample(uint8_t period_us)
{
	host.sample_us = period_us;
	host.sample_next_us = host.t_us + period_us;
	host.slot = 0;
}

/* Nothing interrupts. */
void board_lock(void)
{
}

void board_unlock(void)
{
}

uint8_t board_eeprom_read(uint16_t address)
{
	return host.eeprom[address % HOST_EEPROM_BYTES];
}

bool board_eeprom_ready(void)
{
	return host.t_us >= host.eeprom_ready_us;
}

void board_eeprom_write(uint16_t address, uint8_t value)
{
	host.eeprom_ready_us = host.t_us + EEPROM_WRITE_US;
	host.eeprom[address] = value;
	if (address == host.worn_address)
		host.eeprom[address] = (value & ~host.worn_bits) | host.worn_held;
}

/* --- carriers ------------------------------------------------------------------------------- */

/* The boot loader stays for as long as somebody programs. */
static void program(uint8_t byte)
{
	uint8_t reply[STK500_REPLY_BYTES];
	size_t bytes = stk500_byte(&host.programmer, byte, reply);

	if (bytes && host.out)
		host.out(host.context, reply, bytes);
	if (host.programmer.synchronized)
		host.boot_us = host.programmer.left ? host.t_us : UINT64_MAX;
}

void host_send(const uint8_t *bytes, unsigned count)
{
	if (host.reset_asked || host_booting()) {
		for (unsigned i = 0; i < count; i++)
			program(bytes[i]);
		return;
	}
	for (unsigned i = 0; i < count; i++) {
		if (host.in_end - host.in_first == HOST_LINE_BYTES) {
			host.overruns++;
			continue;
		}
		host.in[host.in_end++ % HOST_LINE_BYTES] = bytes[i];
		if (bytes[i] == 0) {
			host.zeros++;
			host.zero_us = (uint32_t)host.t_us;
		}
	}
}

int16_t board_uart_get(void)
{
	if (host.in_first == host.in_end)
		return -1;
	uint8_t byte = host.in[host.in_first++ % HOST_LINE_BYTES];
	if (byte == 0)
		host.zeros--;
	return byte;
}

bool board_uart_put(const uint8_t *bytes, uint8_t count)
{
	if (host.out)
		host.out(host.context, bytes, count);
	return true;
}

bool board_uart_stamp(uint32_t *t_us)
{
	*t_us = host.zero_us;
	return host.zeros == 0;
}

uint8_t board_uart_overruns(void)
{
	return host.overruns;
}

void board_i2c_start(uint8_t address)
{
	(void)address;
}

bool board_i2c_receive(uint8_t *bytes, uint8_t *count, uint32_t *t_us)
{
	if (!host.mail_waits)
		return false;
	memcpy(bytes, host.mail_in, sizeof(host.mail_in));
	*count = host.mail_in_count;
	*t_us = (uint32_t)host.t_us;
	host.mail_waits = false;
	return true;
}

bool board_i2c_offer(const uint8_t *bytes)
{
	if (host.mail_offered)
		return false;
	memcpy(host.mail_out, bytes, sizeof(host.mail_out));
	host.mail_offered = true;
	return true;
}

uint8_t board_i2c_bus_errors(void)
{
	return host.bus_errors;
}

void board_spi_start(void)
{
}

void board_spi_select(bool selected)
{
	(void)selected;
}

uint8_t board_spi_exchange(uint8_t byte)
{
	return host.spi ? host.spi(host.context, byte) : 0xFF;
}

bool board_can_waiting(uint32_t *t_us, bool *fresh)
{
	*t_us = (uint32_t)host.t_us;
	*fresh = true;
	return host.can_waiting;
}
