/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Frames of a source that fills them itself: a fixed number, each with a buffer that grows to the
 * largest picture seen and is then used again.
 */
#ifndef LP_SOURCE_FRAMES_H
#define LP_SOURCE_FRAMES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "include/frame.h"

struct lp_pool;

struct lp_owned_frame {
	struct lp_frame frame; /* release() gives it back to its pool; any thread */
	struct lp_pool *pool;
	uint8_t *buffer;
	size_t capacity_bytes;
};

/* A pool of struct lp_owned_frame. NULL: out of memory. */
struct lp_pool *lp_owned_frames_create(int count);

/*
 * Take one and reset everything but its buffer: unknown values are NAN, the rest 0.
 * NULL: all are out (with `wait`: the pool was closed), or out of memory.
 */
struct lp_owned_frame *lp_owned_frame_take(struct lp_pool *pool, bool wait);

/* Make room for `size_bytes`; contents are kept. 0 or -ENOMEM. */
int lp_owned_frame_reserve(struct lp_owned_frame *frame, size_t size_bytes);

#endif
