/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/frames.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "base/pool.h"

static void finish(void *object)
{
	free(((struct lp_owned_frame *)object)->buffer);
}

static void release(struct lp_frame *frame)
{
	struct lp_owned_frame *owned = (struct lp_owned_frame *)frame;

	lp_pool_give(owned->pool, owned);
}

struct lp_pool *lp_owned_frames_create(int count)
{
	return lp_pool_create(sizeof(struct lp_owned_frame), count, finish);
}

struct lp_owned_frame *lp_owned_frame_take(struct lp_pool *pool, bool wait)
{
	struct lp_owned_frame *owned = wait ? lp_pool_wait(pool) : lp_pool_take(pool);

	if (!owned)
		return NULL;
	owned->pool = pool;
	owned->frame = (struct lp_frame){
		.data = owned->buffer,
		.exposure_us = NAN,
		.gain = NAN,
		.wheel_deg = NAN,
		.wheel_sigma_deg = NAN,
		.orientation = {NAN, NAN, NAN, NAN},
		.orientation_sigma_deg = NAN,
		.row_time_us = NAN,
		.period_us = NAN,
		.release = release,
	};
	return owned;
}

int lp_owned_frame_reserve(struct lp_owned_frame *frame, size_t size_bytes)
{
	uint8_t *buffer;

	if (size_bytes <= frame->capacity_bytes)
		return 0;
	buffer = realloc(frame->buffer, size_bytes);
	if (!buffer)
		return -ENOMEM;
	frame->buffer = buffer;
	frame->capacity_bytes = size_bytes;
	frame->frame.data = buffer;
	return 0;
}
