/* SPDX-License-Identifier: Apache-2.0 */
#include "link.h"

#include <stddef.h>

#include "board/board.h"
#include "params.h"

void link_init(struct link *link, const struct params *params, struct safe *safe, uint8_t carrier)
{
	link->params = params;
	link->safe = safe;
	link->carrier = carrier;
	if (carrier == CARRIER_I2C)
		board_i2c_start(param(params, PARAM_I2C_ADDRESS));
	if (carrier == CARRIER_CAN)
		link_can_init(link);
}

uint8_t link_room(const struct link *link)
{
	return LINK_QUEUE - link->count;
}

struct message *link_send(struct link *link, uint8_t id, uint8_t length_bytes)
{
	if (link->count == LINK_QUEUE) {
		link->tx_dropped++;
		return NULL;
	}
	struct message *message = &link->queue[(link->first + link->count++) % LINK_QUEUE];
	message->id = id;
	message->length_bytes = length_bytes;
	return message;
}

const struct message *link_next(const struct link *link)
{
	return link->count ? &link->queue[link->first] : NULL;
}

void link_done(struct link *link)
{
	link->first = (link->first + 1) % LINK_QUEUE;
	link->count--;
}

bool link_receive(struct link *link, struct link_message *received)
{
	if (link->carrier == CARRIER_SERIAL)
		return link_serial_receive(link, received);
	if (link->carrier == CARRIER_I2C)
		return link_i2c_receive(link, received);
	return link_can_receive(link, received);
}

void link_poll(struct link *link)
{
	if (link->carrier == CARRIER_SERIAL)
		link_serial_poll(link);
	else if (link->carrier == CARRIER_I2C)
		link_i2c_poll(link);
	else
		link_can_poll(link);
}

void link_tick(struct link *link)
{
	if (link->carrier == CARRIER_I2C)
		link_i2c_tick(link);
	if (link->carrier == CARRIER_CAN)
		link_can_tick(link);
}
