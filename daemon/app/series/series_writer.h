/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Raw frames into a folder, each a file as the camera delivered it, and index.jsonl beside them:
 * first a line on the camera, then a line per frame, last a line that says whether it is all
 * (docs/users/camera_calibration.md). A thread of its own writes, so that a slow disk holds up no
 * loop.
 */
#ifndef LP_APP_SERIES_SERIES_WRITER_H
#define LP_APP_SERIES_SERIES_WRITER_H

#include <stdbool.h>
#include <stdint.h>

#include "include/source.h"

struct lp_frame;
struct lp_series_writer;

/* Which command a frame came after. */
struct lp_series_shot {
	int step;	      /* of the schedule; -1: no exposure was commanded */
	float exposure_us;    /* commanded; NAN: none */
	int64_t t_command_ns; /* CLOCK_MONOTONIC when the command was given */
};

/*
 * Makes the folder, for its owner's eyes alone; one that exists must be empty: nothing is written
 * over. 0 or negative errno, logged.
 */
int lp_series_writer_create(const char *folder, struct lp_series_writer **writer);

/* Begin to write, with the line on the camera and what it can do. Once, before the first frame.
 * `scheme`: of the source, static storage. 0 or -errno, logged. */
int lp_series_writer_start(struct lp_series_writer *writer, const char *scheme,
			   const struct lp_source_caps *caps);

/* Takes over the reference to `frame`. A disk too slow for the camera holds the source's frames up:
 * what the source then leaves out is missing in the sequence. Loop thread. */
void lp_series_writer_put(struct lp_series_writer *writer, struct lp_frame *frame,
			  const struct lp_series_shot *shot);

/* 0, or why nothing more can be written (negative errno, logged). Any thread. */
int lp_series_writer_error(struct lp_series_writer *writer);

/* Waits for what is still to be written, closes the index and frees all. 0, or the error. */
int lp_series_writer_finish(struct lp_series_writer *writer, bool complete);

#endif
