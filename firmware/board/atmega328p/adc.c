/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ADC paced by Timer 0: every slot is sampled at equal distance, within an interrupt's latency. Its
 * clock is 250 kHz, so that a conversion (52 us) has ended by the next slot even if that interrupt
 * or this one comes late; at the data sheet's 200 kHz a late start could be read as its
 * neighbour's. The difference in accuracy is far below an LDR's.
 *
 * The chip's reference, which the supply is measured by, takes a while to arrive after the ADC was
 * switched to it (data sheet, ADC Voltage Reference). Its first conversion is thrown away, and a
 * second one follows at once in the same slot.
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "board/atmega328p/pins.h"
#include "board/board.h"
#include "board/atmega328p/wake.h"

#define ADC_ON (PIN_BIT(ADEN) | PIN_BIT(ADPS2) | PIN_BIT(ADPS1))
#define MUX_BANDGAP 0x0E
#define BANDGAP_AT_LOW 288 /* of 1.1 V, at a supply of 3.9 V */
#define WAKE_EVERY 8	   /* slots: about a millisecond */

static uint8_t slot; /* whose conversion runs */
static bool supply_turn;

/* Connects the ADC to what a slot measures. */
static void connect(uint8_t next)
{
	if (next < BOARD_LDRS) {
		PORTD = (PORTD & 0x0F) | (uint8_t)(next << MUX_SHIFT);
		ADMUX = PIN_BIT(REFS0) | RING_ADC;
	} else {
		ADMUX = PIN_BIT(REFS0) | (next == BOARD_SLOT_SUPPLY ? MUX_BANDGAP : FEEDBACK_ADC);
	}
}

/* The reference's first conversion has ended. */
ISR(ADC_vect)
{
	ADCSRA = ADC_ON | PIN_BIT(ADSC);
}

/* The former conversion has ended; the next is started in the same breath. */
ISR(TIMER0_COMPA_vect)
{
	static uint8_t slots;

	/* Only the reference's second one can still run, when other interrupts were long. */
	while (ADCSRA & PIN_BIT(ADSC))
		continue;
	uint16_t level = ADC;
	uint8_t finished = slot;

	if (slot < BOARD_LDRS - 1) {
		slot++;
	} else if (slot == BOARD_LDRS - 1) {
		slot = supply_turn ? BOARD_SLOT_SUPPLY : BOARD_SLOT_FEEDBACK;
		supply_turn = !supply_turn;
	} else {
		slot = 0;
	}
	connect(slot);
	if (slot == BOARD_SLOT_SUPPLY)
		ADCSRA = ADC_ON | PIN_BIT(ADSC) | PIN_BIT(ADIF) | PIN_BIT(ADIE);
	else
		ADCSRA = ADC_ON | PIN_BIT(ADSC);
	if (finished == BOARD_SLOT_SUPPLY)
		supply_was_low = level > BANDGAP_AT_LOW;
	board_on_conversion(finished, level);
	if (++slots % WAKE_EVERY == 0)
		wake = true;
}

/* Against the chip's pull-up (20 to 50 kohm): open reads full scale, 10 kohm a fifth to a third,
 * ground nothing. */
enum carrier board_strap(void)
{
	ADMUX = PIN_BIT(REFS0) | STRAP_ADC;
	ADCSRA = ADC_ON | PIN_BIT(ADSC);
	while (ADCSRA & PIN_BIT(ADSC))
		continue;
	uint16_t level = ADC;
	return level > 600 ? CARRIER_SERIAL : level > 60 ? CARRIER_CAN : CARRIER_I2C;
}

void board_sample(uint8_t period_us)
{
	ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
	{
		TIMSK0 = 0;
		slot = 0;
		connect(slot);
		/* Off for a moment: a conversion under way would be taken for slot 0's. The first
		 * one after it takes 100 us, less than a slot. */
		ADCSRA = 0;
		ADCSRA = ADC_ON;
		ADCSRA |= PIN_BIT(ADSC);
		TCCR0A = PIN_BIT(WGM01);
		TCCR0B = PIN_BIT(CS01); /* half microseconds */
		OCR0A = 2 * period_us - 1;
		TCNT0 = 0;
		TIFR0 = PIN_BIT(OCF0A);
		TIMSK0 = PIN_BIT(OCIE0A);
	}
}
