/* SPDX-License-Identifier: Apache-2.0 */
#include "board/host/line.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <termios.h>
#include <unistd.h>

static void fail(const char *what)
{
	fprintf(stderr, "simulated box: %s: %s\n", what, strerror(errno));
	exit(1);
}

/*
 * Each open and close is told twice, once of the folder and once of the file: inotify merges an
 * event with the one before it when both are the same, and two programs that close the line would
 * count as one.
 */
static void watch(struct line *line, const char *name)
{
	char folder[64];

	snprintf(folder, sizeof(folder), "%.*s", (int)(strrchr(name, '/') - name), name);
	line->watch = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
	if (line->watch < 0)
		fail("inotify");
	line->watched = inotify_add_watch(line->watch, name, IN_OPEN | IN_CLOSE);
	if (line->watched < 0 || inotify_add_watch(line->watch, folder, IN_OPEN | IN_CLOSE) < 0)
		fail(name);
}

static void plug_in(struct line *line)
{
	struct termios settings;
	char name[64];

	if (openpty(&line->master, &line->slave, name, NULL, NULL) ||
	    tcgetattr(line->slave, &settings))
		fail("openpty");
	cfmakeraw(&settings);
	settings.c_cflag |= HUPCL; /* as on every new serial line */
	if (tcsetattr(line->slave, TCSANOW, &settings) || fcntl(line->master, F_SETFL, O_NONBLOCK))
		fail(name);
	watch(line, name);
	line->opened = 0;
	line->dtr = false;
	unlink(line->path);
	if (symlink(name, line->path))
		fail(line->path);
}

void line_plug(struct line *line, bool plugged)
{
	if (!line->path || plugged == (line->master >= 0))
		return;
	if (plugged) {
		plug_in(line);
		return;
	}
	unlink(line->path);
	close(line->watch);
	close(line->slave);
	close(line->master);
	line->master = line->slave = line->watch = -1;
	line->waiting = 0;
}

void line_send(struct line *line, const uint8_t *bytes, size_t count)
{
	if (line->master < 0)
		return;
	if (!line->held) {
		(void)!write(line->master, bytes, count);
		return;
	}
	if (count > sizeof(line->bytes) - line->waiting)
		count = sizeof(line->bytes) - line->waiting;
	memcpy(line->bytes + line->waiting, bytes, count);
	line->waiting += count;
}

/* The kernel carries bytes to the other side in a thread of its own, after write() has returned.
 * poll() waits for that thread, so that who reads there has them, however busy the machine is. */
static void wait_until_there(const struct line *line)
{
	struct pollfd other_side = {.fd = line->slave, .events = POLLIN};

	(void)poll(&other_side, 1, 0);
}

void line_flush(struct line *line)
{
	if (line->master >= 0 && line->waiting > 0) {
		(void)!write(line->master, line->bytes, line->waiting);
		wait_until_there(line);
	}
	line->waiting = 0;
}

static bool hangs_up_on_close(const struct line *line)
{
	struct termios settings;

	return tcgetattr(line->slave, &settings) < 0 || settings.c_cflag & HUPCL;
}

/* One open or close; true when DTR rises. */
static bool take_event(struct line *line, const struct inotify_event *event)
{
	if (event->mask & IN_CLOSE) {
		if (--line->opened == 0 && hangs_up_on_close(line))
			line->dtr = false;
		return false;
	}
	line->opened++;
	bool rose = !line->dtr;
	line->dtr = true;
	return rose;
}

bool line_dtr_rose(struct line *line)
{
	_Alignas(struct inotify_event) char events[4096];
	bool rose = false;
	ssize_t got;

	while (line->watch >= 0 && (got = read(line->watch, events, sizeof(events))) > 0) {
		for (char *at = events; at < events + got;) {
			const struct inotify_event *event = (const void *)at;
			if (event->wd == line->watched)
				rose |= take_event(line, event);
			at += sizeof(*event) + event->len;
		}
	}
	return rose;
}
