/* SPDX-License-Identifier: Apache-2.0 */
/* What the firmware sent on the serial line, frame by frame, with the time and where the wheel
 * truly was. */
#ifndef FRAME_LOG_H
#define FRAME_LOG_H

#include <stdint.h>

struct console;
struct world;

#define FRAME_LOG_BYTES 24
#define FRAME_LOG_FRAMES 8192

struct logged_frame {
	uint64_t t_us;		  /* of its closing zero byte */
	double low_deg, high_deg; /* the wheel in the 2 ms before */
	uint8_t bytes[FRAME_LOG_BYTES];
	uint8_t count;
};

struct frame_log {
	struct logged_frame frames[FRAME_LOG_FRAMES];
	unsigned first, end;
	struct logged_frame open; /* not closed yet */
};

void frame_log_byte(struct frame_log *log, uint8_t byte, uint64_t t_us, const struct world *world);

/* Answers with the number of frames and a line for each, oldest first; forgets them. */
void frame_log_answer(struct frame_log *log, struct console *console);

#endif
