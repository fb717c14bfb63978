/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Named, typed, bounded values: one table per structure drives command line, configuration file,
 *the query part of URIs, their help and their errors.
 *
 *	struct lp_param params[] = {
 *		{"rate", LP_PARAM_FLOAT, offsetof(struct options, rate_hz), .initial = "30", .max =
 *1000},
 *	};
 */
#ifndef LP_BASE_PARAM_H
#define LP_BASE_PARAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define LP_PARAM_FLOATS_MAX 16

enum lp_param_type {
	LP_PARAM_BOOL,	 /* bool: 0 1 no yes off on false true */
	LP_PARAM_INT,	 /* int, min..max */
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

/*
 * Set the parameter `name` in `*fields`. -EINVAL, logged under `object` (a command line, FILE:LINE,
 * a URI): unknown name (lists the known ones), or a value that is not what the parameter expects.
 */
int lp_param_set(const struct lp_param *params, size_t count, void *fields, const char *object,
		 const char *name, const char *value);

/* Set every parameter to its default; the table is wrong when one does not parse (aborts). */
void lp_param_defaults(const struct lp_param *params, size_t count, void *fields);

/* What the parameter expects, in words ("a whole number 0..4"), into `text`. */
void lp_param_describe(const struct lp_param *param, char *text, size_t size_bytes);

/* NULL when there is none. */
const struct lp_param *lp_param_find(const struct lp_param *params, size_t count, const char *name);

#endif
