/* SPDX-License-Identifier: Apache-2.0 */
#include "light/turn/orientation_track.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "light/turn/motion.h"

/* Longer gaps between samples are not filled. */
#define LONGEST_GAP_NS (100 * INT64_C(1000000))
/* A rate is taken over at least this, where samples are that dense: noise would spoil it. */
#define RATE_SPAN_NS (30 * INT64_C(1000000))
/* No number that is told is larger (m, rad/s, rad, s): its square would not count. */
#define MOST_TOLD 1e9
/* Faster goes no head, and no tripod. */
#define FASTEST_M_S 5.0
#define JUMP_SIGMAS 4.0
/* How hard a head is set in motion; 1 sigma. */
#define HEAD_ACCELERATION_M_S2 3.0

static bool all_sane(const double *values, int count)
{
	for (int i = 0; i < count; i++)
		if (!(fabs(values[i]) <= MOST_TOLD))
			return false;
	return true;
}

static bool sane(const struct lp_orientation_sample *sample)
{
	const double *q = sample->quaternion;

	if (!(sample->sigma > 0.0 && sample->sigma <= MOST_TOLD) ||
	    !(sample->time_sigma_s >= 0.0 && sample->time_sigma_s <= MOST_TOLD))
		return false;
	if (sample->kind == LP_TURN_RATE)
		return all_sane(sample->rate_rad_s, 3);
	return all_sane(q, 4) &&
	       fabs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) < LP_MOST_NOT_UNIT;
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

static double distance(const double a[3], const double b[3])
{
	return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
		    (a[2] - b[2]) * (a[2] - b[2]));
}

bool lp_track_jumps(const double a_m[3], const double b_m[3], double sigma_m, double span_s)
{
	return distance(a_m, b_m) > FASTEST_M_S * span_s + JUMP_SIGMAS * sigma_m;
}

static void take_position(const struct lp_orientation_sample *sample, struct lp_track_point *next)
{
	if (!(sample->position_sigma_m > 0.0 && sample->position_sigma_m <= MOST_TOLD) ||
	    !all_sane(sample->position_m, 3))
		return;
	memcpy(next->position_m, sample->position_m, sizeof(next->position_m));
	next->position_sigma_m = sample->position_sigma_m;
}

int lp_orientation_track_add(struct lp_orientation_track *track,
			     const struct lp_orientation_sample *sample)
{
	const struct lp_track_point *last = track->count ? point(track, track->count - 1) : NULL;
	struct lp_track_point next = {.t_ns = sample->t_ns,
				      .rotation = lp_rotation_identity(),
				      .time_sigma_s = sample->time_sigma_s};

	if (!sane(sample))
		return -EINVAL;
	if (last && sample->t_ns <= last->t_ns)
		return -ESTALE;
	if (sample->kind == LP_ATTITUDE) {
		next.rotation = lp_rotation_of_quaternion(sample->quaternion);
		next.variance = sample->sigma * sample->sigma;
		take_position(sample, &next);
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

/* From the turn of a span of time: what a wrong time brings. */
static double timing_variance(const struct lp_track_point *point, const double turn[3],
			      double span_s)
{
	const double square = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2];

	return square * squared(point->time_sigma_s / span_s);
}

/* The position at the share `part` of the way from a to b, or beyond; unknown across a jump. A time
 * that is wrong errs along the way. */
static void between(const struct lp_track_point *a, const struct lp_track_point *b, double part,
		    struct lp_track_reading *reading)
{
	const double span_s = (double)(b->t_ns - a->t_ns) / 1e9;

	reading->position_sigma_m = 0.0;
	if (!(a->position_sigma_m > 0.0 && b->position_sigma_m > 0.0))
		return;
	const double gone_m = distance(a->position_m, b->position_m);
	const double noise_m = a->position_sigma_m + b->position_sigma_m;
	const double late_m = gone_m / span_s * b->time_sigma_s;

	const double bend_m =
		0.5 * HEAD_ACCELERATION_M_S2 * fabs(part * (1.0 - part)) * span_s * span_s;

	if (lp_track_jumps(a->position_m, b->position_m, noise_m, span_s))
		return;
	for (int k = 0; k < 3; k++)
		reading->position_m[k] =
			a->position_m[k] + part * (b->position_m[k] - a->position_m[k]);
	reading->position_sigma_m = sqrt(squared(fmax(a->position_sigma_m, b->position_sigma_m)) +
					 squared(late_m) + squared(bend_m));
}

/* Between a and b, at the share `part` of the way. */
static void interpolate(const struct lp_track_point *a, const struct lp_track_point *b, double part,
			struct lp_track_reading *reading)
{
	const double gap_s = (double)(b->t_ns - a->t_ns) / 1e9;
	double vector[3];

	turn_between(&a->rotation, &b->rotation, vector);
	reading->variance =
		fmax(a->variance, b->variance) + timing_variance(b, vector, gap_s) +
		squared(0.5 * LP_HEAD_ACCELERATION * part * (1.0 - part) * gap_s * gap_s);
	for (int k = 0; k < 3; k++)
		vector[k] *= part;
	reading->rotation = turned_by(&a->rotation, vector);
	reading->walk = a->walk + part * (b->walk - a->walk);
	between(a, b, part, reading);
}

/* From which sample on the rate is taken; the newest itself: none is near enough. */
static const struct lp_track_point *rate_base(const struct lp_orientation_track *track)
{
	const struct lp_track_point *newest = point(track, track->count - 1), *base = newest;

	for (uint64_t back = 2; back <= track->count && back <= LP_TRACK_POINTS; back++) {
		const struct lp_track_point *before = point(track, track->count - back);

		if (newest->t_ns - before->t_ns > LONGEST_GAP_NS)
			break;
		base = before;
		if (newest->t_ns - before->t_ns >= RATE_SPAN_NS)
			break;
	}
	return base;
}

/* Beyond the newest, by the rate of the last samples. False: a single one tells no rate. */
static bool predict(const struct lp_orientation_track *track, int64_t t_ns,
		    struct lp_track_reading *reading)
{
	const struct lp_track_point *newest = point(track, track->count - 1);
	const struct lp_track_point *base = rate_base(track);
	const double ahead_s = (double)(t_ns - newest->t_ns) / 1e9;
	const double span_s = (double)(newest->t_ns - base->t_ns) / 1e9;
	double vector[3];

	*reading = (struct lp_track_reading){.rotation = newest->rotation,
					     .variance = newest->variance,
					     .walk = newest->walk};
	memcpy(reading->position_m, newest->position_m, sizeof(reading->position_m));
	reading->position_sigma_m = newest->position_sigma_m;
	if (t_ns == newest->t_ns)
		return true;
	if (base == newest)
		return false;
	const double part = ahead_s / span_s;

	turn_between(&base->rotation, &newest->rotation, vector);
	reading->variance = squared(1.0 + part) * newest->variance +
			    squared(part) * (base->variance + newest->walk - base->walk) +
			    timing_variance(newest, vector, span_s) +
			    squared(0.5 * LP_HEAD_ACCELERATION * ahead_s * (ahead_s + span_s));
	for (int k = 0; k < 3; k++)
		vector[k] *= part;
	reading->rotation = turned_by(&newest->rotation, vector);
	between(base, newest, 1.0 + part, reading);
	return true;
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
	if (t_ns >= later->t_ns)
		return predict(track, t_ns, reading) ? 0 : -EAGAIN;
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
