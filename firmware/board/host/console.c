/* SPDX-License-Identifier: Apache-2.0 */
#include "board/host/console.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

static void fail(const char *what)
{
	fprintf(stderr, "simulated box: %s: %s\n", what, strerror(errno));
	exit(1);
}

/* The path appears when somebody listens there, not before. */
int listen_on(const char *path)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	const int room = sizeof(address.sun_path);
	int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

	if (snprintf(address.sun_path, room, "%s.new", path) >= room) {
		errno = ENAMETOOLONG;
		fail(path);
	}
	unlink(address.sun_path);
	if (fd < 0 || bind(fd, (struct sockaddr *)&address, sizeof(address)) || listen(fd, 1) ||
	    rename(address.sun_path, path))
		fail(path);
	return fd;
}

void console_open(struct console *console, const char *path)
{
	console->client = -1;
	console->listener = path ? listen_on(path) : -1;
}

void console_close(struct console *console)
{
	if (console->client >= 0)
		close(console->client);
	if (console->listener >= 0)
		close(console->listener);
	free(console->answer);
}

static void make_room(struct console *console, size_t bytes)
{
	size_t needed = console->answer_bytes + bytes + 1;

	if (needed <= console->answer_size)
		return;
	console->answer_size = 2 * needed;
	console->answer = realloc(console->answer, console->answer_size);
	if (!console->answer)
		fail("answer");
}

void console_answer(struct console *console, const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	int bytes = vsnprintf(NULL, 0, format, arguments);
	va_end(arguments);
	make_room(console, bytes);
	va_start(arguments, format);
	console->answer_bytes +=
		vsnprintf(console->answer + console->answer_bytes, bytes + 1, format, arguments);
	va_end(arguments);
}

void console_answer_hex(struct console *console, const uint8_t *bytes, size_t count)
{
	for (size_t i = 0; i < count; i++)
		console_answer(console, "%02x", bytes[i]);
}

int console_unhex(const char *text, uint8_t *bytes, int room)
{
	int count = 0;
	unsigned byte;

	while (*text == ' ')
		text++;
	while (count < room && text[0] && text[1] && sscanf(text, "%2x", &byte) == 1) {
		bytes[count++] = byte;
		text += 2;
	}
	return *text ? -1 : count;
}

static void send_answer(struct console *console)
{
	int fd = console->listener >= 0 ? console->client : STDOUT_FILENO;

	console_answer(console, "\n");
	for (size_t done = 0; done < console->answer_bytes;) {
		ssize_t written = write(fd, console->answer + done, console->answer_bytes - done);
		if (written < 0 && errno == EINTR)
			continue;
		if (written <= 0)
			break;
		done += written;
	}
	console->answer_bytes = 0;
}

static void hang_up(struct console *console)
{
	console->line_bytes = 0;
	if (console->listener < 0) {
		console->closed = true;
		return;
	}
	close(console->client);
	console->client = -1;
}

void console_serve(struct console *console, int timeout_ms,
		   void (*execute)(void *context, const char *line), void *context)
{
	int fd = console->client;

	if (fd < 0)
		fd = console->listener < 0 ? STDIN_FILENO : console->listener;
	struct pollfd ready = {.fd = fd, .events = POLLIN};
	if (poll(&ready, 1, timeout_ms) <= 0)
		return;
	if (fd == console->listener) {
		console->client = accept4(fd, NULL, NULL, SOCK_CLOEXEC);
		return;
	}
	size_t room = sizeof(console->line) - 1 - console->line_bytes;
	ssize_t got = read(fd, console->line + console->line_bytes, room);
	if (got <= 0) {
		hang_up(console);
		return;
	}
	console->line_bytes += got;
	console->line[console->line_bytes] = '\0';
	char *start = console->line, *end;
	while ((end = strchr(start, '\n'))) {
		*end = '\0';
		execute(context, start);
		send_answer(console);
		start = end + 1;
	}
	console->line_bytes -= start - console->line;
	memmove(console->line, start, console->line_bytes);
	if (console->line_bytes == sizeof(console->line) - 1)
		console->line_bytes = 0; /* no line is that long */
}
