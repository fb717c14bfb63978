/* SPDX-License-Identifier: Apache-2.0 */
/* On libgpiod 1 (Debian 12). */
#include "drivers/wheel/pca9685/index.h"

#include <errno.h>
#include <gpiod.h>
#include <stdlib.h>

#include "base/clock.h"

struct lp_index {
	struct gpiod_chip *chip;
	struct gpiod_line *line;
	bool is_on;
};

static int request(struct lp_index *index, const char *chip, unsigned int line)
{
	int level;

	index->chip = gpiod_chip_open_lookup(chip);
	if (!index->chip)
		return -errno;
	index->line = gpiod_chip_get_line(index->chip, line);
	if (!index->line ||
	    gpiod_line_request_both_edges_events_flags(index->line, "lightprobed",
						       GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP) < 0)
		return -errno;
	level = gpiod_line_get_value(index->line);
	index->is_on = level == 0;
	return level < 0 ? -errno : 0;
}

int lp_index_open(const char *chip, unsigned int line, struct lp_index **index)
{
	struct lp_index *self = calloc(1, sizeof(*self));
	int ret;

	if (!self)
		return -ENOMEM;
	ret = request(self, chip, line);
	if (ret < 0) {
		lp_index_close(self);
		return ret;
	}
	*index = self;
	return 0;
}

int lp_index_fd(const struct lp_index *index)
{
	return gpiod_line_event_get_fd(index->line);
}

bool lp_index_read(struct lp_index *index, int64_t *t_ns)
{
	struct gpiod_line_event event;

	if (gpiod_line_event_read(index->line, &event) < 0)
		return false;
	index->is_on = event.event_type == GPIOD_LINE_EVENT_FALLING_EDGE;
	*t_ns = event.ts.tv_sec * LP_NS_PER_S + event.ts.tv_nsec;
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
	if (index->chip)
		gpiod_chip_close(index->chip); /* with its lines */
	free(index);
}
