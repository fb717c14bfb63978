/* SPDX-License-Identifier: Apache-2.0 */
/* The mailbox on I2C. */
#include "link.h"

#include "board/board.h"
#include "safe.h"

bool link_i2c_receive(struct link *link, struct link_message *received)
{
	uint8_t mail[BOARD_MAIL_BYTES];
	uint8_t count;

	if (!board_i2c_receive(mail, &count, &received->t_rx_us))
		return false;
	received->stamped = true;
	if (count == mail[0] + 1 && envelope_unpack(mail + 1, mail[0], &received->message))
		return true;
	link->rx_bad++;
	return false;
}

void link_i2c_poll(struct link *link)
{
	uint8_t mail[BOARD_MAIL_BYTES];
	const struct message *next = link_next(link);

	if (!next)
		return;
	mail[0] = envelope_pack(next, mail + 1);
	for (uint8_t i = mail[0] + 1; i < BOARD_MAIL_BYTES; i++)
		mail[i] = 0xFF;
	if (board_i2c_offer(mail))
		link_done(link);
}

void link_i2c_tick(struct link *link)
{
	uint8_t errors = board_i2c_bus_errors();

	if (errors != link->i2c_errors)
		safe_latch(link->safe, FAULT_I2C_BUS, errors);
	link->i2c_errors = errors;
}
