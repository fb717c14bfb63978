/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/doubt/banding.h"

#include <math.h>
#include <string.h>

#include "vision/doubt/gain.h"

/* Chosen by hand, on the furnished room of tests/accuracy/changes.py. */

#define LEAST_SAMPLES 200
/* Bands are this strong, so many sigmas, and so many times what is found at CONTROL_HZ, where lamps
 * do not flicker: a scene's own rows fit any frequency a little. */
#define LEAST_AMPLITUDE 0.02
#define SIGMAS 5.0
#define CLEARLY 2.0
/* Share of the frames that must show them, to begin and to go on; and how fast that follows. */
#define BEGINS 0.6F
#define GOES_ON 0.3F
#define EVIDENCE_GAIN 0.15F

static const double mains_hz[] = {100.0, 120.0}, control_hz[] = {190.0, 230.0};

#define UNKNOWNS 5

/* A x = b by elimination with A positive definite; false: it is not. */
static bool solve(double a[UNKNOWNS][UNKNOWNS], double b[UNKNOWNS])
{
	for (int i = 0; i < UNKNOWNS; i++) {
		if (!(a[i][i] > 1e-9))
			return false;
		for (int j = i + 1; j < UNKNOWNS; j++) {
			const double factor = a[j][i] / a[i][i];

			for (int k = i; k < UNKNOWNS; k++)
				a[j][k] -= factor * a[i][k];
			b[j] -= factor * b[i];
		}
	}
	for (int i = UNKNOWNS - 1; i >= 0; i--) {
		for (int k = i + 1; k < UNKNOWNS; k++)
			b[i] -= a[i][k] * b[k];
		b[i] /= a[i][i];
	}
	return true;
}

/* A wave over a parabola; x: the time, -1..1 over the frame. */
static void basis(double hz, double t_s, double x, double row[UNKNOWNS])
{
	row[0] = 1.0;
	row[1] = x;
	row[2] = x * x;
	row[3] = cos(2.0 * M_PI * hz * t_s);
	row[4] = sin(2.0 * M_PI * hz * t_s);
}

/* Amplitude of the wave that fits best, by weighted least squares, and its sigma. 0: none does. */
static double amplitude_of(const struct lp_banding_samples *s, double hz, double *sigma)
{
	double a[UNKNOWNS][UNKNOWNS] = {{0.0}}, b[UNKNOWNS] = {0.0};
	double weights = 0.0, squares = 0.0, squared_weights = 0.0, last_s = 0.0;

	for (int k = 0; k < s->count; k++)
		last_s = fmax(last_s, s->t_s[k]);
	for (int k = 0; k < s->count; k++) {
		double row[UNKNOWNS];

		basis(hz, s->t_s[k], 2.0 * s->t_s[k] / last_s - 1.0, row);
		for (int i = 0; i < UNKNOWNS; i++) {
			b[i] += s->weight[k] * row[i] * s->log_ratio[k];
			for (int j = 0; j < UNKNOWNS; j++)
				a[i][j] += s->weight[k] * row[i] * row[j];
		}
		weights += s->weight[k];
		squared_weights += (double)s->weight[k] * s->weight[k];
		squares += (double)s->weight[k] * s->log_ratio[k] * s->log_ratio[k];
	}
	double explained[UNKNOWNS];

	memcpy(explained, b, sizeof(explained));
	if (!solve(a, b))
		return 0.0;
	for (int i = 0; i < UNKNOWNS; i++)
		squares -= b[i] * explained[i];
	*sigma = sqrt(2.0 * LP_CORRELATED_CELLS * fmax(squares, 0.0) / weights * squared_weights /
		      (weights * weights));
	return hypot(b[3], b[4]);
}

void lp_banding_look(struct lp_banding *banding, const struct lp_banding_samples *samples)
{
	double strongest = 0.0, control = 0.0, sigma = 0.0;

	if (samples->count < LEAST_SAMPLES)
		return;
	for (int k = 0; k < 2; k++) {
		double own_sigma = 0.0, ignored;
		const double amplitude = amplitude_of(samples, mains_hz[k], &own_sigma);

		if (amplitude > strongest) {
			strongest = amplitude;
			sigma = own_sigma;
		}
		control = fmax(control, amplitude_of(samples, control_hz[k], &ignored));
	}
	const bool shows = strongest > LEAST_AMPLITUDE && strongest > SIGMAS * sigma &&
			   strongest > CLEARLY * control;

	banding->evidence += EVIDENCE_GAIN * ((shows ? 1.0F : 0.0F) - banding->evidence);
	banding->found = banding->evidence > (banding->found ? GOES_ON : BEGINS);
	if (shows)
		banding->amplitude =
			banding->found ? banding->amplitude + EVIDENCE_GAIN * ((float)strongest -
									       banding->amplitude)
				       : (float)strongest;
}
