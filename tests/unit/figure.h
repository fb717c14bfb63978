/* SPDX-License-Identifier: Apache-2.0 */
/* Figures of the table in docs/users/accuracy.md, "Extremes of each part": tests/extremes/parts.py
 * collects what is printed here. */
#ifndef LP_TEST_FIGURE_H
#define LP_TEST_FIGURE_H

#include <float.h>
#include <math.h>
#include <stdio.h>

#include "lp_test.h"

/* With two digits, or as a whole number. */
static inline const char *figure_text(double value, char text[32])
{
	(void)snprintf(text, 32, value >= 100.0 && value < 1e6 ? "%.0f" : "%.2g", value);
	return text;
}

/* What was found, and what it must not exceed; NAN exceeds everything. */
static inline void figure(const char *part, const char *input, const char *error, double found,
			  double bound)
{
	char texts[2][32];

	print_message("figure|%s|%s|%s|%s|%s\n", part, input, error, figure_text(found, texts[0]),
		      figure_text(bound, texts[1]));
	if (!(found <= bound))
		fail_msg("%s, %s: %s is %g, more than %g", part, input, error, found, bound);
}

static inline void assert_all_finite(const float *values, int count)
{
	for (int i = 0; i < count; i++)
		if (!isfinite(values[i]))
			fail_msg("number %d of %d is %g", i, count, (double)values[i]);
}

#define ASSERT_FINITE(array) \
	assert_all_finite((const float *)(array), (int)(sizeof(array) / sizeof(float)))

#endif
