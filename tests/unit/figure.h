/* SPDX-License-Identifier: Apache-2.0 */
/* Figures of the table in docs/users/accuracy.md, "Extremes of each part": tests/extremes/parts.py
 * collects what is printed here. */
#ifndef LP_TEST_FIGURE_H
#define LP_TEST_FIGURE_H

#include <float.h>
#include <math.h>

#include "lp_test.h"

/* What was found, and what it must not exceed; NAN exceeds everything. */
static inline void figure(const char *part, const char *input, const char *error, double found,
			  double bound)
{
	print_message("figure|%s|%s|%s|%.2g|%g\n", part, input, error, found, bound);
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
