/* SPDX-License-Identifier: Apache-2.0 */
/* On libgpiod 2 (Debian 13). */
#include "drivers/wheel/pca9685/index.h"

#include <errno.h>
#include <gpiod.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"

struct lp_index {
	unsigned int line;
	struct gpiod_line_request *request;
	struct gpiod_edge_event_buffer *event; /* room for one */
	bool is_on;
};

/* All that is asked of the line. Returns the request; NULL: errno. */
static struct gpiod_line_request *request_of(struct gpiod_chip *chip, unsigned int line,
					     struct gpiod_line_settings *settings,
					     struct gpiod_line_config *lines,
					     struct gpiod_request_config *request)
{
	gpiod_request_config_set_consumer(request, "lightprobed");
	if (gpiod_line_settings_set_direction(settings, GPIOD_LINE_DIRECTION_INPUT) < 0 ||
	    gpiod_line_settings_set_edge_detection(settings, GPIOD_LINE_EDGE_BOTH) < 0 ||
	    gpiod_line_settings_set_bias(settings, GPIOD_LINE_BIAS_PULL_UP) < 0 ||
	    gpiod_line_settings_set_event_clock(settings, GPIOD_LINE_CLOCK_MONOTONIC) < 0 ||
	    gpiod_line_config_add_line_settings(lines, &line, 1, settings) < 0)
		return NULL;
	return gpiod_chip_request_lines(chip, request, lines);
}

/* 0 or -errno. */
static int request(struct lp_index *index, const char *chip_name)
{
	struct gpiod_line_settings *settings = gpiod_line_settings_new();
	struct gpiod_line_config *lines = gpiod_line_config_new();
	struct gpiod_request_config *wanted = gpiod_request_config_new();
	struct gpiod_chip *chip = NULL;
	char path[80];
	int ret = -ENOMEM;

	if (settings && lines && wanted) {
		(void)snprintf(path, sizeof(path), "%s%s", *chip_name == '/' ? "" : "/dev/",
			       chip_name);
		chip = gpiod_chip_open(path);
		if (chip)
			index->request = request_of(chip, index->line, settings, lines, wanted);
		ret = index->request ? 0 : -errno;
	}
	if (chip)
		gpiod_chip_close(chip); /* the request lives on by itself */
	gpiod_request_config_free(wanted);
	gpiod_line_config_free(lines);
	gpiod_line_settings_free(settings);
	return ret;
}

int lp_index_open(const char *chip, unsigned int line, struct lp_index **index)
{
	struct lp_index *self = calloc(1, sizeof(*self));
	enum gpiod_line_value level;
	int ret;

	if (!self)
		return -ENOMEM;
	self->line = line;
	self->event = gpiod_edge_event_buffer_new(1);
	ret = self->event ? request(self, chip) : -ENOMEM;
	if (ret == 0) {
		level = gpiod_line_request_get_value(self->request, line);
		self->is_on = level == GPIOD_LINE_VALUE_INACTIVE;
		ret = level == GPIOD_LINE_VALUE_ERROR ? -errno : 0;
	}
	if (ret < 0) {
		lp_index_close(self);
		return ret;
	}
	*index = self;
	return 0;
}

int lp_index_fd(const struct lp_index *index)
{
	return gpiod_line_request_get_fd(index->request);
}

bool lp_index_read(struct lp_index *index, int64_t *t_ns)
{
	struct gpiod_edge_event *event;

	if (gpiod_line_request_read_edge_events(index->request, index->event, 1) < 1)
		return false;
	event = gpiod_edge_event_buffer_get_event(index->event, 0);
	index->is_on = gpiod_edge_event_get_event_type(event) == GPIOD_EDGE_EVENT_FALLING_EDGE;
	*t_ns = (int64_t)gpiod_edge_event_get_timestamp_ns(event);
	return true;
}

bool lp_index_is_on(const struct lp_index *index)
{
	return index->is_on;
}

void lp_index_close(struct lp_index *index)
{
	if (!index)
		return;
	if (index->request)
		gpiod_line_request_release(index->request);
	gpiod_edge_event_buffer_free(index->event);
	free(index);
}
