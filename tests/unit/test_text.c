/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <stdio.h>
#include <stdlib.h>

#include "base/text.h"

static const char *copied(const char *from, size_t size_bytes)
{
	static char to[64];

	memset(to, 'x', sizeof(to));
	lp_text_copy(to, size_bytes, from);
	assert_true(strlen(to) < size_bytes);
	return to;
}

static void test_good_text_stays_as_it_is(void **state)
{
	(void)state;
	assert_string_equal(copied("", 8), "");
	assert_string_equal(copied("/dev/video0: öffnen — ŷ€𝛀", 64), "/dev/video0: öffnen — ŷ€𝛀");
	assert_string_equal(copied("1234567", 8), "1234567");
}

static void test_what_is_no_utf_8_and_control_characters_are_replaced(void **state)
{
	(void)state;
	assert_string_equal(copied("a\xff"
				   "b\n\t\x7f"
				   "c",
				   64),
			    "a?b   c");
	assert_string_equal(copied("\xc0\xaf \xe2\x82", 64), "?? ??"); /* overlong; cut short */
	assert_string_equal(copied("\xed\xa0\x80", 64), "???");	       /* a surrogate */
	assert_string_equal(copied("\xf4\x90\x80\x80", 64), "????");   /* above U+10FFFF */
	assert_string_equal(copied("\xf4\x8f\xbf\xbf", 64), "\xf4\x8f\xbf\xbf"); /* the last one */
	assert_string_equal(copied("\xe2\x82\xacx\x80", 64), "\xe2\x82\xacx?");
}

/* Terminals obey the second set of control characters, too; and text may pretend to be another. */
static void test_hidden_characters_are_replaced(void **state)
{
	static const char *const hidden[] = {"\xc2\x80",  "\xc2\x9b", "\xc2\x9f", "\xc2\xad",
					     "\u200b",	  "\u200f",   "\u2028",	  "\u2029",
					     "\u202e",	  "\u2066",   "\u2069",	  "\ufeff",
					     "\U000E0041"};

	(void)state;
	for (size_t k = 0; k < LP_COUNT(hidden); k++) {
		char from[16];

		(void)snprintf(from, sizeof(from), "a%sb", hidden[k]);
		assert_string_equal(copied(from, 64), "a?b");
	}
	assert_string_equal(copied("\xc2\xa0 \u2010\u2027\u2030\u205f\u2070", 64),
			    "\xc2\xa0 \u2010\u2027\u2030\u205f\u2070");
}

static void test_long_text_loses_its_middle(void **state)
{
	(void)state;
	assert_string_equal(copied("0123456789abcdefghij", 17), "0123...bcdefghij");
	assert_string_equal(copied("ääääääääääää", 17), "ää...ääää"); /* between characters only */
}

/* Whatever the bytes, whatever the room: the result is valid and fits. */
static void test_any_bytes(void **state)
{
	(void)state;
	srand(1);
	for (int i = 0; i < 20000; i++) {
		static const unsigned char some[] = "\xe2\x82\xac\xf0\x9d\x9b\x80\xc3\xa4"
						    "a\n\xff\xed\xa0";
		char from[41], twice[64];
		const int length = rand() % 40;
		const size_t size_bytes = 8 + (size_t)(rand() % 40);

		for (int k = 0; k < length; k++)
			from[k] = (char)some[rand() % (sizeof(some) - 1)];
		from[length] = '\0';
		const char *once = copied(from, size_bytes);

		assert_null(strpbrk(once, "\n\xff"));
		lp_text_copy(twice, sizeof(twice), once); /* valid text is not changed */
		assert_string_equal(once, twice);
	}
}

static void test_numbers_of_bits(void **state)
{
	char text[32], cut[6];

	(void)state;
	lp_text_list_bits(text, sizeof(text), 0);
	assert_string_equal(text, "");
	lp_text_list_bits(text, sizeof(text), 1U << 0 | 1U << 3 | 1U << 31);
	assert_string_equal(text, "0, 3, 31");
	lp_text_list_bits(cut, sizeof(cut), 0x1FF);
	assert_string_equal(cut, "0, 1,");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_good_text_stays_as_it_is),
		cmocka_unit_test(test_what_is_no_utf_8_and_control_characters_are_replaced),
		cmocka_unit_test(test_hidden_characters_are_replaced),
		cmocka_unit_test(test_long_text_loses_its_middle),
		cmocka_unit_test(test_any_bytes),
		cmocka_unit_test(test_numbers_of_bits),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
