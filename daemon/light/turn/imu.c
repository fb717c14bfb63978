/* SPDX-License-Identifier: Apache-2.0 */
#include "light/turn/imu.h"

#include <math.h>
#include <string.h>

#include "light/turn/motion.h"

#define DEG (M_PI / 180.0)
/* Chosen by hand, on tests/accuracy/live.py --orientation=sim. */

/* 1 sigma of what is in no stated sigma: when exactly an exposure was, and a lens, mount or scale
 * that is not quite known. */
#define TIMING_SIGMA_S 0.002
#define OWN_SIGMA (0.3 * DEG)
/* Further apart than so many sigmas is a contradiction; half as far is an agreement. */
#define SIGMAS 4.0
/* A camera that seems to hold still may turn unseen, before it is told further apart than so much
 * of a contradiction. */
#define DOUBTED 0.75
/* The two frames of reference drift against each other: followed with this time constant. */
#define DRIFT_S 2.0
/* Measured: where pictures show little, the anchor frame drifts in that time by up to so many of
 * the sigmas that each frame states. */
#define MAP_SIGMAS 5.0

/* 1 sigma of how late it tells, before its times have been compared with the pictures'. */
#define DELAY_SIGMA_S 0.05
/* The rate is taken over twice this time; it has changed by more than pictures mistake it by. */
#define POINTS_APART_S 0.15
#define MOST_APART_S (3.0 * POINTS_APART_S)
#define CLEAR_CHANGE (15.0 * DEG)
/* When a camera is seen to turn, its rate is not known at once. */
#define UNSTEADY_S (2.0 * POINTS_APART_S)
/* A delay may change: what was seen of it counts the less, with this time constant. */
#define DELAY_MEMORY_S 30.0

static struct lp_rotation from_to(const struct lp_rotation *a, const struct lp_rotation *b)
{
	const struct lp_rotation back = lp_rotation_inverse(a);

	return lp_rotation_product(&back, b);
}

static double length(const double v[3])
{
	return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static double limit_rad(double sigma_rad, double rate_rad_s)
{
	const double timing = TIMING_SIGMA_S * rate_rad_s;

	return SIGMAS * sqrt(sigma_rad * sigma_rad + OWN_SIGMA * OWN_SIGMA + timing * timing);
}

void lp_imu_take(struct lp_imu *imu, const struct lp_imu_sample *before,
		 const struct lp_imu_sample *now)
{
	if (now->known && now->by != imu->by)
		*imu = (struct lp_imu){.by = now->by};
	else
		imu->last = *before;
}

bool lp_imu_turn(const struct lp_imu *imu, const struct lp_imu_sample *now, double turn[3],
		 double *sigma_rad)
{
	if (imu->left_out || !imu->last.known || !now->known)
		return false;
	const struct lp_rotation turned = from_to(&imu->last.rotation, &now->rotation);

	lp_rotation_vector(&turned, turn);
	*sigma_rad = hypot(hypot(imu->last.sigma_rad, now->sigma_rad), 1e-4 * DEG);
	return true;
}

bool lp_imu_turn_unseen(const struct lp_imu *imu, const struct lp_imu_sample *now,
			const struct lp_rotation *still, double turn[3], double *sigma_rad)
{
	if (imu->left_out || !imu->has_world || !now->known)
		return false;
	const struct lp_rotation expected = lp_rotation_product(&imu->world, still);
	const struct lp_rotation turned = from_to(&expected, &now->rotation);

	lp_rotation_vector(&turned, turn);
	*sigma_rad = hypot(now->sigma_rad, OWN_SIGMA);
	return length(turn) > DOUBTED * limit_rad(now->sigma_rad, 0.0);
}

bool lp_imu_pull(const struct lp_imu *imu, const struct lp_imu_sample *now,
		 const struct lp_rotation *rotation, double pull[3], double information[3][3])
{
	if (imu->left_out || !imu->has_world || !now->known)
		return false;
	const struct lp_rotation told = from_to(&imu->world, &now->rotation);
	const struct lp_rotation back = lp_rotation_inverse(rotation);
	const struct lp_rotation off = lp_rotation_product(&told, &back);
	const double weight = 1.0 / (now->sigma_rad * now->sigma_rad + OWN_SIGMA * OWN_SIGMA);

	lp_rotation_vector(&off, pull);
	for (int a = 0; a < 3; a++) {
		pull[a] *= weight;
		for (int b = 0; b < 3; b++)
			information[a][b] = a == b ? weight : 0.0;
	}
	return true;
}

bool lp_imu_is_apart(const struct lp_rotation *told, const struct lp_rotation *found,
		     double sigma_rad, double rate_rad_s)
{
	const struct lp_rotation apart = from_to(told, found);
	double v[3];

	lp_rotation_vector(&apart, v);
	return length(v) > limit_rad(sigma_rad, rate_rad_s);
}

void lp_imu_contradict(struct lp_imu *imu)
{
	imu->delay = (struct lp_imu_delay){0};
	imu->left_out = true;
	imu->agreed_s = 0.0;
}

/* Whether it is used from what it told, `off_rad` from where it was expected. */
static void judge(struct lp_imu *imu, double off_rad, double limit, double elapsed_s)
{
	if (off_rad > limit)
		lp_imu_contradict(imu);
	else if (off_rad > 0.5 * limit)
		imu->agreed_s = 0.0;
	else
		imu->agreed_s += elapsed_s;
	if (imu->agreed_s > LP_IMU_AGREED_S)
		imu->left_out = false;
}

/* Mean rate about the k-th point, as seen. */
static void rate_at(const struct lp_imu_delay *delay, int k, double rate[3])
{
	const struct lp_imu_point *p = &delay->points[k];
	const struct lp_rotation turn = from_to(&p[-1].seen, &p[1].seen);

	lp_rotation_vector(&turn, rate);
	for (int a = 0; a < 3; a++)
		rate[a] /= p[0].after_s + p[1].after_s;
}

/* What it told of the turn between the middle points, beyond what was seen, is the change of the
 * rate times how late it is. */
static void compare_turns(struct lp_imu_delay *delay, double sigma_rad)
{
	const struct lp_imu_point *p = delay->points;
	const struct lp_rotation turn_told = from_to(&p[1].told, &p[2].told);
	const struct lp_rotation turn_seen = from_to(&p[1].seen, &p[2].seen);
	const struct lp_rotation beyond = from_to(&turn_seen, &turn_told);
	const double weight = 0.5 / (sigma_rad * sigma_rad); /* two points, alike */
	double v[3], before[3], change[3];

	lp_rotation_vector(&beyond, v);
	rate_at(delay, 1, before);
	rate_at(delay, 2, change);
	for (int a = 0; a < 3; a++)
		change[a] -= before[a];
	for (int a = 0; a < 3 && length(change) > CLEAR_CHANGE; a++) {
		delay->sum_s -= weight * change[a] * v[a];
		delay->information += weight * change[a] * change[a];
	}
}

static void look_for_delay(struct lp_imu_delay *delay, const struct lp_imu_sample *now,
			   const struct lp_motion *motion)
{
	const double kept = exp(-delay->passed_s / DELAY_MEMORY_S);

	if (delay->passed_s < POINTS_APART_S)
		return;
	if (delay->passed_s > MOST_APART_S || delay->steady_s < UNSTEADY_S)
		delay->count = 0;
	if (delay->count == LP_IMU_POINTS) {
		memmove(delay->points, delay->points + 1,
			(LP_IMU_POINTS - 1) * sizeof(*delay->points));
		delay->count--;
	}
	delay->points[delay->count++] = (struct lp_imu_point){.told = now->rotation,
							      .seen = motion->rotation,
							      .after_s = delay->passed_s};
	delay->passed_s = 0.0;
	delay->sum_s *= kept;
	delay->information *= kept;
	if (delay->count == LP_IMU_POINTS)
		compare_turns(delay,
			      hypot(hypot(now->sigma_rad, OWN_SIGMA), lp_motion_sigma_rad(motion)));
}

static void pass(struct lp_imu_delay *delay, const struct lp_motion *motion, double elapsed_s)
{
	delay->passed_s += elapsed_s;
	delay->steady_s = motion->turning == delay->turned ? delay->steady_s + elapsed_s : 0.0;
	delay->turned = motion->turning;
}

double lp_imu_delay_sigma_rad(const struct lp_imu *imu, double rate_rad_s)
{
	const struct lp_imu_delay *delay = &imu->delay;
	const double information = delay->information + 1.0 / (DELAY_SIGMA_S * DELAY_SIGMA_S);

	return rate_rad_s * hypot(delay->sum_s / information, 1.0 / sqrt(information));
}

void lp_imu_compare(struct lp_imu *imu, const struct lp_imu_sample *now,
		    const struct lp_motion *motion, double parallax_rad, double elapsed_s)
{
	const struct lp_rotation back = lp_rotation_inverse(&motion->rotation);

	elapsed_s = fmax(elapsed_s, 0.0); /* a clock that has been set back */
	pass(&imu->delay, motion, elapsed_s);
	if (!now->known)
		return;
	look_for_delay(&imu->delay, now, motion);
	const struct lp_rotation world = lp_rotation_product(&now->rotation, &back);

	if (!imu->has_world) {
		imu->has_world = true;
		imu->world = world;
		return;
	}
	const struct lp_rotation off = from_to(&imu->world, &world);
	const double sigma = hypot(hypot(now->sigma_rad, parallax_rad),
				   MAP_SIGMAS * lp_motion_sigma_rad(motion));
	double v[3];

	lp_rotation_vector(&off, v);
	judge(imu, length(v), limit_rad(sigma, length(motion->rate)), elapsed_s);
	for (int a = 0; a < 3; a++)
		v[a] *= elapsed_s / (elapsed_s + DRIFT_S);
	const struct lp_rotation step = lp_rotation_of_vector(v);

	imu->world = lp_rotation_product(&imu->world, &step);
}

void lp_imu_anchor(struct lp_imu *imu, const struct lp_rotation *rotation)
{
	imu->delay.count = 0;
	if (imu->has_world)
		imu->world = lp_rotation_product(&imu->world, rotation);
}
