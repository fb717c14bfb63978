/* SPDX-License-Identifier: Apache-2.0 */
#include "commands.h"
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

const char commands_help[] =
	"  plug [CONTROLLER]     connect to the bus, at dummy_udc.N\n"
	"  unplug                disconnect\n"
	"  empty N, error N, truncated N, garbage N, wrong-size N, overlong N\n"
	"                        spoil the next N frames\n"
	"  silent 0|1            no frames\n"
	"  halt 1                halt the endpoint once; the host must clear it\n"
	"  hang 1                no frames, all requests refused, until the port is reset\n"
	"  mute 0|1              requests are not answered\n"
	"  other-size 0|1        whatever size the host asks for, the smallest is agreed\n"
	"  ignore-exposure 0|1   exposure and gain do nothing\n"
	"  delay N               frames from a control's change to its effect (0..4)\n"
	"  state                 counts and values\n"
	"  quit                  end the program\n";

enum { LINE_BYTES = 256, REPLY_BYTES = 512 };

static const char *const fault_names[FAULT_COUNT] = {
	[FAULT_EMPTY] = "empty",
	[FAULT_ERROR_BIT] = "error",
	[FAULT_TRUNCATED] = "truncated",
	[FAULT_GARBAGE] = "garbage",
	[FAULT_WRONG_SIZE] = "wrong-size",
	[FAULT_OVERLONG] = "overlong",
	[FAULT_SILENT] = "silent",
	[FAULT_HALT] = "halt",
	[FAULT_HANG] = "hang",
	[FAULT_MUTE] = "mute",
	[FAULT_OTHER_SIZE] = "other-size",
	[FAULT_IGNORE_EXPOSURE] = "ignore-exposure",
};

static void report_state(struct camera *camera, char *reply)
{
	static const char *const names[] = {"ae_mode",	     "exposure",	   "gain",
					    "white_balance", "white_balance_auto", "power_line",
					    "sharpness",     "backlight"};
	const struct streaming_counts *counts = camera_counts(camera);
	int n = snprintf(reply, REPLY_BYTES, "ok sent=%u overrun=%u spoiled=%u broken=%u",
			 atomic_load(&counts->sent), atomic_load(&counts->overrun),
			 atomic_load(&counts->spoiled), atomic_load(&counts->broken));

	for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++)
		n += snprintf(reply + n, REPLY_BYTES - (size_t)n, " %s=%d", names[i],
			      controls_value(camera_controls(camera), names[i]));
}

static void report_result(int ret, char *reply)
{
	if (ret < 0)
		snprintf(reply, REPLY_BYTES, "error %s", strerror(-ret));
	else
		snprintf(reply, REPLY_BYTES, "ok");
}

/* -ERANGE: no whole number from 0 to `maximum`. */
static int parse_number(const char *text, int maximum, int *number)
{
	char *end;
	long value = strtol(text, &end, 10);

	if (end == text || *end || value < 0 || value > maximum)
		return -ERANGE;
	*number = (int)value;
	return 0;
}

static int set_fault(struct camera *camera, const char *name, const char *value)
{
	int number;
	int ret = parse_number(value, INT_MAX, &number);

	if (ret < 0)
		return ret;
	for (int i = 0; i < FAULT_COUNT; i++) {
		if (strcmp(name, fault_names[i]) == 0) {
			atomic_store(&camera_faults(camera)->values[i], number);
			return 0;
		}
	}
	return -EINVAL;
}

static int set_delay(struct camera *camera, const char *value)
{
	int delay_frames;
	int ret = parse_number(value, CAMERA_MAX_DELAY, &delay_frames);

	if (ret == 0)
		controls_set_delay(camera_controls(camera), delay_frames);
	return ret;
}

/* 1: the program shall end. */
static int obey(struct camera *camera, const struct camera_options *options, char *line,
		char *reply)
{
	char *rest = line;
	const char *name = strsep(&rest, " ");
	int ret;

	if (strcmp(name, "state") == 0) {
		report_state(camera, reply);
		return 0;
	}
	if (strcmp(name, "plug") == 0)
		ret = camera_plug(camera, rest ? rest : options->controller);
	else if (strcmp(name, "unplug") == 0)
		ret = camera_unplug(camera);
	else if (strcmp(name, "quit") == 0)
		ret = 0;
	else if (!rest)
		ret = -EINVAL;
	else if (strcmp(name, "delay") == 0)
		ret = set_delay(camera, rest);
	else
		ret = set_fault(camera, name, rest);
	report_result(ret, reply);
	return strcmp(name, "quit") == 0;
}

static int serve_client(struct camera *camera, const struct camera_options *options, int fd)
{
	char line[LINE_BYTES], reply[REPLY_BYTES];
	FILE *commands = fdopen(dup(fd), "r");
	int end = 0;

	if (!commands)
		return 0;
	while (!end && fgets(line, sizeof(line), commands)) {
		line[strcspn(line, "\n")] = 0;
		end = obey(camera, options, line, reply);
		dprintf(fd, "%s\n", reply);
	}
	fclose(commands);
	return end;
}

static int listen_at(const char *path)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	int fd;

	strncpy(address.sun_path, path, sizeof(address.sun_path) - 1);
	unlink(path);
	fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
	if (fd < 0 || bind(fd, (struct sockaddr *)&address, sizeof(address)) || listen(fd, 1))
		return -errno;
	return fd;
}

int commands_serve(struct camera *camera, const struct camera_options *options)
{
	int listener = listen_at(options->commands);
	int end = 0;

	if (listener < 0)
		return listener;
	while (!end) {
		int fd = accept4(listener, NULL, NULL, SOCK_CLOEXEC);

		if (fd < 0)
			return -errno;
		end = serve_client(camera, options, fd);
		close(fd);
	}
	close(listener);
	return 0;
}
