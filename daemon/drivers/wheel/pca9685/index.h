/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The sensor of the comb on a GPIO line of the board, with its edges stamped by the kernel. Built
 * on libgpiod 1 (index_gpiod1.c) or 2 (index_gpiod2.c), whichever is installed. Loop thread; a line
 * of the processor's own answers in microseconds.
 */
#ifndef LP_WHEEL_PCA9685_INDEX_H
#define LP_WHEEL_PCA9685_INDEX_H

#include <stdbool.h>
#include <stdint.h>

struct lp_index;

/* `chip`: "gpiochip0", or its path. -errno: no such chip or line, busy, not permitted. */
int lp_index_open(const char *chip, unsigned int line, struct lp_index **index);

/* Readable while an edge has not been read. */
int lp_index_fd(const struct lp_index *index);

/* The oldest edge that has not been read; *t_ns: CLOCK_MONOTONIC. False: none. The descriptor is
 * non-blocking by then, as everything that is watched on the loop. */
bool lp_index_read(struct lp_index *index, int64_t *t_ns);

/* Does the sensor see a tooth (line low)? By the last edge that was read; before the first one by
 * the line's level when it was opened. */
bool lp_index_is_on(const struct lp_index *index);

void lp_index_close(struct lp_index *index); /* accepts NULL */

#endif
