/* SPDX-License-Identifier: Apache-2.0 */
#include "light/turn/motion.h"

#include <math.h>
#include <string.h>

#include "light/linear/symmetric3.h"

#define DEG (M_PI / 180.0)
/* Chosen by hand, on the scenes of docs/users/accuracy.md, "While the camera turns". */

/* A camera that holds still has turned when it is off by so much, and by so many sigmas. */
#define LEAST_TURN (0.08 * DEG)
#define TURN_SIGMAS 4.0
/* It is at rest again when for so long it has stayed within this of one rotation. */
#define QUIET_S 0.5
#define QUIET_ANGLE (0.25 * DEG)
#define LEAST_SIGMA (0.02 * DEG)
#define LEAST_RATE_SIGMA (0.01 * DEG) /* per second */
/* After so long without a frame the camera may be turned anyhow: longer adds nothing. */
#define LONGEST_S 10.0

void lp_motion_init(struct lp_motion *motion)
{
	memset(motion, 0, sizeof(*motion));
	lp_motion_anchor(motion);
}

void lp_motion_anchor(struct lp_motion *motion)
{
	*motion = (struct lp_motion){.rotation = lp_rotation_identity(),
				     .quiet_at = lp_rotation_identity()};
}

static void start_prior(struct lp_motion *motion, double elapsed_s)
{
	const double angle = LP_HEAD_RATE * elapsed_s;

	memset(motion->covariance, 0, sizeof(motion->covariance));
	for (int a = 0; a < 3; a++) {
		motion->covariance[a][a] = angle * angle + LEAST_SIGMA * LEAST_SIGMA;
		motion->covariance[a + 3][a + 3] = LP_HEAD_RATE * LP_HEAD_RATE;
		motion->covariance[a][a + 3] = motion->covariance[a + 3][a] = angle * LP_HEAD_RATE;
	}
}

static void note_quiet(struct lp_motion *motion, double elapsed_s)
{
	const struct lp_rotation back = lp_rotation_inverse(&motion->quiet_at);
	const struct lp_rotation since = lp_rotation_product(&back, &motion->rotation);
	double v[3];

	lp_rotation_vector(&since, v);
	motion->quiet_s += elapsed_s;
	if (v[0] * v[0] + v[1] * v[1] + v[2] * v[2] > QUIET_ANGLE * QUIET_ANGLE) {
		motion->quiet_s = 0.0;
		motion->quiet_at = motion->rotation;
	}
}

void lp_motion_predict(struct lp_motion *motion, double elapsed_s)
{
	double(*p)[6] = motion->covariance;
	double step[3];

	elapsed_s = fmin(elapsed_s, LONGEST_S);
	if (!motion->turning) {
		start_prior(motion, elapsed_s);
		return;
	}
	for (int a = 0; a < 3; a++)
		step[a] = motion->rate[a] * elapsed_s;
	const struct lp_rotation turned = lp_rotation_of_vector(step);

	note_quiet(motion, elapsed_s);
	motion->rotation = lp_rotation_product(&motion->rotation, &turned);
	for (int a = 0; a < 3; a++) /* F P F', F = [1 dt; 0 1] */
		for (int b = 0; b < 6; b++)
			p[a][b] += elapsed_s * p[a + 3][b];
	for (int b = 0; b < 3; b++)
		for (int a = 0; a < 6; a++)
			p[a][b] += elapsed_s * p[a][b + 3];
	const double q = LP_HEAD_ACCELERATION * elapsed_s, half = 0.5 * elapsed_s;

	for (int a = 0; a < 3; a++) {
		p[a][a] += q * q * half * half;
		p[a][a + 3] += q * q * half;
		p[a + 3][a] += q * q * half;
		p[a + 3][a + 3] += q * q;
	}
}

static void invert3(const double m[3][3], double inverse[3][3])
{
	double determinant = 0.0;

	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++) {
			const int a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3,
				  d = (i + 2) % 3;

			inverse[i][j] = m[a][c] * m[b][d] - m[a][d] * m[b][c];
		}
	for (int i = 0; i < 3; i++)
		determinant += m[0][i] * inverse[i][0];
	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			inverse[i][j] /= determinant;
}

static void position_covariance(const struct lp_motion *motion, double p[3][3])
{
	for (int a = 0; a < 3; a++)
		for (int b = 0; b < 3; b++)
			p[a][b] = motion->covariance[a][b] +
				  (a == b ? 1e-2 * LEAST_SIGMA * LEAST_SIGMA : 0.0);
}

void lp_motion_prior(const struct lp_motion *motion, double information[3][3])
{
	double p[3][3];

	position_covariance(motion, p);
	invert3((const double(*)[3])p, information);
}

double lp_motion_sigma_rad(const struct lp_motion *motion)
{
	double sum = 0.0;

	if (!motion->turning)
		return 0.0;
	for (int a = 0; a < 3; a++)
		sum += motion->covariance[a][a];
	return sqrt(sum / 3.0);
}

void lp_motion_covariance(const struct lp_motion *motion, double covariance[3][3])
{
	const double(*m)[3] = motion->rotation.m;

	memset(covariance, 0, 9 * sizeof(**covariance));
	for (int i = 0; i < 3 && motion->turning; i++) /* R P R' */
		for (int j = 0; j < 3; j++)
			for (int a = 0; a < 3; a++)
				for (int b = 0; b < 3; b++)
					covariance[i][j] +=
						m[i][a] * motion->covariance[a][b] * m[j][b];
}

/* What subtraction leaves stays a covariance: a difference of large numbers may be anything. */
static void keep_proper(struct lp_motion *motion)
{
	double(*p)[6] = motion->covariance;

	for (int a = 0; a < 3; a++) {
		p[a][a] = fmax(p[a][a], LEAST_SIGMA * LEAST_SIGMA);
		p[a + 3][a + 3] = fmax(p[a + 3][a + 3], LEAST_RATE_SIGMA * LEAST_RATE_SIGMA);
	}
	for (int i = 0; i < 6; i++)
		for (int j = 0; j < i; j++) {
			const double most = sqrt(p[i][i] * p[j][j]);

			p[i][j] = p[j][i] = fmin(fmax(p[j][i], -most), most);
		}
}

/* P -= P_r (1 + H P_rr)^-1 H P_r': the filter's update for information H, which may be singular. */
static void shrink(struct lp_motion *motion, const double information[3][3])
{
	double p[3][3], m[3][3], inverse[3][3], gain[3][3] = {0}, change[6][6] = {0};

	position_covariance(motion, p);
	for (int a = 0; a < 3; a++)
		for (int b = 0; b < 3; b++) {
			m[a][b] = a == b;
			for (int c = 0; c < 3; c++)
				m[a][b] += information[a][c] * p[c][b];
		}
	invert3((const double(*)[3])m, inverse);
	for (int a = 0; a < 3; a++)
		for (int b = 0; b < 3; b++)
			for (int c = 0; c < 3; c++)
				gain[a][b] += inverse[a][c] * information[c][b];
	for (int i = 0; i < 6; i++)
		for (int j = 0; j < 6; j++)
			for (int a = 0; a < 3; a++)
				for (int b = 0; b < 3; b++)
					change[i][j] += motion->covariance[i][a] * gain[a][b] *
							motion->covariance[j][b];
	for (int i = 0; i < 6; i++)
		for (int j = 0; j < 6; j++)
			motion->covariance[i][j] -= 0.5 * (change[i][j] + change[j][i]);
	keep_proper(motion);
}

/* Whether a camera that held still has turned. */
static bool has_turned(const double turn[3], const double information[3][3])
{
	double square = 0.0, sigmas = 0.0;

	for (int a = 0; a < 3; a++) {
		square += turn[a] * turn[a];
		for (int b = 0; b < 3; b++)
			sigmas += turn[a] * information[a][b] * turn[b];
	}
	return square > LEAST_TURN * LEAST_TURN && sigmas > TURN_SIGMAS * TURN_SIGMAS;
}

double lp_motion_shown_turn_rad(const double information[3][3])
{
	double known[3][3], covariance[3][3], axis[3];

	for (int a = 0; a < 3; a++) /* no direction is further off than half a turn */
		for (int b = 0; b < 3; b++)
			known[a][b] = information[a][b] + (a == b ? 1.0 / (M_PI * M_PI) : 0.0);
	invert3((const double(*)[3])known, covariance);
	const double largest =
		lp_symmetric3_largest((const double[6]){covariance[0][0], covariance[0][1],
							covariance[0][2], covariance[1][1],
							covariance[1][2], covariance[2][2]},
				      axis);

	return fmax(TURN_SIGMAS * sqrt(largest), LEAST_TURN);
}

void lp_motion_correct(struct lp_motion *motion, const double turn[3],
		       const double information[3][3])
{
	double prior[3][3];

	if (!motion->turning && !has_turned(turn, information))
		return;
	motion->turning = true;
	lp_motion_prior(motion, prior);
	for (int i = 0; i < 3; i++) /* the rate follows by its covariance with the rotation */
		for (int a = 0; a < 3; a++)
			for (int b = 0; b < 3; b++)
				motion->rate[i] +=
					motion->covariance[i + 3][a] * prior[a][b] * turn[b];
	const struct lp_rotation turned = lp_rotation_of_vector(turn);

	motion->rotation = lp_rotation_product(&motion->rotation, &turned);
	shrink(motion, information);
}

/* m' h m: of the anchor frame's information to the camera's. */
static void information_in_camera(const struct lp_rotation *rotation, const double from[3][3],
				  double to[3][3])
{
	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++) {
			to[i][j] = 0.0;
			for (int a = 0; a < 3; a++)
				for (int b = 0; b < 3; b++)
					to[i][j] +=
						rotation->m[a][i] * from[a][b] * rotation->m[b][j];
		}
}

void lp_motion_correct_by_landmarks(struct lp_motion *motion, const double pull[3],
				    const double information[3][3])
{
	const struct lp_rotation before = motion->rotation;
	const struct lp_rotation back = lp_rotation_inverse(&before);
	double own[3][3], both[3][3], covariance[3][3], pull_in_camera[3], turn[3] = {0.0};

	if (!motion->turning)
		return;
	information_in_camera(&before, information, own);
	lp_rotate(&back, pull, pull_in_camera);
	lp_motion_prior(motion, both);
	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			both[i][j] += own[i][j];
	invert3((const double(*)[3])both, covariance);
	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			turn[i] += covariance[i][j] * pull_in_camera[j];
	lp_motion_correct(motion, turn, (const double(*)[3])own);
}

/* A camera that held still turns from now on, at a rate that nobody knows. */
static void start_turning(struct lp_motion *motion)
{
	memset(motion->covariance, 0, sizeof(motion->covariance));
	for (int a = 0; a < 3; a++) {
		motion->rate[a] = 0.0;
		motion->covariance[a][a] = LEAST_SIGMA * LEAST_SIGMA;
		motion->covariance[a + 3][a + 3] = LP_HEAD_RATE * LP_HEAD_RATE;
	}
	motion->turning = true;
}

/* Covariance of the state after a prediction with the turn that was predicted, `before` the one
 * before. Its last three rows times elapsed_s, and the noise, are the variance of the turn. */
static void covariance_with_turn(const double before[6][6], double elapsed_s, double with[6][3])
{
	const double q = LP_HEAD_ACCELERATION * elapsed_s, half = 0.5 * elapsed_s;

	for (int i = 0; i < 3; i++)
		for (int a = 0; a < 3; a++) {
			const double rates = elapsed_s * before[i + 3][a + 3];
			const double noise = i == a ? q * q * half : 0.0;

			with[i][a] = elapsed_s * (before[i][a + 3] + rates) + noise * half;
			with[i + 3][a] = rates + noise;
		}
}

/* The filter's update for the turn that was told, `off` from the one that was predicted. */
static void weigh_turn(struct lp_motion *motion, const double with[6][3],
		       const double variance[3][3], const double off[3])
{
	double inverse[3][3], gain[6][3] = {{0.0}}, step[3] = {0.0};

	invert3(variance, inverse);
	for (int i = 0; i < 6; i++)
		for (int a = 0; a < 3; a++)
			for (int b = 0; b < 3; b++)
				gain[i][a] += with[i][b] * inverse[b][a];
	for (int i = 0; i < 3; i++)
		for (int a = 0; a < 3; a++) {
			step[i] += gain[i][a] * off[a];
			motion->rate[i] += gain[i + 3][a] * off[a];
		}
	for (int i = 0; i < 6; i++)
		for (int j = 0; j < 6; j++)
			for (int a = 0; a < 3; a++)
				motion->covariance[i][j] -=
					0.5 * (gain[i][a] * with[j][a] + gain[j][a] * with[i][a]);
	keep_proper(motion);
	const struct lp_rotation turned = lp_rotation_of_vector(step);

	motion->rotation = lp_rotation_product(&motion->rotation, &turned);
}

void lp_motion_predict_turn(struct lp_motion *motion, double elapsed_s, const double turn[3],
			    double sigma_rad)
{
	const struct lp_rotation turned = lp_rotation_of_vector(turn);
	double before[6][6], with[6][3], variance[3][3], off[3];

	elapsed_s = fmin(elapsed_s, LONGEST_S);
	if (!motion->turning)
		start_turning(motion);
	memcpy(before, motion->covariance, sizeof(before));
	const struct lp_rotation told = lp_rotation_product(&motion->rotation, &turned);

	lp_motion_predict(motion, elapsed_s);
	const struct lp_rotation back = lp_rotation_inverse(&motion->rotation);
	const struct lp_rotation apart = lp_rotation_product(&back, &told);

	lp_rotation_vector(&apart, off);
	covariance_with_turn((const double(*)[6])before, elapsed_s, with);
	for (int a = 0; a < 3; a++)
		for (int b = 0; b < 3; b++)
			variance[a][b] = with[a][b] - elapsed_s * before[a][b + 3] +
					 (a == b ? sigma_rad * sigma_rad : 0.0);
	weigh_turn(motion, (const double(*)[3])with, (const double(*)[3])variance, off);
}

bool lp_motion_at_rest(const struct lp_motion *motion)
{
	return motion->turning && motion->quiet_s > QUIET_S;
}
