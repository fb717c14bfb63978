/* SPDX-License-Identifier: Apache-2.0 */
/* Pin map of the ATmega328P board (Arduino Nano names in brackets); firmware/README.md has it as a
 * table. */
#ifndef PINS_H
#define PINS_H

#include <avr/io.h>

#define PIN_BIT(bit) ((uint8_t)(1 << (bit)))

/* Port B */
#define CAN_INTERRUPT PB0 /* [D8] MCP2515 INT, low: frames wait */
#define CAN_SELECT PB1	  /* [D9]  MCP2515 CS */
#define SERVO_PULSE PB2	  /* [D10] OC1B; also SS, so it must stay an output for SPI */
#define SPI_MOSI PB3	  /* [D11] */
#define SPI_MISO PB4	  /* [D12] */
#define SPI_SCK PB5	  /* [D13] */
/* Port C */
#define RING_ADC 0	/* [A0] common pin of the 74HC4067 */
#define FEEDBACK_ADC 1	/* [A1] voltage of the wheel's angle */
#define SERVO_POWER PC2 /* [A2] high: servo supplied (pull-down on the switch) */
#define STRAP_ADC 3	/* [A3] open: serial; 10 kohm to ground: CAN; ground: I2C */
/*      SDA PC4, SCL PC5    [A4, A5] */
/* Port D */
/*      RXD PD0, TXD PD1    [D0, D1] */
#define INDEX_SHIFT 2 /* [D2, D3] INT0, INT1: the comb's sensors A and B, low on a tooth */
#define MUX_SHIFT 4   /* [D4 to D7] S0 to S3 of the 74HC4067 */

#endif
