/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>

#include "drivers/publisher/framing.h"

static int next(const uint8_t *data, size_t size, size_t *offset, size_t *length)
{
	return lp_framing_next(data, size, 256, offset, length);
}

static void test_lengths(void **state)
{
	const uint8_t small[] = {3, 'a', 'b', 'c', 9};
	uint8_t large[2 + 256] = {0x80, 2}; /* 256 */
	size_t offset, length;

	(void)state;
	assert_int_equal(next(small, 0, &offset, &length), 0);
	for (size_t size = 1; size < 4; size++)
		assert_int_equal(next(small, size, &offset, &length), 0);
	assert_int_equal(next(small, 5, &offset, &length), 1);
	assert_true(offset == 1 && length == 3);
	assert_int_equal(next((const uint8_t *)"\0", 1, &offset, &length), 1);
	assert_true(offset == 1 && length == 0);
	assert_int_equal(next(large, 1, &offset, &length), 0);
	assert_int_equal(next(large, sizeof(large) - 1, &offset, &length), 0);
	assert_int_equal(next(large, sizeof(large), &offset, &length), 1);
	assert_true(offset == 2 && length == 256);
}

static void test_too_long_and_no_varint(void **state)
{
	const uint8_t longer[] = {0x81, 2}; /* 257 */
	const uint8_t largest[] = {0xff, 0xff, 0xff, 0xff, 0x0f};
	const uint8_t beyond_32_bits[] = {0xff, 0xff, 0xff, 0xff, 0x1f};
	const uint8_t endless[] = {0x80, 0x80, 0x80, 0x80, 0x80};
	size_t offset, length;

	(void)state;
	assert_int_equal(next(longer, 2, &offset, &length), -EMSGSIZE);
	assert_int_equal(length, 257);
	assert_int_equal(next(largest, 5, &offset, &length), -EMSGSIZE);
	assert_int_equal(length, UINT32_MAX);
	assert_int_equal(next(beyond_32_bits, 5, &offset, &length), -EBADMSG);
	assert_int_equal(next(endless, 4, &offset, &length), 0);
	assert_int_equal(next(endless, 5, &offset, &length), -EBADMSG);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_lengths),
		cmocka_unit_test(test_too_long_and_no_varint),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
