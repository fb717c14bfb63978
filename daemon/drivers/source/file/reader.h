/* SPDX-License-Identifier: Apache-2.0 */
/* The pictures of one file, or of all files of a folder, one after the other: in the order of their
 * names, numbers in them by value. Blocks.
 */
#ifndef LP_SOURCE_FILE_READER_H
#define LP_SOURCE_FILE_READER_H

#include <stdint.h>

#include "drivers/source/formats.h"

struct lp_file_reader;
struct lp_owned_frame;

/*
 * Lists the folder, or opens the file, and checks that each can be read as pictures: errors that a
 * user can mend show here, logged. `encoding` UNKNOWN: each file by its name or first bytes. Sizes
 * are those of raw pictures, 0 when not given. -ENOENT, -EACCES, ..., -EBADMSG: no picture file.
 */
int lp_file_reader_create(const char *path, enum lp_encoding encoding, uint32_t raw_width_px,
			  uint32_t raw_height_px, struct lp_file_reader **reader);

/* How many files there are: 1, or as many as the folder has. */
int lp_file_reader_files(const struct lp_file_reader *reader);

/*
 * Fill format, sizes, flags and data of `frame` with the next picture. 1, or 0 after the last one:
 * the next call begins again. Negative: this file could not be read (logged); the next call goes on
 * with the next file.
 */
int lp_file_reader_next(struct lp_file_reader *reader, struct lp_owned_frame *frame);

void lp_file_reader_destroy(struct lp_file_reader *reader); /* accepts NULL */

#endif
