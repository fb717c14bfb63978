/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Named, typed, bounded values: one table per structure drives command line, configuration file,
 * the query part of URIs, their help and their errors.
 *
 *	static const struct lp_param list[] = {
 *		{"rate", LP_PARAM_FLOAT, offsetof(struct options, rate_hz), .initial = "30",
 *		 .max = 1000, .help = "pictures a second"},
 *	};
 *	static const struct lp_params params = LP_PARAMS(list);
 */
#ifndef LP_BASE_PARAM_H
#define LP_BASE_PARAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "base/macros.h"

#define LP_PARAM_FLOATS_MAX 32

enum lp_param_type {
	LP_PARAM_BOOL,	 /* bool: 0 1 no yes off on false true */
	LP_PARAM_INT,	 /* int, min..max */
	LP_PARAM_HEX,	 /* int, min..max: 0x2c, or 44 */
	LP_PARAM_FLOAT,	 /* float, min..max; never NAN */
	LP_PARAM_FLOATS, /* struct lp_floats: a,b,c, each min..max */
	LP_PARAM_SIZE,	 /* struct lp_size: WxH, each 1..max */
	LP_PARAM_TEXT,	 /* char[max], zero-terminated */
	LP_PARAM_CHOICE, /* int: index of the word in `choices` */
	LP_PARAM_OWN,	 /* `parse` decides */
};

struct lp_floats {
	int count;
	float values[LP_PARAM_FLOATS_MAX];
};

struct lp_size {
	uint32_t width, height;
};

struct lp_param {
	const char *name;
	enum lp_param_type type;
	size_t offset;	     /* of the field in the structure */
	const char *initial; /* default, as a user would write it; NULL: field is left as it is */
	double min, max;
	const char *const *choices; /* NULL-terminated */
	/* LP_PARAM_OWN: writes the field; -EINVAL when the text is not what `expects` says. */
	int (*parse)(const char *text, void *field);
	const char *expects; /* LP_PARAM_OWN: in words, for help and errors */
	const char *help;
};

/* The parameters of one structure. */
struct lp_params {
	const struct lp_param *list;
	size_t count;
	/* Those of the structure that this one begins with; NULL: none. */
	const struct lp_params *more;
};

/* Initialises a table from its array. */
/* Versions of clang-format disagree about these lines. */
/* clang-format off */
#define LP_PARAMS(array) {.list = (array), .count = LP_COUNT(array)}
/* clang-format on */

/*
 * Set the parameter `name` in `*fields`. -EINVAL, logged under `object` (a command line, FILE:LINE,
 * a URI): unknown name (lists the known ones), or a value that is not what the parameter expects.
 * `params` NULL: there are none.
 */
int lp_param_set(const struct lp_params *params, void *fields, const char *object, const char *name,
		 const char *value);

/* Set every parameter to its default; the table is wrong when one does not parse (aborts). */
void lp_param_defaults(const struct lp_params *params, void *fields);

/* NULL when there is none. */
const struct lp_param *lp_param_find(const struct lp_params *params, const char *name);

/* Help: name, default, what is expected, and what it is for. `lead` stands before each name. */
void lp_param_print(FILE *out, const char *lead, const struct lp_params *params);

/* Print each line of `text` after `indent` blanks. */
void lp_print_indented(FILE *out, int indent, const char *text);

#endif
