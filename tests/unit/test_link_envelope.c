/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "drivers/link/envelope.h"

static size_t unhex(const char *text, uint8_t *bytes)
{
	size_t count = 0;
	unsigned byte;

	while (sscanf(text + 2 * count, "%2x", &byte) == 1)
		bytes[count++] = (uint8_t)byte;
	return count;
}

/* Every message of proto/golden/mcu.txt, as it goes and as it comes. */
static void test_golden_bytes(void **state)
{
	FILE *file = fopen("proto/golden/mcu.txt", "re");
	char line[512], name[64], signals[256], payload[32], serial[64], mail[64];
	int written = 0, read = 0;

	(void)state;
	assert_non_null(file);
	while (fgets(line, sizeof(line), file)) {
		struct lp_link_message message = {0}, got = {0};
		uint8_t bytes[64], wire[64], i2c[64];
		struct lp_serial_reader reader = {0};
		size_t size;

		if (line[0] == '#' || sscanf(line, "%63s %255s %31s %63s %63s", name, signals,
					     payload, serial, mail) != 5)
			continue;
		message.length_bytes = (uint8_t)unhex(payload, message.payload);
		size = unhex(mail, i2c);
		assert_int_equal(i2c[0], message.length_bytes + LP_ENVELOPE_EXTRA_BYTES);
		message.id = i2c[1];
		assert_int_equal(lp_envelope_pack(&message, bytes), size - 1);
		assert_memory_equal(bytes, i2c + 1, size - 1);
		size = unhex(serial, wire);
		assert_int_equal(lp_serial_pack(&message, bytes), size);
		assert_memory_equal(bytes, wire, size);
		written++;
		if (message.id < 0x40)
			continue;
		for (size_t i = 0; i < size; i++)
			assert_int_equal(lp_serial_read(&reader, wire[i], &got), i == size - 1);
		assert_memory_equal(&got, &message, sizeof(got));
		read++;
	}
	(void)fclose(file);
	assert_true(written > 25 && read > 12);
}

static void test_what_is_no_message_is_counted(void **state)
{
	static const char *const bad[] = {
		"010100",				    /* a block with nothing in it */
		"ff010200",				    /* a block that overruns */
		"0345010102010714ffff59c62a00",		    /* CRC */
		"0101010101010101010101010101010101010100", /* too long */
		"060606c8ce43d900",			    /* TimeRequest: goes the other way */
	};
	struct lp_serial_reader reader = {0};
	struct lp_link_message message;
	uint8_t bytes[64];

	(void)state;
	for (size_t i = 0; i < LP_COUNT(bad); i++) {
		const size_t count = unhex(bad[i], bytes);

		for (size_t k = 0; k < count; k++)
			assert_false(lp_serial_read(&reader, bytes[k], &message));
		assert_int_equal(reader.errors, i + 1);
	}
	assert_false(lp_serial_read(&reader, 0, &message)); /* nothing between two zeros */
	assert_int_equal(reader.errors, LP_COUNT(bad));
}

/* A line on which one byte in a hundred is changed, over many frames: lightprobe's own promise. */
static void test_no_wrong_message_in_a_million_frames(void **state)
{
	const long frames = getenv("LP_LONG") ? 1000000 : 100000;
	struct lp_serial_reader reader = {0};
	long right = 0, wrong = 0, spoilt = 0;

	(void)state;
	srand(1);
	for (long n = 0; n < frames; n++) {
		struct lp_link_message sent = {.id = 0x4C, .length_bytes = 8}, got;
		uint8_t bytes[LP_SERIAL_FRAME_MAX_BYTES];
		bool touched = false;
		size_t count;

		for (int i = 0; i < 8; i++)
			sent.payload[i] = (uint8_t)(rand() >> 7);
		count = lp_serial_pack(&sent, bytes);
		for (size_t i = 0; i < count; i++) {
			if (rand() % 100 == 0) {
				bytes[i] ^= (uint8_t)(1 + rand() % 255);
				touched = true;
			}
		}
		spoilt += touched;
		for (size_t i = 0; i < count; i++) {
			if (!lp_serial_read(&reader, bytes[i], &got))
				continue;
			if (memcmp(&got, &sent, sizeof(got)) == 0)
				right++;
			else
				wrong++;
		}
	}
	print_message("%ld frames, %ld spoilt: %ld right, %ld wrong, %lu refused\n", frames, spoilt,
		      right, wrong, (unsigned long)reader.errors);
	assert_int_equal(wrong, 0);
	assert_true(right > (frames - spoilt) * 9 / 10);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_golden_bytes),
		cmocka_unit_test(test_what_is_no_message_is_counted),
		cmocka_unit_test(test_no_wrong_message_in_a_million_frames),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
