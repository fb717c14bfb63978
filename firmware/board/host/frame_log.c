/* SPDX-License-Identifier: Apache-2.0 */
#include "board/host/frame_log.h"

#include "board/host/console.h"
#include "board/host/world.h"

void frame_log_byte(struct frame_log *log, uint8_t byte, uint64_t t_us, const struct world *world)
{
	struct logged_frame *open = &log->open;

	if (open->count < FRAME_LOG_BYTES)
		open->bytes[open->count++] = byte;
	if (byte != 0)
		return;
	open->t_us = t_us;
	world_recent(world, &open->low_deg, &open->high_deg);
	log->frames[log->end++ % FRAME_LOG_FRAMES] = *open;
	if (log->end - log->first > FRAME_LOG_FRAMES)
		log->first = log->end - FRAME_LOG_FRAMES;
	open->count = 0;
}

void frame_log_answer(struct frame_log *log, struct console *console)
{
	console_answer(console, "%u", log->end - log->first);
	while (log->first != log->end) {
		const struct logged_frame *frame = &log->frames[log->first++ % FRAME_LOG_FRAMES];
		console_answer(console, "\n%llu %.4f %.4f ", (unsigned long long)frame->t_us,
			       frame->low_deg, frame->high_deg);
		console_answer_hex(console, frame->bytes, frame->count);
	}
}
