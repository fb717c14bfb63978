/* SPDX-License-Identifier: Apache-2.0 */
/* What Linux may say of a gyroscope (industrial I/O): its mount matrix as a text, up to a zero;
 * then samples, each a step of time in milliseconds and three rates. */
#include "fuzz.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "drivers/orientation/gyro.h"

struct sample {
	uint16_t passed_ms;
	float rate[3];
} __attribute__((packed));

static void try_mount(const char *text)
{
	double mount[3][3];

	if (lp_gyro_parse_mount(text, mount) < 0)
		return;
	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			fuzz_assert(fabs(mount[i][j]) <= 1.1);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	const uint8_t *end = size ? memchr(data, 0, size) : NULL;
	const size_t bytes = end ? (size_t)(end - data) : size;
	char *text = malloc(bytes + 1);
	struct lp_gyro gyro = {0};
	struct sample sample;
	int64_t t_ns = LP_NS_PER_S;

	fuzz_assert(text != NULL);
	memcpy(text, data, bytes);
	text[bytes] = '\0';
	try_mount(text);
	free(text);
	for (size_t at = bytes + 1; at + sizeof(sample) <= size; at += sizeof(sample)) {
		double rate[3];

		memcpy(&sample, data + at, sizeof(sample));
		t_ns += sample.passed_ms * LP_NS_PER_MS;
		for (int a = 0; a < 3; a++)
			rate[a] = (double)sample.rate[a];
		if (!lp_gyro_rate(&gyro, t_ns, rate))
			continue;
		fuzz_assert(gyro.sigma_rad_s > 0 && isfinite(gyro.sigma_rad_s));
		for (int a = 0; a < 3; a++)
			fuzz_assert(isfinite(rate[a]) && isfinite(gyro.offset_rad_s[a]));
	}
	return 0;
}
