/* SPDX-License-Identifier: Apache-2.0 */
/* How a simulated box takes commands: as lines on stdin or a Unix socket. */
#ifndef CONSOLE_H
#define CONSOLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CONSOLE_LINE_BYTES 140000

struct console {
	int listener; /* -1: stdin and stdout */
	int client;
	bool closed; /* stdin has ended */
	char line[CONSOLE_LINE_BYTES];
	size_t line_bytes;
	char *answer;
	size_t answer_size, answer_bytes;
};

/* `path` NULL: stdin and stdout. Exits with a message when the socket cannot be made. */
void console_open(struct console *console, const char *path);
void console_close(struct console *console);

/* Waits for input up to `timeout_ms` (-1: for ever) and carries out the whole lines that came.
 * `execute` builds its answer with the functions below; it is sent when it returns. */
void console_serve(struct console *console, int timeout_ms,
		   void (*execute)(void *context, const char *line), void *context);

__attribute__((format(printf, 2, 3))) void console_answer(struct console *console,
							  const char *format, ...);
void console_answer_hex(struct console *console, const uint8_t *bytes, size_t count);

/* Hexadecimal digits to bytes; -1 when they are none or too many. */
int console_unhex(const char *text, uint8_t *bytes, int room);

/* A listening Unix socket; exits with a message when it cannot be made. */
int listen_on(const char *path);

#endif
