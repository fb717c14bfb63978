/* SPDX-License-Identifier: Apache-2.0 */
/* UART, I2C slave and SPI. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>
#include <util/twi.h>

#include "board/atmega328p/pins.h"
#include "board/atmega328p/wake.h"
#include "board/board.h"

/* --- serial --------------------------------------------------------------------------------- */

#define BAUD 500000UL /* exact at 16 MHz */
#define RX_BYTES 128  /* powers of two */
#define TX_BYTES 64

static volatile uint8_t rx[RX_BYTES], rx_first, rx_count, rx_overruns;
static volatile uint8_t tx[TX_BYTES], tx_first, tx_count;
static volatile uint32_t zero_us; /* when the newest zero byte came */
static volatile uint8_t zeros;	  /* that get() has not returned */

ISR(USART_RX_vect)
{
	uint8_t status = UCSR0A;
	uint8_t byte = UDR0;

	if (status & PIN_BIT(DOR0) || rx_count == RX_BYTES) {
		rx_overruns++;
		if (rx_count == RX_BYTES)
			return;
	}
	rx[(uint8_t)(rx_first + rx_count) % RX_BYTES] = byte;
	rx_count++;
	if (byte == 0) {
		zero_us = board_time_us();
		zeros++;
		wake = true;
	}
	if (rx_count == RX_BYTES / 2)
		wake = true;
}

ISR(USART_UDRE_vect)
{
	if (tx_count == 0) {
		UCSR0B &= ~PIN_BIT(UDRIE0);
		return;
	}
	UDR0 = tx[tx_first];
	tx_first = (tx_first + 1) % TX_BYTES;
	tx_count--;
	if (tx_count == TX_BYTES / 2)
		wake = true;
}

void board_uart_start(bool on)
{
	if (!on)
		return;
	UCSR0A = PIN_BIT(U2X0);
	UBRR0 = F_CPU / 8 / BAUD - 1;
	UCSR0C = PIN_BIT(UCSZ01) | PIN_BIT(UCSZ00);
	UCSR0B = PIN_BIT(RXEN0) | PIN_BIT(TXEN0) | PIN_BIT(RXCIE0);
}

int16_t board_uart_get(void)
{
	int16_t byte = -1;

	ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
	{
		if (rx_count) {
			byte = rx[rx_first];
			rx_first = (rx_first + 1) % RX_BYTES;
			rx_count--;
			if (byte == 0)
				zeros--;
		}
	}
	return byte;
}

bool board_uart_put(const uint8_t *bytes, uint8_t count)
{
	uint8_t end;

	if (count > TX_BYTES - tx_count)
		return false;
	ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
	{
		end = tx_first + tx_count;
	}
	/* The interrupt only takes from the other end. */
	for (uint8_t i = 0; i < count; i++)
		tx[(uint8_t)(end + i) % TX_BYTES] = bytes[i];
	ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
	{
		tx_count += count;
		UCSR0B |= PIN_BIT(UDRIE0);
	}
	return true;
}

bool board_uart_stamp(uint32_t *t_us)
{
	bool newest;

	ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
	{
		*t_us = zero_us;
		newest = zeros == 0;
	}
	return newest;
}

uint8_t board_uart_overruns(void)
{
	return rx_overruns;
}

/* --- I2C slave ------------------------------------------------------------------------------ */

static volatile struct {
	uint8_t in[BOARD_MAIL_BYTES], in_count;
	bool receiving; /* into `in` */
	bool in_whole;	/* a transaction waits there to be read */
	uint32_t in_us;
	uint8_t out[BOARD_MAIL_BYTES], out_count;
	bool offered, serving;
	uint8_t errors;
} mail;

#define TWI_ON (PIN_BIT(TWEN) | PIN_BIT(TWIE) | PIN_BIT(TWINT))

/* Next byte for the master; nothing offered: a length of zero, filled up. */
static uint8_t byte_out(void)
{
	uint8_t at = mail.out_count++;

	if (at >= BOARD_MAIL_BYTES)
		return 0xFF;
	if (!mail.serving)
		return at == 0 ? 0 : 0xFF;
	return mail.out[at];
}

ISR(TWI_vect)
{
	uint8_t acknowledge = PIN_BIT(TWEA);

	switch (TW_STATUS) {
	case TW_SR_SLA_ACK:
		/* A mail that has not been read yet stays; this one is refused. */
		mail.receiving = !mail.in_whole;
		if (mail.receiving)
			mail.in_count = 0;
		else
			acknowledge = 0;
		break;
	case TW_SR_DATA_ACK:
		mail.in[mail.in_count++] = TWDR;
		if (mail.in_count == BOARD_MAIL_BYTES)
			acknowledge = 0;
		break;
	case TW_SR_DATA_NACK: /* more than a mail: its end */
	case TW_SR_STOP:
		if (mail.receiving && mail.in_count) {
			mail.in_whole = true;
			mail.in_us = board_time_us();
			wake = true;
		}
		mail.receiving = false;
		break;
	case TW_ST_SLA_ACK:
		mail.out_count = 0;
		mail.serving = mail.offered;
		TWDR = byte_out();
		break;
	case TW_ST_DATA_ACK:
		TWDR = byte_out();
		break;
	case TW_ST_DATA_NACK:
	case TW_ST_LAST_DATA:
		if (mail.serving && mail.out_count >= BOARD_MAIL_BYTES) {
			mail.offered = false;
			wake = true;
		}
		mail.serving = false;
		break;
	default: /* bus error: let go of the lines */
		mail.errors++;
		TWCR = TWI_ON | PIN_BIT(TWEA) | PIN_BIT(TWSTO);
		return;
	}
	TWCR = TWI_ON | acknowledge;
}

void board_i2c_start(uint8_t address)
{
	TWAR = address << 1;
	TWCR = TWI_ON | PIN_BIT(TWEA);
}

bool board_i2c_receive(uint8_t *bytes, uint8_t *count, uint32_t *t_us)
{
	if (!mail.in_whole)
		return false;
	*count = mail.in_count;
	*t_us = mail.in_us;
	for (uint8_t i = 0; i < *count; i++)
		bytes[i] = mail.in[i];
	mail.in_whole = false;
	return true;
}

bool board_i2c_offer(const uint8_t *bytes)
{
	if (mail.offered)
		return false;
	for (uint8_t i = 0; i < BOARD_MAIL_BYTES; i++)
		mail.out[i] = bytes[i];
	mail.offered = true;
	return true;
}

uint8_t board_i2c_bus_errors(void)
{
	return mail.errors;
}

/* --- SPI and the CAN controller's interrupt ------------------------------------------------- */

static volatile uint32_t can_us;
static volatile bool can_fresh;

ISR(PCINT0_vect)
{
	if (PINB & PIN_BIT(CAN_INTERRUPT))
		return;
	can_us = board_time_us();
	can_fresh = true;
	wake = true;
}

void board_spi_start(void)
{
	DDRB |= PIN_BIT(SPI_MOSI) | PIN_BIT(SPI_SCK);
	SPCR = PIN_BIT(SPE) | PIN_BIT(MSTR); /* 8 MHz with SPI2X; the MCP2515 takes 10 */
	SPSR = PIN_BIT(SPI2X);
	PCMSK0 = PIN_BIT(CAN_INTERRUPT);
	PCICR = PIN_BIT(PCIE0);
}

void board_spi_select(bool selected)
{
	if (selected)
		PORTB &= ~PIN_BIT(CAN_SELECT);
	else
		PORTB |= PIN_BIT(CAN_SELECT);
}

uint8_t board_spi_exchange(uint8_t byte)
{
	SPDR = byte;
	while (!(SPSR & PIN_BIT(SPIF)))
		continue;
	return SPDR;
}

bool board_can_waiting(uint32_t *t_us, bool *fresh)
{
	if (PINB & PIN_BIT(CAN_INTERRUPT))
		return false;
	ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
	{
		*t_us = can_us;
		*fresh = can_fresh;
		can_fresh = false;
	}
	return true;
}
