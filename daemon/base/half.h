/* SPDX-License-Identifier: Apache-2.0 */
/* Half floats: IEEE 754 binary16. */
#ifndef LP_BASE_HALF_H
#define LP_BASE_HALF_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#define LP_HALF_NAN 0x7e00U
#define LP_HALF_MAX 65504.0F

/* The nearest half float (ties to even); what is too large becomes the largest one. */
static inline uint16_t lp_half(float value)
{
	const float size = fminf(fabsf(value), LP_HALF_MAX);
	const uint32_t sign = signbit(value) ? 0x8000U : 0U;
	uint32_t bits;

	if (isnan(value))
		return LP_HALF_NAN;
	if (size < 0x1p-14F) /* subnormal: in units of 2^-24 */
		return (uint16_t)(sign | (uint32_t)lrintf(size * 0x1p24F));
	memcpy(&bits, &size, sizeof(bits));
	bits += 0xfffU + ((bits >> 13) & 1U); /* round what the shorter mantissa loses */
	return (uint16_t)(sign | ((bits >> 13) - (112U << 10)));
}

#endif
