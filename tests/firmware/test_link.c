/* SPDX-License-Identifier: Apache-2.0 */
/* The firmware's own framing: golden bytes, and a million frames on a bad line. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "dbc/mcu.h"
#include "envelope.h"
#include "link.h"

#define FRAMES 1000000
#define REMEMBERED 4 /* frames that a hit closing zero can delay */

static uint8_t unhex(const char *text, uint8_t *bytes)
{
	uint8_t count = 0;
	unsigned byte;

	for (; sscanf(text, "%2x", &byte) == 1; text += 2)
		bytes[count++] = byte;
	return count;
}

/* Every golden line: our encoder makes these bytes, our decoders take them. */
static void golden_bytes_encode_and_decode(void **state)
{
	FILE *file = fopen("proto/golden/mcu.txt", "r");
	char line[512], name[64], signals[256], hex[3][64];
	int lines = 0;

	(void)state;
	assert_non_null(file);
	while (fgets(line, sizeof(line), file)) {
		struct message message = {0}, back = {0};
		struct link link = {0};
		uint8_t serial[64], mail[64], frame[64];
		bool got = false;

		if (line[0] == '#')
			continue;
		assert_int_equal(sscanf(line, "%63s %255s %63s %63s %63s", name, signals, hex[0],
					hex[1], hex[2]),
				 5);
		message.length_bytes = unhex(hex[0], message.payload);
		uint8_t serial_bytes = unhex(hex[1], serial);
		uint8_t mail_bytes = unhex(hex[2], mail);
		message.id = mail[1];
		assert_int_equal(link_serial_encode(&message, frame), serial_bytes);
		assert_memory_equal(frame, serial, serial_bytes);
		for (uint8_t i = 0; i < serial_bytes; i++)
			got = link_serial_byte(&link, serial[i], &back);
		assert_true(got);
		assert_memory_equal(&back, &message, sizeof(message));
		assert_int_equal(mail[0], mail_bytes - 1);
		assert_true(envelope_unpack(mail + 1, mail[0], &back));
		assert_memory_equal(&back, &message, sizeof(message));
		lines++;
	}
	fclose(file);
	assert_in_range(lines, 20, 1000);
}

static void crc_has_the_published_check_value(void **state)
{
	uint16_t crc = CRC16_START;

	(void)state;
	for (const char *p = "123456789"; *p; p++)
		crc = crc16(crc, *p);
	assert_int_equal(crc, 0x29B1);
}

/* Packers and names of the schema, as the firmware uses them, against a golden line. */
static void packers_make_the_golden_payload(void **state)
{
	const uint8_t golden[8] = {0xBF, 0x07, 0xBC, 0x34, 0xC8, 0x34, 0x3C, 0x00};
	struct mcu_wheel_state_t wheel = {
		.counter = 15,
		.phase = MCU_WHEEL_STATE_PHASE_SETTLED_CHOICE,
		.servo_on = 1,
		.token = 7,
		.commanded_cdeg = 13500,
		.measured_cdeg = 13512,
		.sigma_cdeg = 60,
	};
	uint8_t payload[8];

	(void)state;
	assert_int_equal(mcu_wheel_state_pack(payload, &wheel, sizeof(payload)), 8);
	assert_memory_equal(payload, golden, sizeof(golden));
}

static uint64_t random_state = 88172645463325252u;

static uint32_t random32(void)
{
	random_state ^= random_state << 13;
	random_state ^= random_state >> 7;
	random_state ^= random_state << 17;
	return random_state >> 32;
}

static const struct {
	uint8_t id, length;
} known[] = {{0x01, 2}, {0x02, 7}, {0x03, 2}, {0x04, 4}, {0x05, 5}, {0x06, 1},
	     {0x07, 1}, {0x08, 3}, {0x09, 1}, {0x0A, 1}, {0x0B, 2}, {0x0C, 1}};
#define KNOWN (sizeof(known) / sizeof(known[0]))

static bool acceptable(const struct message *message)
{
	for (unsigned i = 0; i < KNOWN; i++) {
		if (known[i].id == message->id && known[i].length == message->length_bytes)
			return true;
	}
	return false;
}

static bool was_sent(const struct message *sent, const struct message *received)
{
	for (int i = 0; i < REMEMBERED; i++) {
		if (sent[i].id == received->id && sent[i].length_bytes == received->length_bytes &&
		    memcmp(sent[i].payload, received->payload, received->length_bytes) == 0)
			return true;
	}
	return false;
}

/* One byte in a hundred hit, with any wrong value: nothing wrong is taken, most of the rest
 * arrives. */
static void no_wrong_message_in_a_million_frames_at_one_percent_byte_errors(void **state)
{
	struct link link = {0};
	struct message sent[REMEMBERED] = {0}, received;
	uint8_t frame[ENVELOPE_MAX_BYTES + 2];
	int good = 0, wrong = 0, hit = 0;

	(void)state;
	for (int n = 0; n < FRAMES; n++) {
		struct message *message = &sent[n % REMEMBERED];
		unsigned which = random32() % KNOWN;
		bool damaged = false;

		message->id = known[which].id;
		message->length_bytes = known[which].length;
		for (int i = 0; i < message->length_bytes; i++)
			message->payload[i] = random32() % 5 ? random32() : 0;
		uint8_t count = link_serial_encode(message, frame);
		for (uint8_t i = 0; i < count; i++) {
			uint8_t byte = frame[i];
			if (random32() % 100 == 0) {
				byte ^= 1 + random32() % 255;
				damaged = true;
			}
			if (!link_serial_byte(&link, byte, &received) || !acceptable(&received))
				continue;
			if (was_sent(sent, &received))
				good++;
			else
				wrong++;
		}
		hit += damaged;
	}
	print_message("%d frames, %d hit, %d taken, %d wrong\n", FRAMES, hit, good, wrong);
	assert_int_equal(wrong, 0);
	assert_in_range(hit, FRAMES / 20, FRAMES / 5);
	assert_true(good > FRAMES - 2 * hit);
}

/* Anything up to the next zero costs at most the frame behind it. */
static void after_any_noise_the_next_frame_but_one_arrives(void **state)
{
	struct message message = {0x06, 1, {42}}, received;
	uint8_t frame[ENVELOPE_MAX_BYTES + 2];
	uint8_t count = link_serial_encode(&message, frame);

	(void)state;
	for (int n = 0; n < 20000; n++) {
		struct link link = {0};
		int noise = random32() % 300;
		int arrived = 0;
		for (int i = 0; i < noise; i++)
			link_serial_byte(&link, random32(), &received);
		for (int repeat = 0; repeat < 2; repeat++) {
			for (uint8_t i = 0; i < count; i++)
				arrived += link_serial_byte(&link, frame[i], &received);
		}
		assert_true(arrived >= 1);
		assert_int_equal(received.payload[0], 42);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(golden_bytes_encode_and_decode),
		cmocka_unit_test(crc_has_the_published_check_value),
		cmocka_unit_test(packers_make_the_golden_payload),
		cmocka_unit_test(no_wrong_message_in_a_million_frames_at_one_percent_byte_errors),
		cmocka_unit_test(after_any_noise_the_next_frame_but_one_arrives),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
