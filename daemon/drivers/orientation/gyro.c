/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/orientation/gyro.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"

#define DEG (M_PI / 180.0)
/* A gyroscope that has not been at rest may be off by so much: what data sheets of MEMS sensors
 * allow. */
#define UNKNOWN_OFFSET (3.0 * DEG)
/* At rest the rates spread by no more than this, 1 sigma; a head that holds still moves more. */
#define MOST_NOISE (0.35 * DEG)
/* By so much an offset may have changed since it was known, by temperature. */
#define MOST_DRIFT (1.0 * DEG)
#define LEAST_SIGMA (0.02 * DEG)
#define STRETCH_NS LP_NS_PER_S
#define LEAST_COUNT 20
#define LONGEST_GAP_NS (LP_NS_PER_S / 4)
/* Share of a new stretch in the offset. */
#define GAIN 0.3
#define MOST_NOT_ORTHONORMAL 0.01

static void begin(struct lp_gyro *gyro, int64_t t_ns)
{
	gyro->t_begin_ns = t_ns;
	gyro->count = 0;
	memset(gyro->sum, 0, sizeof(gyro->sum));
	memset(gyro->square_sum, 0, sizeof(gyro->square_sum));
}

/* The offset and noise of a stretch at rest. */
static void learn(struct lp_gyro *gyro)
{
	const double n = gyro->count, gain = gyro->is_known ? GAIN : 1.0;
	double mean[3], variance = 0.0, distance = 0.0;

	for (int a = 0; a < 3; a++) {
		mean[a] = gyro->sum[a] / n;
		variance = fmax(variance, gyro->square_sum[a] / n - mean[a] * mean[a]);
		distance = fmax(distance, fabs(mean[a] - gyro->offset_rad_s[a]));
	}
	if (variance > MOST_NOISE * MOST_NOISE ||
	    distance > (gyro->is_known ? MOST_DRIFT : 3.0 * UNKNOWN_OFFSET))
		return;
	for (int a = 0; a < 3; a++)
		gyro->offset_rad_s[a] += gain * (mean[a] - gyro->offset_rad_s[a]);
	gyro->sigma_rad_s = fmax(sqrt(fmax(variance, 0.0)), LEAST_SIGMA);
	gyro->is_known = true;
}

bool lp_gyro_rate(struct lp_gyro *gyro, int64_t t_ns, double rate_rad_s[3])
{
	const int64_t passed_ns = t_ns - gyro->t_begin_ns;

	for (int a = 0; a < 3; a++)
		if (!isfinite(rate_rad_s[a]))
			return false;
	if (!gyro->is_known)
		gyro->sigma_rad_s = UNKNOWN_OFFSET;
	if (gyro->count && passed_ns >= STRETCH_NS) {
		if (gyro->count >= LEAST_COUNT && passed_ns < STRETCH_NS + LONGEST_GAP_NS)
			learn(gyro);
		begin(gyro, t_ns);
	} else if (!gyro->count) {
		begin(gyro, t_ns);
	}
	gyro->count++;
	for (int a = 0; a < 3; a++) {
		gyro->sum[a] += rate_rad_s[a];
		gyro->square_sum[a] += rate_rad_s[a] * rate_rad_s[a];
		rate_rad_s[a] -= gyro->offset_rad_s[a];
	}
	return true;
}

static double determinant(double m[3][3])
{
	return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
	       m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
	       m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

static bool is_rotation(double m[3][3])
{
	for (int i = 0; i < 3; i++) {
		for (int j = i; j < 3; j++) {
			const double dot =
				m[i][0] * m[j][0] + m[i][1] * m[j][1] + m[i][2] * m[j][2];

			if (!(fabs(dot - (i == j)) < MOST_NOT_ORTHONORMAL))
				return false;
		}
	}
	return determinant(m) > 0.0;
}

int lp_gyro_parse_mount(const char *text, double matrix[3][3])
{
	double m[3][3];
	char *end;

	for (int k = 0; k < 9; k++) {
		m[k / 3][k % 3] = strtod(text, &end);
		if (end == text)
			return -EINVAL;
		text = end + strspn(end, " ");
		if (k < 8 && *text++ != (k % 3 == 2 ? ';' : ','))
			return -EINVAL;
	}
	text += strspn(text, " \n");
	if (*text || !is_rotation(m))
		return -EINVAL;
	memcpy(matrix, m, sizeof(m));
	return 0;
}
