/* SPDX-License-Identifier: Apache-2.0 */
#include "base/half.h"

#include <stdbool.h>

#include "lp_test.h"

/* By the definition of binary16. */
static float value_of(uint16_t half)
{
	const int exponent = half >> 10 & 31, mantissa = half & 1023;
	const float size = exponent ? ldexpf((float)(1024 + mantissa), exponent - 25)
				    : ldexpf((float)mantissa, -24);

	return half & 0x8000 ? -size : size;
}

static void test_every_half_float_is_itself_and_the_nearest(void **state)
{
	(void)state;
	for (uint32_t half = 0; half < 0x7bff; half++) {
		const float here = value_of((uint16_t)half), next = value_of((uint16_t)(half + 1));
		const float middle = here + (next - here) / 2.0F;

		assert_int_equal(lp_half(here), half);
		assert_int_equal(lp_half(-here), half | 0x8000);
		assert_int_equal(lp_half(nextafterf(middle, 0.0F)), half);
		assert_int_equal(lp_half(middle), half % 2 ? half + 1 : half); /* to even */
		assert_int_equal(lp_half(nextafterf(middle, 1e9F)), half + 1);
	}
}

static void test_what_is_no_half_float(void **state)
{
	(void)state;
	assert_int_equal(lp_half(NAN), LP_HALF_NAN);
	assert_int_equal(lp_half(1e6F), 0x7bff);
	assert_int_equal(lp_half(-INFINITY), 0xfbff);
	assert_int_equal(lp_half(1e-9F), 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_every_half_float_is_itself_and_the_nearest),
		cmocka_unit_test(test_what_is_no_half_float),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
