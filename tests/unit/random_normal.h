/* SPDX-License-Identifier: Apache-2.0 */
/* Random numbers for tests, the same in every run. */
#ifndef RANDOM_NORMAL_H
#define RANDOM_NORMAL_H

#include <stdint.h>

/* Standard normal, nearly (the sum of twelve that are uniform). */
static inline float random_normal(void)
{
	static uint32_t chance;
	float sum = -6.0F;

	for (int k = 0; k < 12; k++) {
		chance = 1664525U * chance + 1013904223U;
		sum += (float)chance / 4294967296.0F;
	}
	return sum;
}

#endif
