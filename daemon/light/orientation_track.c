/* SPDX-License-Identifier: Apache-2.0 */
#include "light/orientation_track.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#define DEG (M_PI / 180.0)
/* By so much the square of a quaternion may differ from 1: it is scaled. */
#define MOST_NOT_UNIT 0.02
/* Longer gaps between samples are not filled. */
#define LONGEST_GAP_NS (100 * INT64_C(1000000))
/* A rate is taken over at least this, where samples are that dense: noise would spoil it. */
#define RATE_SPAN_NS (20 * INT64_C(1000000))
/* Angular acceleration of a head, 1 sigma: what lies between samples and beyond them. */
#define ACCELERATION (600.0 * DEG)

static bool all_finite(const double *values, int count)
{
	for (int i = 0; i < count; i++)
		if (!isfinite(values[i]))
			return false;
	return true;
}

static bool sane(const struct lp_orientation_sample *sample)
{
	const double *q = sample->quaternion;

	if (!isfinite(sample->sigma) || !(sample->sigma > 0.0))
		return false;
	if (sample->kind == LP_TURN_RATE)
		return all_finite(sample->rate_rad_s, 3);
	return all_finite(q, 4) &&
	       fabs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) < MOST_NOT_UNIT;
}

static const struct lp_track_point *point(const struct lp_orientation_track *track, uint64_t n)
{
	return &track->points[n % LP_TRACK_POINTS];
}

/* `from`, turned by a rotation vector in its own frame. */
static struct lp_rotation turned_by(const struct lp_rotation *from, const double vector[3])
{
	const struct lp_rotation turn = lp_rotation_of_vector(vector);

	return lp_rotation_product(from, &turn);
}

/* The rotation vector from a to b, in a's frame. */
static void turn_between(const struct lp_rotation *a, const struct lp_rotation *b, double vector[3])
{
	const struct lp_rotation back = lp_rotation_inverse(a);
	const struct lp_rotation turn = lp_rotation_product(&back, b);

	lp_rotation_vector(&turn, vector);
}

/* Trapezoid: the mean of the rates before and now. */
static void add_up(const struct lp_track_point *last, double sigma, struct lp_track_point *next)
{
	const double elapsed_s = (double)(next->t_ns - last->t_ns) / 1e9;
	double vector[3];

	for (int a = 0; a < 3; a++)
		vector[a] = 0.5 * elapsed_s * (last->rate_rad_s[a] + next->rate_rad_s[a]);
	next->rotation = turned_by(&last->rotation, vector);
	next->walk = last->walk + sigma * sigma * elapsed_s * elapsed_s;
}

int lp_orientation_track_add(struct lp_orientation_track *track,
			     const struct lp_orientation_sample *sample)
{
	const struct lp_track_point *last = track->count ? point(track, track->count - 1) : NULL;
	struct lp_track_point next = {.t_ns = sample->t_ns, .rotation = lp_rotation_identity()};

	if (!sane(sample))
		return -EINVAL;
	if (last && sample->t_ns <= last->t_ns)
		return -ESTALE;
	if (sample->kind == LP_ATTITUDE) {
		next.rotation = lp_rotation_of_quaternion(sample->quaternion);
		next.variance = sample->sigma * sample->sigma;
	} else {
		memcpy(next.rate_rad_s, sample->rate_rad_s, sizeof(next.rate_rad_s));
		if (last)
			add_up(last, sample->sigma, &next);
	}
	track->points[track->count++ % LP_TRACK_POINTS] = next;
	return 0;
}

void lp_orientation_track_clear(struct lp_orientation_track *track)
{
	track->count = 0;
}

static double squared(double value)
{
	return value * value;
}

/* Between a and b, at the share `part` of the way. */
static void interpolate(const struct lp_track_point *a, const struct lp_track_point *b, double part,
			struct lp_track_reading *reading)
{
	const double gap_s = (double)(b->t_ns - a->t_ns) / 1e9;
	double vector[3];

	turn_between(&a->rotation, &b->rotation, vector);
	for (int k = 0; k < 3; k++)
		vector[k] *= part;
	reading->rotation = turned_by(&a->rotation, vector);
	reading->variance = fmax(a->variance, b->variance) +
			    squared(0.5 * ACCELERATION * part * (1.0 - part) * gap_s * gap_s);
	reading->walk = a->walk + part * (b->walk - a->walk);
}

/* Beyond the newest, by the rate of the last samples. */
static void predict(const struct lp_orientation_track *track, int64_t t_ns,
		    struct lp_track_reading *reading)
{
	const uint64_t n = track->count - 1;
	const struct lp_track_point *newest = point(track, n), *base = newest;
	const double ahead_s = (double)(t_ns - newest->t_ns) / 1e9;
	double vector[3] = {0.0}, rate_variance = 0.0;

	for (uint64_t k = n; k > 0 && n - k < LP_TRACK_POINTS - 1; k--) {
		const struct lp_track_point *before = point(track, k - 1);

		if (newest->t_ns - before->t_ns > LONGEST_GAP_NS)
			break;
		base = before;
		if (newest->t_ns - before->t_ns >= RATE_SPAN_NS)
			break;
	}
	if (base == newest) {
		rate_variance = INFINITY; /* a single sample tells no rate */
	} else {
		const double span_s = (double)(newest->t_ns - base->t_ns) / 1e9;

		turn_between(&base->rotation, &newest->rotation, vector);
		for (int k = 0; k < 3; k++)
			vector[k] *= ahead_s / span_s;
		rate_variance = (newest->variance + base->variance + newest->walk - base->walk) /
				(span_s * span_s);
	}
	reading->rotation = turned_by(&newest->rotation, vector);
	reading->walk = newest->walk;
	reading->variance = newest->variance + squared(0.5 * ACCELERATION * ahead_s * ahead_s);
	if (ahead_s > 0.0)
		reading->variance += rate_variance * ahead_s * ahead_s;
}

int lp_orientation_track_at(const struct lp_orientation_track *track, int64_t t_ns,
			    struct lp_track_reading *reading)
{
	const uint64_t kept = track->count < LP_TRACK_POINTS ? track->count : LP_TRACK_POINTS;

	if (!kept)
		return -ENODATA;
	const struct lp_track_point *later = point(track, track->count - 1);

	if (t_ns > later->t_ns + LP_TRACK_MOST_PREDICTED_NS)
		return -EAGAIN;
	if (t_ns >= later->t_ns) {
		predict(track, t_ns, reading);
		return isfinite(reading->variance) ? 0 : -EAGAIN;
	}
	for (uint64_t back = 2; back <= kept; back++) {
		const struct lp_track_point *earlier = point(track, track->count - back);

		if (earlier->t_ns <= t_ns) {
			const int64_t gap_ns = later->t_ns - earlier->t_ns;

			if (gap_ns > LONGEST_GAP_NS)
				return -ENODATA;
			interpolate(earlier, later, (double)(t_ns - earlier->t_ns) / (double)gap_ns,
				    reading);
			return 0;
		}
		later = earlier;
	}
	return -ENODATA;
}
