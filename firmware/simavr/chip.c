/* SPDX-License-Identifier: Apache-2.0 */
#include "chip.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_timer.h>
#include <simavr/avr_twi.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_elf.h>

#include "mcp2515.h"

/* Pins: firmware/board/atmega328p/pins.h. */
#define INDEX_BIT 2 /* and 3 */
#define MUX_BIT 4
#define SERVO_POWER_BIT 2
#define STRAP_ADC 3
#define REGISTER_ADMUX 0x7C /* in data space */
#define MUX_MASK 0x0F
#define MUX_BANDGAP 0x0E
#define REGISTER_MCUSR 0x54
#define REGISTER_WDTCSR 0x60
#define WDT_PENDING 0xC8 /* interrupt flagged and enabled, reset enabled */
#define R2 2

#define REGISTER_EECR 0x3F /* in data space */
#define EEPE 0x02
#define EEMPE 0x04
#define EEPROM_WRITE_US 3400

#define I2C_BYTE_CYCLES (9 * CHIP_HZ / 400000)
#define I2C_PATIENCE_CYCLES CHIP_US(20000)

/* --- inputs -------------------------------------------------------------------------------------
 */

/* simavr forgets injected levels at the next write to the port, unless they are declared external
 * too. */
void chip_pin(struct chip *chip, char port, uint8_t bit, bool high)
{
	int at = port - 'B';

	chip->external_mask[at] |= 1 << bit;
	chip->external_value[at] &= ~(1 << bit);
	chip->external_value[at] |= high << bit;
	avr_ioport_external_t external = {
		.name = port,
		.mask = chip->external_mask[at],
		.value = chip->external_value[at],
	};
	avr_ioctl(chip->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &external);
	avr_raise_irq(avr_io_getirq(chip->avr, AVR_IOCTL_IOPORT_GETIRQ(port), bit), high);
}

/* simavr never resets while the watchdog's interrupt waits; a real one does at its second timeout.
 */
static void watch_watchdog(struct chip *chip)
{
	uint8_t control = chip->avr->data[REGISTER_WDTCSR];
	unsigned timeout_us = 16000u << (control & 7);

	chip->wdt_pending_us =
		(control & WDT_PENDING) == WDT_PENDING ? chip->wdt_pending_us + WORLD_STEP_US : 0;
	if (chip->wdt_pending_us >= timeout_us)
		chip->wdt_bites = true;
}

static avr_cycle_count_t world_timer(avr_t *avr, avr_cycle_count_t when, void *context)
{
	struct chip *chip = context;
	uint8_t before = chip->world.index_levels;

	world_step(&chip->world);
	for (int bit = 0; bit < 2; bit++) {
		if ((chip->world.index_levels ^ before) >> bit & 1)
			chip_pin(chip, 'D', INDEX_BIT + bit,
				 !(chip->world.index_levels >> bit & 1));
	}
	avr->vcc = avr->avcc = avr->aref = chip->world.supply_mv;
	watch_watchdog(chip);
	return when + CHIP_US(WORLD_STEP_US);
}

/* A conversion samples its input one and a half clocks of 4 us after the start. */
#define SAMPLE_US 6

static avr_adc_t *find_adc(struct chip *chip)
{
	for (avr_io_t *io = chip->avr->io_port; io; io = io->next) {
		if (strcmp(io->kind, "adc") == 0)
			return (avr_adc_t *)io;
	}
	return NULL;
}

static void on_admux(avr_t *avr, avr_io_addr_t address, uint8_t value, void *context)
{
	struct chip *chip = context;
	bool bandgap = (value & MUX_MASK) == MUX_BANDGAP;

	avr->data[address] = value;
	if (bandgap && !chip->bandgap)
		chip->bandgap_cycle = avr->cycle;
	chip->bandgap = bandgap;
}

/* simavr knows one exact reference; this one has a spread, and comes slowly. */
static void convert_bandgap(struct chip *chip)
{
	double since_us = (chip->avr->cycle - chip->bandgap_cycle) / (CHIP_HZ / 1e6) + SAMPLE_US;
	double mv = world_bandgap_mv(&chip->world, chip->adc_mv, since_us);

	find_adc(chip)->muxmode[MUX_BANDGAP].src = (unsigned)world_adc_mv(&chip->world, mv);
}

/* A conversion starts: simavr takes the level when the result is read, so it is set now. */
static void on_adc(struct avr_irq_t *irq, uint32_t value, void *context)
{
	struct chip *chip = context;
	union {
		avr_adc_mux_t mux;
		uint32_t value;
	} asked = {.value = value};

	(void)irq;
	if (chip->bandgap)
		convert_bandgap(chip);
	if (asked.mux.kind != ADC_MUX_SINGLE)
		return;
	chip->world.t_us = chip->avr->cycle / (CHIP_HZ / 1e6);
	if (asked.mux.src == 0)
		chip->adc_mv = world_ldr_mv(&chip->world, chip->mux);
	else if (asked.mux.src == 1)
		chip->adc_mv = world_feedback_mv(&chip->world);
	else if (asked.mux.src == STRAP_ADC)
		chip->adc_mv = chip->strap * chip->world.supply_mv;
	else
		chip->adc_mv = 0;
	avr_raise_irq(chip->adc + ADC_IRQ_ADC0 + asked.mux.src,
		      world_adc_mv(&chip->world, chip->adc_mv));
}

/* --- outputs ------------------------------------------------------------------------------------
 */

static void on_pulse(struct avr_irq_t *irq, uint32_t value, void *context)
{
	struct chip *chip = context;
	struct chip_servo *servo = &chip->servo;
	uint64_t cycle = chip->avr->cycle;

	(void)irq;
	/* simavr tells the rise again when the timer's interrupt touches the pin. */
	if (value && chip->pulse_high)
		return;
	chip->pulse_high = value;
	if (value) {
		if (chip->rise_cycle)
			servo->period_us = (cycle - chip->rise_cycle) / (CHIP_HZ / 1e6);
		chip->rise_cycle = cycle;
		return;
	}
	if (!chip->rise_cycle)
		return;
	double width_us = (cycle - chip->rise_cycle) / (CHIP_HZ / 1e6);
	servo->last_us = cycle / (CHIP_HZ / 1000000);
	if (servo->pulses++ == 0) {
		servo->first_us = servo->last_us;
		servo->least_us = servo->most_us = width_us;
	}
	servo->least_us = width_us < servo->least_us ? width_us : servo->least_us;
	servo->most_us = width_us > servo->most_us ? width_us : servo->most_us;
	world_pulse(&chip->world, width_us);
}

static void on_port_c(struct avr_irq_t *irq, uint32_t value, void *context)
{
	struct chip *chip = context;

	(void)irq;
	world_power(&chip->world, value >> SERVO_POWER_BIT & 1);
}

static void on_port_d(struct avr_irq_t *irq, uint32_t value, void *context)
{
	struct chip *chip = context;

	(void)irq;
	chip->mux = value >> MUX_BIT & 0x0F;
}

/* --- serial line --------------------------------------------------------------------------------
 */

static void on_uart_out(struct avr_irq_t *irq, uint32_t value, void *context)
{
	struct chip *chip = context;
	uint64_t t_us = chip->avr->cycle / (CHIP_HZ / 1000000);

	(void)irq;
	if (chip->line_out)
		chip->line_out(chip->line_out_context, value);
	frame_log_byte(&chip->log, value, t_us, &chip->world);
}

static void on_xon(struct avr_irq_t *irq, uint32_t value, void *context)
{
	(void)irq, (void)value;
	((struct chip *)context)->line_in_wait = false;
}

static void on_xoff(struct avr_irq_t *irq, uint32_t value, void *context)
{
	(void)irq;
	if (value)
		((struct chip *)context)->line_in_wait = true;
}

static avr_cycle_count_t line_timer(avr_t *avr, avr_cycle_count_t when, void *context)
{
	struct chip *chip = context;

	(void)avr;
	if (chip->line_in_first == chip->line_in_end) {
		chip->line_in_running = false;
		return 0;
	}
	if (!chip->line_in_wait)
		avr_raise_irq(chip->uart_in,
			      chip->line_in[chip->line_in_first++ % CHIP_LINE_BYTES]);
	return when + CHIP_US(CHIP_BYTE_US);
}

bool chip_booting(const struct chip *chip)
{
	return chip->reset || chip->booting;
}

/* The boot loader stays for as long as somebody programs. */
static void program(struct chip *chip, uint8_t byte)
{
	uint8_t reply[STK500_REPLY_BYTES];
	size_t bytes = stk500_byte(&chip->programmer, byte, reply);

	for (size_t i = 0; i < bytes && chip->line_out; i++)
		chip->line_out(chip->line_out_context, reply[i]);
	if (chip->programmer.synchronized)
		chip->boot_cycle = chip->programmer.left ? chip->avr->cycle : UINT64_MAX;
}

bool chip_send(struct chip *chip, const uint8_t *bytes, size_t count)
{
	if (count > CHIP_LINE_BYTES - (chip->line_in_end - chip->line_in_first))
		return false;
	if (chip_booting(chip)) {
		for (size_t i = 0; i < count; i++)
			program(chip, bytes[i]);
		return true;
	}
	for (size_t i = 0; i < count; i++)
		chip->line_in[chip->line_in_end++ % CHIP_LINE_BYTES] = bytes[i];
	if (!chip->line_in_running && count) {
		chip->line_in_running = true;
		avr_cycle_timer_register(chip->avr, CHIP_US(CHIP_BYTE_US), line_timer, chip);
	}
	return true;
}

/* --- EEPROM: simavr writes at once; a real one is busy for a while ------------------------------
 */

static avr_cycle_count_t eeprom_timer(avr_t *avr, avr_cycle_count_t when, void *context)
{
	(void)when, (void)context;
	avr->data[REGISTER_EECR] &= ~EEPE;
	return 0;
}

static void on_eeprom_control(avr_t *avr, avr_io_addr_t address, uint8_t value, void *context)
{
	struct chip *chip = context;
	uint8_t *worn = chip_eeprom(chip) + chip->worn_address;

	(void)address;
	if (!(value & EEPE) || !(value & EEMPE))
		return;
	*worn = (*worn & ~chip->worn_bits) | chip->worn_held;
	avr->data[REGISTER_EECR] |= EEPE;
	avr_cycle_timer_register(avr, CHIP_US(EEPROM_WRITE_US), eeprom_timer, context);
}

uint8_t *chip_eeprom(struct chip *chip)
{
	avr_eeprom_desc_t where = {.ee = NULL, .offset = 0, .size = CHIP_EEPROM_BYTES};

	avr_ioctl(chip->avr, AVR_IOCTL_EEPROM_GET, &where);
	return where.ee;
}

/* --- I2C: simavr 1.6 has no usable slave; its states are set here as a master would cause them
 * ----- */

static void on_twi(struct avr_irq_t *irq, uint32_t value, void *context)
{
	struct chip *chip = context;
	avr_twi_msg_irq_t message = {.u.v = value};

	(void)irq;
	if (!(message.u.twi.msg & TWI_COND_ADDR))
		return;
	chip->twi_answered = true;
	chip->twi_acknowledged = message.u.twi.msg & TWI_COND_ACK;
	chip->twi_data = message.u.twi.data;
	chip->twi_cycle = chip->avr->cycle;
}

static avr_twi_t *find_twi(struct chip *chip)
{
	for (avr_io_t *io = chip->avr->io_port; io; io = io->next) {
		if (strcmp(io->kind, "twi") == 0)
			return (avr_twi_t *)io;
	}
	return NULL;
}

/* Puts the slave into a state and runs until the firmware has dealt with it. */
static bool twi_state(struct chip *chip, uint8_t status, double *stretch_us)
{
	avr_twi_t *twi = find_twi(chip);
	uint64_t start = chip->avr->cycle;

	if (!avr_regbit_get(chip->avr, twi->twen))
		return false;
	twi->state = TWI_COND_SLAVE | TWI_COND_ADDR;
	twi->peer_addr = 0;
	chip->twi_answered = false;
	avr_regbit_setto_raw(chip->avr, twi->twsr, status);
	avr_raise_interrupt(chip->avr, &twi->twi);
	while (!chip->twi_answered && !chip->dead && chip->avr->cycle - start < I2C_PATIENCE_CYCLES)
		chip_run_until(chip, chip->avr->cycle + 16);
	double held_us = (chip->twi_cycle - start) / (CHIP_HZ / 1e6);
	if (chip->twi_answered && held_us > *stretch_us)
		*stretch_us = held_us;
	return chip->twi_answered;
}

static void twi_byte_time(struct chip *chip)
{
	chip_run_until(chip, chip->avr->cycle + I2C_BYTE_CYCLES);
}

static void twi_put(struct chip *chip, uint8_t value)
{
	chip->avr->data[find_twi(chip)->r_twdr] = value;
}

int chip_twi_write(struct chip *chip, const uint8_t *bytes, int count, double *stretch_us)
{
	int done = 0;

	*stretch_us = 0;
	if (!twi_state(chip, 0x60, stretch_us)) /* addressed to write */
		return -1;
	while (done < count && chip->twi_acknowledged) {
		twi_byte_time(chip);
		twi_put(chip, bytes[done]);
		if (!twi_state(chip, 0x80, stretch_us))
			return done;
		done++;
	}
	if (done < count) { /* the next byte arrives and is not acknowledged */
		twi_byte_time(chip);
		twi_state(chip, 0x88, stretch_us);
		return done;
	}
	twi_byte_time(chip);
	twi_state(chip, 0xA0, stretch_us); /* stop, while still addressed */
	return done;
}

int chip_twi_read(struct chip *chip, uint8_t *bytes, int count, double *stretch_us)
{
	*stretch_us = 0;
	if (!twi_state(chip, 0xA8, stretch_us)) /* addressed to read */
		return -1;
	for (int i = 0; i < count; i++) {
		bytes[i] = chip->twi_data;
		twi_byte_time(chip);
		/* The master acknowledges all bytes but the last. */
		if (!twi_state(chip, i == count - 1 ? 0xC0 : 0xB8, stretch_us))
			return i;
	}
	return count;
}

void chip_twi_error(struct chip *chip)
{
	double stretch_us = 0;

	twi_state(chip, 0x00, &stretch_us);
}

/* --- the chip -----------------------------------------------------------------------------------
 */

/* simavr drops all timers at a reset, the watchdog's too: ours are started again. */
static void start_timers(struct chip *chip)
{
	avr_cycle_timer_register(chip->avr, CHIP_US(WORLD_STEP_US), world_timer, chip);
	chip->line_in_running = false;
	chip->line_in_wait = false;
	chip->line_in_first = chip->line_in_end;
	chip->log.open.count = 0;
	chip->rise_cycle = 0;
}

/* simavr 1.6 keeps a timer's clock over a reset: written to before it runs again, the timer would
 * overflow at once. */
static void stop_timers(struct chip *chip)
{
	for (avr_io_t *io = chip->avr->io_port; io; io = io->next) {
		if (strcmp(io->kind, "timer") == 0)
			((avr_timer_t *)io)->cs_div_value = 0;
	}
}

/* Inputs keep their levels; simavr has zeroed the registers, and passes on only what changes. */
static void restore_inputs(struct chip *chip)
{
	for (int port = 0; port < 3; port++) {
		for (int bit = 0; bit < 8; bit++) {
			bool high = chip->external_value[port] >> bit & 1;
			if (!(chip->external_mask[port] >> bit & 1))
				continue;
			chip_pin(chip, 'B' + port, bit, !high);
			chip_pin(chip, 'B' + port, bit, high);
		}
	}
}

static struct chip *the_chip; /* libsimavr's reset callback has no context */
static void (*core_reset)(avr_t *avr);
static avr_run_t core_run;

/* After a reset both interrupts are of the low level, until the program asks for edges. simavr
 * would look at a pin that is low then in every cycle until it is high, so that no sleep is passed
 * over at once: nearly all of its work. Both are off while they are of the level. */
static void ask_no_levels(avr_t *avr)
{
	for (uint8_t number = 0; number < 2; number++)
		avr_extint_set_strict_lvl_trig(avr, number, 0);
}

static void on_reset(avr_t *avr)
{
	if (core_reset)
		core_reset(avr);
	ask_no_levels(avr);
	the_chip->resets++;
	the_chip->reset = true;
	the_chip->bandgap = false;
	stop_timers(the_chip);
	start_timers(the_chip);
	restore_inputs(the_chip);
	world_power(&the_chip->world, false); /* pins are inputs: the switch's pull-down */
}

static void no_sleep(avr_t *avr, avr_cycle_count_t cycles)
{
	uint64_t awake_cycles = avr->cycle - the_chip->woken_cycle;

	if (awake_cycles > the_chip->longest_awake_cycles)
		the_chip->longest_awake_cycles = awake_cycles;
	the_chip->woken_cycle = avr->cycle + cycles + 1;
	the_chip->asleep_cycles += cycles + 1;
}

void chip_reset(struct chip *chip, enum chip_reset why)
{
	avr_t *avr = chip->avr;

	if (why == CHIP_POWER_ON) {
		for (unsigned i = avr->ioend + 1; i <= avr->ramend; i++)
			avr->data[i] = rand();
	}
	chip->wdt_bites = false;
	chip->wdt_pending_us = 0;
	avr->run = core_run;
	avr_reset(avr);
	if (avr->data[REGISTER_MCUSR]) { /* simavr's watchdog was about to reset it */
		chip->resets--;
		avr_reset(avr);
	}
	avr->data[REGISTER_MCUSR] |= why == CHIP_POWER_ON    ? BOOT_POWER_ON
				     : why == CHIP_BROWN_OUT ? BOOT_BROWN_OUT
				     : why == CHIP_WATCHDOG  ? BOOT_WATCHDOG
							     : BOOT_EXTERNAL;
}

/* Once simavr has set the reset's cause. */
static void start_boot(struct chip *chip)
{
	const struct world *world = &chip->world;

	chip->reset = false;
	chip->booting = true;
	stk500_start(&chip->programmer);
	chip->boot =
		boot_after((enum boot_loader)world->boot_loader, chip->avr->data[REGISTER_MCUSR]);
	chip->boot_cycle = chip->avr->cycle;
	if (chip->boot.waits)
		chip->boot_cycle += (uint64_t)CHIP_US(world->boot_wait_ms * 1000);
	if (chip->boot.hangs)
		chip->boot_cycle = UINT64_MAX;
}

static void hand_over(struct chip *chip)
{
	chip->avr->data[REGISTER_MCUSR] = chip->boot.mcusr;
	if (chip->boot.r2_set)
		chip->avr->data[R2] = chip->boot.r2;
	else if (chip->world.boot_loader != BOOT_NONE)
		chip->avr->data[R2] = rand(); /* whatever it left there */
	chip->booting = false;
	chip->woken_cycle = chip->avr->cycle;
}

/* Time passes for the box; the boot loader's own program is not run. */
static void boot_until(struct chip *chip, uint64_t cycle)
{
	uint64_t end = cycle < chip->boot_cycle ? cycle : chip->boot_cycle;

	while (chip->avr->cycle < end) {
		chip->avr->cycle += CHIP_US(WORLD_STEP_US);
		chip->asleep_cycles += CHIP_US(WORLD_STEP_US);
		avr_cycle_timer_process(chip->avr);
	}
	if (chip->avr->cycle >= chip->boot_cycle)
		hand_over(chip);
}

void chip_run_until(struct chip *chip, uint64_t cycle)
{
	while (chip->avr->cycle < cycle && !chip->dead) {
		if (chip->reset)
			start_boot(chip);
		if (chip->booting) {
			boot_until(chip, cycle);
			continue;
		}
		int state = avr_run(chip->avr);
		chip->dead = state == cpu_Done || state == cpu_Crashed;
		if (chip->wdt_bites)
			chip_reset(chip, CHIP_WATCHDOG);
	}
}

static void connect_pins(struct chip *chip)
{
	avr_t *avr = chip->avr;
	uint32_t flags = 0;

	chip->uart_in = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
	chip->adc = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, 0);
	avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
	flags &= ~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
	avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);

	avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT),
				on_uart_out, chip);
	avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON),
				on_xon, chip);
	avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF),
				on_xoff, chip);
	/* The timer's own output: writes to port B would show through the pin's. */
	avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_TIMER_GETIRQ('1'),
					      TIMER_IRQ_OUT_COMP + 1),
				on_pulse, chip);
	avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('C'),
					      IOPORT_IRQ_REG_PORT),
				on_port_c, chip);
	avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'),
					      IOPORT_IRQ_REG_PORT),
				on_port_d, chip);
	avr_irq_register_notify(chip->adc + ADC_IRQ_OUT_TRIGGER, on_adc, chip);
	avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_OUTPUT), on_twi,
				chip);
	avr_register_io_write(avr, REGISTER_EECR, on_eeprom_control, chip);
	avr_register_io_write(avr, REGISTER_ADMUX, on_admux, chip);
}

/* simavr says on standard output what it loads: that is where the runner's answers go. */
static void log_errors(avr_t *avr, int level, const char *format, va_list arguments)
{
	(void)avr;
	if (level <= LOG_ERROR)
		vfprintf(stderr, format, arguments);
}

struct chip *chip_create(const char *elf, const char *carrier, uint32_t seed)
{
	elf_firmware_t firmware = {0};
	struct chip *chip = calloc(1, sizeof(*chip));

	avr_global_logger_set(log_errors);
	if (!chip || elf_read_firmware(elf, &firmware)) {
		fprintf(stderr, "runner: %s: cannot be read as ELF; make firmware builds it\n",
			elf);
		free(chip);
		return NULL;
	}
	chip->avr = avr_make_mcu_by_name("atmega328p");
	avr_init(chip->avr);
	firmware.frequency = CHIP_HZ;
	avr_load_firmware(chip->avr, &firmware);
	chip->avr->frequency = CHIP_HZ;
	chip->programmer =
		(struct stk500){.flash = chip->avr->flash, .flash_bytes = chip->avr->flashend + 1};
	chip->avr->sleep = no_sleep;
	chip->avr->log = LOG_ERROR;
	world_init(&chip->world, seed);
	world_step(&chip->world);
	connect_pins(chip);
	chip->can = mcp2515_create(chip);

	the_chip = chip;
	core_reset = chip->avr->reset;
	core_run = chip->avr->run;
	chip->avr->reset = on_reset;
	for (int bit = 0; bit < 2; bit++)
		chip_pin(chip, 'D', INDEX_BIT + bit, !(chip->world.index_levels >> bit & 1));
	chip->strap = strcmp(carrier, "i2c") == 0 ? 0 : strcmp(carrier, "can") == 0 ? 0.25 : 1;
	chip_reset(chip, CHIP_POWER_ON);
	return chip;
}

void chip_destroy(struct chip *chip)
{
	if (!chip)
		return;
	mcp2515_destroy(chip->can);
	avr_terminate(chip->avr);
	free(chip);
}
