/* SPDX-License-Identifier: Apache-2.0 */
/* The filter of the camera's rotation: exactly still, then following, then still again. */
#include "light/turn/motion.h"

#include <math.h>
#include <stdlib.h>

#include "lp_test.h"

#define DEG (M_PI / 180.0)
#define FRAME_S (1.0 / 30.0)

static double uniform(void)
{
	return 2.0 * rand() / RAND_MAX - 1.0;
}

/* One frame: the true rotation is seen with noise of sigma_rad, about the axes that say something.
 */
static void frame(struct lp_motion *motion, const struct lp_rotation *truth, double sigma_rad,
		  const double says[3])
{
	double prior[3][3], information[3][3] = {0}, off[3], turn[3];

	lp_motion_predict(motion, FRAME_S);
	lp_motion_prior(motion, prior);
	const struct lp_rotation back = lp_rotation_inverse(&motion->rotation);
	const struct lp_rotation apart = lp_rotation_product(&back, truth);

	lp_rotation_vector(&apart, off);
	for (int a = 0; a < 3; a++) {
		const double own = says[a] / (sigma_rad * sigma_rad);
		const double seen = off[a] + sigma_rad * sqrt(3.0) * uniform();

		information[a][a] = own;
		turn[a] =
			own * seen / (own + prior[a][a]); /* the priors here are nearly diagonal */
	}
	lp_motion_correct(motion, turn, (const double(*)[3])information);
}

static double error_deg(const struct lp_motion *motion, const struct lp_rotation *truth)
{
	const struct lp_rotation back = lp_rotation_inverse(truth);
	const struct lp_rotation apart = lp_rotation_product(&back, &motion->rotation);
	double vector[3];

	lp_rotation_vector(&apart, vector);
	return sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]) / DEG;
}

static struct lp_rotation yaw(double deg)
{
	return lp_rotation_of_vector((const double[]){0.0, deg * DEG, 0.0});
}

static const double everything[3] = {1.0, 1.0, 1.0};

/* Noise of every frame does not move a camera that holds still: not by a bit. */
static void test_still_is_exactly_still(void **state)
{
	const struct lp_rotation truth = lp_rotation_identity();
	struct lp_motion motion;

	(void)state;
	srand(1);
	lp_motion_init(&motion);
	for (int n = 0; n < 3000; n++) {
		frame(&motion, &truth, 0.03 * DEG, everything);
		assert_true(lp_rotation_is_identity(&motion.rotation));
		assert_false(lp_motion_at_rest(&motion));
	}
	assert_float_equal(lp_motion_sigma_rad(&motion), 0.0, 0.0);
}

/* Only the lamp at the zenith tells how the camera is turned: how about the vertical, nobody knows.
 */
static void test_what_nobody_tells_is_unknown_about_its_axis_alone(void **state)
{
	const double zenith[3] = {1.0, 0.0, 1.0};
	struct lp_motion motion;
	double covariance[3][3]; /* in the anchor frame the vertical is the same */

	(void)state;
	srand(7);
	lp_motion_init(&motion);
	lp_motion_covariance(&motion, covariance);
	assert_float_equal(covariance[0][0] + covariance[1][1] + covariance[2][2], 0.0, 0.0);
	for (int n = 1; n <= 60; n++) {
		const struct lp_rotation truth = yaw(60.0 * FRAME_S * n);

		frame(&motion, &truth, 0.1 * DEG, n <= 30 ? everything : zenith);
	}
	lp_motion_covariance(&motion, covariance);
	assert_true(covariance[1][1] > 3.0 * DEG * DEG && covariance[0][0] < 0.04 * DEG * DEG);
}

/* A head that begins to turn at once is followed from the first frames on, and its sigma is true.
 */
static void test_a_turn_is_followed(void **state)
{
	const double rates[] = {2.0, 30.0, 100.0, 300.0};

	(void)state;
	srand(2);
	for (unsigned int r = 0; r < LP_COUNT(rates); r++) {
		struct lp_motion motion;
		double square = 0.0, stated = 0.0;

		lp_motion_init(&motion);
		for (int n = 1; n <= 120; n++) {
			const struct lp_rotation truth = yaw(rates[r] * FRAME_S * n);

			frame(&motion, &truth, 0.1 * DEG, everything);
			if (n <= 10)
				continue;
			assert_true(error_deg(&motion, &truth) < 0.6);
			square += error_deg(&motion, &truth) * error_deg(&motion, &truth) / 3.0;
			stated += lp_motion_sigma_rad(&motion) * lp_motion_sigma_rad(&motion) /
				  (DEG * DEG);
		}
		assert_true(motion.turning);
		assert_float_equal(motion.rate[1] / DEG, rates[r], 12.0);
		assert_true(square < 4.0 * stated && stated < 4.0 * square);
	}
}

/* What one frame does not say is predicted, and becomes uncertain. */
static void test_blind_frames_are_predicted(void **state)
{
	const double nothing[3] = {0.0, 0.0, 0.0};
	struct lp_motion motion;
	double before;

	(void)state;
	srand(3);
	lp_motion_init(&motion);
	for (int n = 1; n <= 60; n++) {
		const struct lp_rotation truth = yaw(60.0 * FRAME_S * n);

		frame(&motion, &truth, 0.1 * DEG, everything);
	}
	before = lp_motion_sigma_rad(&motion);
	for (int n = 61; n <= 66; n++) {
		const struct lp_rotation truth = yaw(60.0 * FRAME_S * n);

		frame(&motion, &truth, 0.1 * DEG, nothing);
		assert_true(error_deg(&motion, &truth) < 1.5);
		assert_true(lp_motion_sigma_rad(&motion) > before);
		before = lp_motion_sigma_rad(&motion);
	}
	assert_true(before > 1.0 * DEG);
}

/* Landmarks in the anchor frame correct a turning camera, and leave a still one alone. */
static void test_landmarks(void **state)
{
	double information[3][3] = {{0}}, pull[3];
	struct lp_motion motion;

	(void)state;
	srand(5);
	lp_motion_init(&motion);
	for (int a = 0; a < 3; a++) {
		information[a][a] = 1.0 / (0.02 * DEG * 0.02 * DEG);
		pull[a] = information[a][a] * 0.01;
	}
	lp_motion_predict(&motion, FRAME_S);
	lp_motion_correct_by_landmarks(&motion, pull, (const double(*)[3])information);
	assert_true(lp_rotation_is_identity(&motion.rotation));
	for (int n = 1; n <= 60; n++) {
		const struct lp_rotation truth = yaw(60.0 * FRAME_S * n);

		frame(&motion, &truth, 0.5 * DEG, everything);
		const struct lp_rotation back = lp_rotation_inverse(&motion.rotation);
		const struct lp_rotation off = lp_rotation_product(&truth, &back);
		double vector[3];

		lp_rotation_vector(&off, vector);
		for (int a = 0; a < 3; a++)
			pull[a] = information[a][a] * vector[a];
		lp_motion_correct_by_landmarks(&motion, pull, (const double(*)[3])information);
		if (n < 10)
			continue;
		assert_true(error_deg(&motion, &truth) < 0.03);
		assert_true(lp_motion_sigma_rad(&motion) < 0.03 * DEG);
	}
}

static void test_it_comes_to_rest(void **state)
{
	const struct lp_rotation there = yaw(40.0);
	struct lp_motion motion;
	int frames = 0;

	(void)state;
	srand(4);
	lp_motion_init(&motion);
	for (int n = 1; n <= 60; n++) {
		const struct lp_rotation truth = yaw(40.0 * n / 60.0);

		frame(&motion, &truth, 0.05 * DEG, everything);
		assert_false(lp_motion_at_rest(&motion));
	}
	while (!lp_motion_at_rest(&motion) && frames++ < 300)
		frame(&motion, &there, 0.05 * DEG, everything);
	assert_true(frames > 10 && frames < 150);
	assert_true(error_deg(&motion, &there) < 0.1);
	lp_motion_anchor(&motion);
	assert_true(lp_rotation_is_identity(&motion.rotation));
	assert_false(motion.turning);
}

/* A turn that something else tells: weighed against the rate by its sigma, and no surer than it. */
static void test_a_turn_that_is_told(void **state)
{
	const double turn[3] = {0.0, 10.0 * DEG, 0.0};
	const struct lp_rotation there = yaw(10.0), further = yaw(20.0);
	struct lp_motion motion;

	(void)state;
	lp_motion_init(&motion);
	lp_motion_predict_turn(&motion, FRAME_S, turn, 0.1 * DEG);
	assert_true(motion.turning);
	assert_true(error_deg(&motion, &there) < 0.1);
	assert_float_equal(motion.rate[1] * FRAME_S / DEG, 10.0, 1.0);
	assert_float_equal(lp_motion_sigma_rad(&motion) / DEG, 0.1, 0.03);
	lp_motion_predict_turn(&motion, FRAME_S, turn, 0.1 * DEG);
	assert_true(error_deg(&motion, &further) < 0.2);
	assert_float_equal(lp_motion_sigma_rad(&motion) / DEG, 0.14, 0.04); /* both turns' */

	const struct lp_rotation before = motion.rotation, by_rate = yaw(10.0);
	const struct lp_rotation expected = lp_rotation_product(&before, &by_rate);

	/* who knows nothing changes nothing: the rate leads */
	lp_motion_predict_turn(&motion, FRAME_S, (const double[]){0.5, -0.5, 0.5}, 100.0 * DEG);
	assert_true(error_deg(&motion, &expected) < 0.5);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_still_is_exactly_still),
		cmocka_unit_test(test_a_turn_is_followed),
		cmocka_unit_test(test_what_nobody_tells_is_unknown_about_its_axis_alone),
		cmocka_unit_test(test_blind_frames_are_predicted),
		cmocka_unit_test(test_landmarks),
		cmocka_unit_test(test_it_comes_to_rest),
		cmocka_unit_test(test_a_turn_that_is_told),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
