/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The serial line: a pty, and a symbolic link to its slave side. The slave side stays open here, so
 * that a client may close and open it again without EIO at our side.
 *
 * A pty has no control lines. DTR is modelled as Linux drives it on a USB converter: it rises when
 * the first program opens the line, and falls when the last one closes it, unless that one has
 * cleared HUPCL.
 */
#ifndef LINE_H
#define LINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct line {
	const char *path; /* of the link; NULL: there is no line */
	int master, slave;
	int watch;   /* inotify on the slave side: who opens and closes it */
	int watched; /* its events that count: those of the file itself */
	int opened;
	bool dtr;
	bool held; /* what the microcontroller sends waits for line_flush() */
	size_t waiting;
	uint8_t bytes[8192];
};
#define LINE_CLOSED                                    \
	{                                              \
		.master = -1, .slave = -1, .watch = -1 \
	}

/* Makes pty and link, or takes them away, as a plug does; nothing when they are so already. Exits
 * with a message when they cannot be made. */
void line_plug(struct line *line, bool plugged);

/* Bytes from the microcontroller. Where nobody reads and the pty is full they are lost, as on a
 * line with no one at its end. */
void line_send(struct line *line, const uint8_t *bytes, size_t count);

/* In lock-step: the reader's time has come to where the microcontroller's is. */
void line_flush(struct line *line);

/* Whether DTR has risen since the last call: what resets an Arduino Nano. */
bool line_dtr_rose(struct line *line);

#endif
