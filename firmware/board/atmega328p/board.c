/* SPDX-License-Identifier: Apache-2.0 */
/* ATmega328P at 16 MHz: start, clock, servo, index sensors, EEPROM, watchdog, stack guard. */
#include "board/board.h"

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "board/atmega328p/pins.h"
#include "board/atmega328p/wake.h"

#define FRAME_US 20000UL /* of the servo; Timer 1 counts half microseconds */
#define FRAME_TOP 39999

/* --- reset and stack ------------------------------------------------------------------------ */

#define STACK_PAINT 0xC5
#define GUARD_BYTES 16
#define KEPT_MAGIC 0x5AFE

extern uint8_t __heap_start; /* first byte after all data: the stack may grow down to here */

/* Survives a reset that keeps the RAM. Volatile: to the compiler nobody reads what is written
 * before the end. */
static volatile struct {
	uint16_t magic;
	uint16_t boot_count;
	uint8_t cause; /* of a reset that the firmware knows of beforehand */
} kept __attribute__((section(".noinit")));
volatile bool supply_was_low __attribute__((section(".noinit")));
static uint8_t reset_flags __attribute__((section(".noinit")));
static uint8_t loader_flags __attribute__((section(".noinit")));

/* Before main and before the data are set up: the watchdog runs on at 16 ms after its own reset. */
__attribute__((naked, used, section(".init3"))) void board_early(void)
{
	uint8_t left_in_r2;
	__asm__ volatile("mov %0, r2" : "=r"(left_in_r2));
	loader_flags = left_in_r2;
	reset_flags = MCUSR;
	MCUSR = 0;
	wdt_disable();
	for (uint8_t *p = &__heap_start; p < (uint8_t *)RAMEND - 8; p++)
		*p = STACK_PAINT;
}

/* The chip's own flags. A watchdog's alone says nothing: boot loaders reset the chip by it too. */
static uint8_t cause_by_flags(void)
{
	if (reset_flags & PIN_BIT(PORF))
		return RESET_CAUSE_POWER_ON;
	if (reset_flags & PIN_BIT(BORF))
		return RESET_CAUSE_BROWN_OUT;
	return reset_flags & PIN_BIT(EXTRF) ? RESET_CAUSE_EXTERNAL : RESET_CAUSE_UNKNOWN;
}

/* A boot loader has cleared the flags. Optiboot since 4.6 leaves them in r2; others leave anything
 * there. So only what is plausible is believed: a brown-out when the supply was low before it. */
static uint8_t cause_by_loader(void)
{
	uint8_t flags = loader_flags & ~PIN_BIT(WDRF);

	if (flags == PIN_BIT(EXTRF))
		return RESET_CAUSE_EXTERNAL;
	if (flags == PIN_BIT(BORF) && supply_was_low)
		return RESET_CAUSE_BROWN_OUT;
	return RESET_CAUSE_UNKNOWN;
}

static uint8_t reset_cause(void)
{
	uint8_t known = kept.cause;

	kept.cause = RESET_CAUSE_UNKNOWN;
	if (kept.magic != KEPT_MAGIC)
		return RESET_CAUSE_POWER_ON;
	if (known != RESET_CAUSE_UNKNOWN)
		return known;
	return reset_flags ? cause_by_flags() : cause_by_loader();
}

bool board_stack_ok(void)
{
	const volatile uint8_t *guard = &__heap_start;

	for (uint8_t i = 0; i < GUARD_BYTES; i++) {
		if (guard[i] != STACK_PAINT)
			return false;
	}
	return true;
}

uint16_t board_stack_free_bytes(void)
{
	const volatile uint8_t *p = &__heap_start;

	while (p < (uint8_t *)RAMEND && *p == STACK_PAINT)
		p++;
	return p - &__heap_start;
}

void board_reset(enum reset_cause cause)
{
	cli();
	PORTC &= ~PIN_BIT(SERVO_POWER);
	TCCR1A = 0;
	kept.cause = cause;
	wdt_enable(WDTO_15MS);
	for (;;)
		continue; /* until the watchdog bites */
}

/*
 * The main loop has not called board_alive() for 125 ms: it hangs. The servo is released, and the
 * cause noted for the time after the reset, which the watchdog makes in another 125 ms.
 */
ISR(WDT_vect)
{
	PORTC &= ~PIN_BIT(SERVO_POWER);
	TCCR1A = 0;
	kept.cause = RESET_CAUSE_WATCHDOG;
	for (;;)
		continue;
}

/* First the interrupt, then the reset. The second write must follow the first within four clocks.
 */
static void start_watchdog(void)
{
	ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
	{
		wdt_reset();
		WDTCSR = PIN_BIT(WDCE) | PIN_BIT(WDE);
		WDTCSR = PIN_BIT(WDIE) | PIN_BIT(WDE) | WDTO_120MS;
	}
}

void board_alive(void)
{
	wdt_reset();
}

/* --- clock and servo: Timer 1, mode 15 ------------------------------------------------------ */

static volatile uint32_t frame_us;   /* start of the current servo frame */
static volatile uint16_t pulse_next; /* 0: none */
static volatile bool pulse_armed;

ISR(TIMER1_OVF_vect)
{
	frame_us += FRAME_US;
	if (pulse_next) {
		OCR1B = pulse_next;
		pulse_armed = true;
	}
}

/* The pulse of this frame is over: the moment to connect or disconnect the pin without a runt
 * pulse. */
ISR(TIMER1_COMPB_vect)
{
	if (pulse_next == 0) {
		TCCR1A &= ~PIN_BIT(COM1B1);
		pulse_armed = false;
	} else if (pulse_armed) {
		TCCR1A |= PIN_BIT(COM1B1);
	}
}

void board_servo(uint16_t half_us)
{
	ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
	{
		pulse_next = half_us ? half_us - 1 : 0;
		if (half_us)
			PORTC |= PIN_BIT(SERVO_POWER);
		else
			PORTC &= ~PIN_BIT(SERVO_POWER);
	}
}

uint32_t board_time_us(void)
{
	uint32_t us;
	uint16_t count;

	ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
	{
		count = TCNT1;
		us = frame_us;
		/* An overflow whose interrupt has not run yet. */
		if (TIFR1 & PIN_BIT(TOV1) && count < FRAME_TOP / 2)
			us += FRAME_US;
	}
	return us + count / 2;
}

/* --- the comb's sensors: both edges of INT0 and INT1 ---------------------------------------- */

static volatile struct board_index seen;
static uint8_t seen_quarter;

/* The sensors go 00, 01, 11, 10 upwards: as a number, 0 to 3. */
static uint8_t quarter_of(uint8_t levels)
{
	return levels ^ levels >> 1;
}

static uint8_t sensor_levels(void)
{
	return (uint8_t)~PIND >> INDEX_SHIFT & 3;
}

ISR(INT0_vect)
{
	uint8_t levels = sensor_levels();
	uint8_t quarter = quarter_of(levels);
	uint8_t step = (quarter - seen_quarter) & 3;

	seen_quarter = quarter;
	seen.levels = levels;
	seen.changes++;
	if (step == 1)
		seen.count++;
	else if (step == 3)
		seen.count--;
	else if (step == 2)
		seen.errors++;
}
ISR_ALIAS(INT1_vect, INT0_vect);

void board_index(struct board_index *index)
{
	ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
	{
		*index = *(struct board_index *)&seen;
	}
}

/* --- EEPROM --------------------------------------------------------------------------------- */

uint8_t board_eeprom_read(uint16_t address)
{
	return eeprom_read_byte((const uint8_t *)address);
}

bool board_eeprom_ready(void)
{
	return eeprom_is_ready();
}

void board_eeprom_write(uint16_t address, uint8_t value)
{
	eeprom_write_byte((uint8_t *)address, value);
}

/* --- the rest ------------------------------------------------------------------------------- */

volatile bool wake;

void board_lock(void)
{
	cli();
}

void board_unlock(void)
{
	sei();
}

void board_idle(void)
{
	for (;;) {
		cli();
		if (wake)
			break;
		sleep_enable();
		sei();
		sleep_cpu();
		sleep_disable();
	}
	wake = false;
	sei();
}

void board_init(struct board_info *info)
{
	DDRB = PIN_BIT(CAN_SELECT) | PIN_BIT(SERVO_PULSE);
	PORTB = PIN_BIT(CAN_INTERRUPT) | PIN_BIT(CAN_SELECT);
	DDRC = PIN_BIT(SERVO_POWER);
	PORTC = PIN_BIT(STRAP_ADC);
	DDRD = 0x0F << MUX_SHIFT;
	PORTD = 3 << INDEX_SHIFT;

	info->kind = BOARD_ATMEGA328P;
	info->reset_cause = reset_cause();
	if (info->reset_cause == RESET_CAUSE_POWER_ON) {
		kept.magic = KEPT_MAGIC;
		kept.boot_count = 0;
		supply_was_low = false;
	}
	info->boot_count = ++kept.boot_count;

	/* OCR1A is the top: mode 14 with ICR1 would do on the chip, but this one every simulator
	 * knows. */
	OCR1A = FRAME_TOP;
	OCR1B = FRAME_TOP / 2;
	TCCR1A = PIN_BIT(WGM11) | PIN_BIT(WGM10);
	TCCR1B = PIN_BIT(WGM13) | PIN_BIT(WGM12) | PIN_BIT(CS11);
	TIMSK1 = PIN_BIT(TOIE1) | PIN_BIT(OCIE1B);

	seen.levels = sensor_levels();
	seen_quarter = quarter_of(seen.levels);
	EICRA = PIN_BIT(ISC00) | PIN_BIT(ISC10); /* any edge */
	EIFR = PIN_BIT(INTF0) | PIN_BIT(INTF1);
	EIMSK = PIN_BIT(INT0) | PIN_BIT(INT1);

	info->carrier = board_strap();
	board_uart_start(info->carrier == CARRIER_SERIAL);

	set_sleep_mode(SLEEP_MODE_IDLE);
	start_watchdog();
	sei();
}
