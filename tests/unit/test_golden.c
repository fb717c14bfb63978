/* SPDX-License-Identifier: Apache-2.0 */
/* The frozen bytes of proto/golden, decoded as the daemon's C would, against proto/golden/v1.json.
 */
#include "wire.h"

#include <stdio.h>

#define GOLDEN "proto/golden/" /* tests run in the root of the repository */

static size_t load(const char *name, uint8_t *data, size_t size)
{
	char path[128];
	FILE *file;
	size_t got;

	(void)snprintf(path, sizeof(path), GOLDEN "%s", name);
	file = fopen(path, "rb");
	if (!file)
		fail_msg("%s: cannot be opened", path);
	got = fread(data, 1, size, file);
	fclose(file);
	return got;
}

static lightprobe_v1_FromProbe load_probe(const char *name)
{
	uint8_t data[LP_PACKET_MAX_BYTES];

	return decode_bytes(data, load(name, data, sizeof(data)));
}

static lightprobe_v1_FromClient load_client(const char *name)
{
	lightprobe_v1_FromClient message = lightprobe_v1_FromClient_init_zero;
	uint8_t data[256];
	pb_istream_t stream = pb_istream_from_buffer(data, load(name, data, sizeof(data)));

	assert_true(pb_decode_delimited(&stream, lightprobe_v1_FromClient_fields, &message));
	return message;
}

#define WHOLE(path, value) assert_true(m.message.path == (value));
#define REAL(path, value) assert_true(m.message.path == (float)(value));
#define TEXT(path, value) assert_string_equal(m.message.path, value);
#define BYTES(path, value)                                                           \
	do {                                                                         \
		assert_int_equal(m.message.path.size, sizeof(value) - 1);            \
		assert_memory_equal(m.message.path.bytes, value, sizeof(value) - 1); \
	} while (false);
#define ABSENT(path) assert_false(m.message.path);

#define PROBE(name, file, root, ...)                                                     \
	static void test_##name(void **state)                                            \
	{                                                                                \
		const lightprobe_v1_FromProbe m = load_probe(file);                      \
                                                                                         \
		(void)state;                                                             \
		assert_int_equal(m.which_message, lightprobe_v1_FromProbe_##root##_tag); \
		__VA_ARGS__                                                              \
	}
#define CLIENT(name, file, root, ...)                                                     \
	static void test_##name(void **state)                                             \
	{                                                                                 \
		const lightprobe_v1_FromClient m = load_client(file);                     \
                                                                                          \
		(void)state;                                                              \
		assert_int_equal(m.which_message, lightprobe_v1_FromClient_##root##_tag); \
		__VA_ARGS__                                                               \
	}
#include "golden.inc"
#undef PROBE
#undef CLIENT

int main(void)
{
#define PROBE(name, ...) cmocka_unit_test(test_##name),
#define CLIENT(name, ...) cmocka_unit_test(test_##name),
	const struct CMUnitTest tests[] = {
#include "golden.inc"
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
