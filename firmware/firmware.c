/* SPDX-License-Identifier: Apache-2.0 */
/* What every board's main() does: start once, then poll for ever. Nothing in it waits. */
#include "firmware.h"

#include "messages.h"

#define TICK_US 1000
#define MESSAGES_PER_POLL 2 /* bounded, so that a talkative host cannot starve the wheel */

void firmware_start(struct firmware *firmware)
{
	board_init(&firmware->info);
	safe_init(&firmware->safe, firmware->info.reset_cause);
	enum params_load loaded = params_load(&firmware->params);
	if (loaded == PARAMS_CORRUPT)
		safe_latch(&firmware->safe, FAULT_PARAMS_LOST, 0);
	if (loaded == PARAMS_ONE_COPY)
		safe_latch(&firmware->safe, FAULT_PARAMS_COPY_LOST, firmware->params.generation);
	wheel_init(&firmware->wheel, &firmware->params, &firmware->safe);
	ring_init(&firmware->ring, &firmware->params, &firmware->safe);
	link_init(&firmware->link, &firmware->params, &firmware->safe, firmware->info.carrier);
	firmware->hello_due_ms = 1;
	firmware->tick_us = board_time_us();
}

static void tick(struct firmware *firmware)
{
	firmware->now_ms++;
	params_poll(&firmware->params);
	link_tick(&firmware->link);
	messages_tick(firmware);
}

void firmware_poll(struct firmware *firmware)
{
	struct link_message received;
	struct ring_report report;
	uint16_t level;

	for (uint8_t i = 0; i < MESSAGES_PER_POLL && link_receive(&firmware->link, &received); i++)
		messages_handle(firmware, &received);
	if (ring_feedback(&firmware->ring, &level))
		wheel_feedback(&firmware->wheel, level);
	uint8_t elapsed_ms = 0;
	while (board_time_us() - firmware->tick_us >= TICK_US) {
		firmware->tick_us += TICK_US;
		elapsed_ms++;
		tick(firmware);
	}
	/* Once, however many milliseconds: the wheel's evidence is not older or newer by counting.
	 */
	if (elapsed_ms) {
		wheel_tick(&firmware->wheel, elapsed_ms);
		safe_check_stack();
		board_alive();
	}
	if (ring_poll(&firmware->ring, &report))
		messages_ring(firmware, &report);
	messages_poll(firmware);
	link_poll(&firmware->link);
}
