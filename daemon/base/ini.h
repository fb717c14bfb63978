/* SPDX-License-Identifier: Apache-2.0 */
/*
 * INI files: configuration, camera files, ring files. Lines are [SECTION] and NAME = VALUE; a '#'
 * or ';' at the beginning of a line, or after a blank, begins a comment. Every error is logged as
 * FILE:LINE.
 */
#ifndef LP_BASE_INI_H
#define LP_BASE_INI_H

#include <stdbool.h>
#include <stddef.h>

#define LP_INI_MAX_BYTES ((size_t)64 << 10)
#define LP_INI_LINE_MAX_BYTES 198 /* without indentation and comment; what libinih can read */

struct lp_params;

struct lp_ini_entry {
	char *section, *name, *value; /* the section is "" before the first one */
	int line;
};

/* A file's entries in the order of its lines. Owned by whoever read it. */
struct lp_ini {
	char *path;
	int count;
	struct lp_ini_entry *entries;
};

/*
 * Read a file. `next_step` tells the user what to check when it cannot be opened ("check
 * --config"). 0, and `*ini` is to be finished; or -errno, -EBADMSG for what is no INI file, logged.
 */
int lp_ini_read(struct lp_ini *ini, const char *path, const char *next_step);

/* The same from memory; `path` names the text in messages. */
int lp_ini_parse(struct lp_ini *ini, const char *path, const char *text, size_t size_bytes);

/* -EBADMSG, logged: a section that is not among `known` (ends with NULL). */
int lp_ini_check_sections(const struct lp_ini *ini, const char *const *known);

bool lp_ini_has(const struct lp_ini *ini, const char *section);

/* Set the parameters of one section in `*fields` (base/param.h). -EBADMSG, logged: an unknown name
 * or a wrong value. */
int lp_ini_set(const struct lp_ini *ini, const char *section, const struct lp_params *params,
	       void *fields);

/* Free what it holds. A zeroed structure holds nothing. */
void lp_ini_finish(struct lp_ini *ini);

#endif
