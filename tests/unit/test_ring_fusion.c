/* SPDX-License-Identifier: Apache-2.0 */
/* What the ring of light sensors finds of clipped light. */
#include "light/clipped/ring_fusion.h"

#include <math.h>

#include "light/math/rotation.h"
#include "lp_test.h"
#include "ring_room.h"

static void test_sums_are_exact(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_view view;
	unsigned int seed = 1;

	(void)look(room, &none, &view, &seed);
	/* half a sphere of radiance L gives pi L; a quarter of each half gives half of that */
	for (int k = 0; k < 8; k++)
		assert_float_equal(view.seen[k], (float)M_PI * 0.75F, 1e-2F);
	assert_float_equal(view.seen[8], (float)M_PI, 1e-2F);
	assert_int_equal(view.count, 0);
}

/* A lamp in any direction, also exactly between two sensors, and with the camera turned. */
static void test_a_clipped_lamp_is_found(void **state)
{
	struct room *room = *state;
	unsigned int seed = 1;
	int within_1 = 0, within_3 = 0, trials = 0;

	for (int azimuth = 0; azimuth < 360; azimuth += 15) {
		const double turn[3] = {0.1, azimuth / 50.0, 0.0};
		const struct lp_rotation rotation = lp_rotation_of_vector(turn);

		tear_down(state);
		set_up(state);
		room = *state;
		add_disc(room, (float)azimuth + 7.5F, 30.0F, 4.0F, 400.0F);
		for (int trial = 0; trial < 20; trial++, trials++) {
			struct lp_ring_view view;
			struct lp_ring_fusion fusion;
			const struct lp_ring_sample sample = look(room, &rotation, &view, &seed);

			const struct lp_ring_scale scale = {SCALE * (1.0F + 0.02F * gauss(&seed)),
							    0.02F};

			lp_ring_fuse(&view, &sample, NULL, &scale, &fusion);
			assert_int_equal(fusion.verdict, LP_RING_AGREES);
			assert_int_equal(view.count, 1);
			const float truth = true_excess(room, &room->parts->list[0]);
			const float error = fabsf(fusion.excess[0] - truth);

			assert_true(error < 0.12F * truth);
			within_1 += error < fusion.sigma[0];
			within_3 += error < 3.0F * fusion.sigma[0];
		}
	}
	print_message("%d of %d within 1 sigma, %d within 3\n", within_1, trials, within_3);
	assert_true(within_1 > 0.58 * trials && within_1 < 0.80 * trials);
	assert_true(within_3 > 0.98 * trials);
}

static void test_seats_turn_right_and_up(void **state)
{
	struct lp_ring_sample sample = {0};
	float d[3];

	(void)state;
	sample.seat[6][0] = 0.1F; /* sensor 6 looks along -Z */
	sample.seat[0][1] = 0.1F;
	sample.seat[8][0] = 0.1F;
	lp_ring_looks_along(&sample, 6, d);
	assert_float_equal(d[0], 0.1F / sqrtf(1.01F), 1e-6F);
	assert_float_equal(d[2], -1.0F / sqrtf(1.01F), 1e-6F);
	lp_ring_looks_along(&sample, 0, d);
	assert_float_equal(d[1], 0.1F / sqrtf(1.01F), 1e-6F);
	lp_ring_looks_along(&sample, 8, d);
	assert_float_equal(d[0], 0.1F / sqrtf(1.01F), 1e-6F);
}

/* Seats that the calibration knows are no error. */
static void test_known_seats_find_the_lamp(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_sample seats = {0};
	struct lp_ring_view view, straight;
	float with_seats = 0.0F, without = 0.0F;
	unsigned int seed = 5;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		seats.seat[k][1] = -0.15F; /* all sag by 8.5 degrees */
	add_disc(room, 20.0F, 40.0F, 4.0F, 400.0F);
	for (int trial = 0; trial < 40; trial++) {
		struct lp_ring_sample sample = look_from(room, &none, seats, &view, &seed);
		const float truth = true_excess(room, &room->parts->list[0]);
		struct lp_ring_fusion fusion;

		lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
		assert_int_equal(fusion.verdict, LP_RING_AGREES);
		assert_float_equal(fusion.excess[0], truth, 0.12F * truth);
		with_seats += (fusion.excess[0] - truth) / truth / 40.0F;
		memset(sample.seat, 0, sizeof(sample.seat));
		lp_ring_view_init(&straight, room->grid, &room->seen, room->parts, &none, &sample,
				  LP_LUMINANCE);
		straight.seen_sigma = 0.01F;
		lp_ring_fuse(&straight, &sample, NULL, &known, &fusion);
		without += (fusion.excess[0] - truth) / truth / 40.0F;
	}
	assert_float_equal(with_seats, 0.0F, 0.02F);
	assert_true(without < -0.08F);
}

/* Two lamps of the same look and very different strength. */
static void test_two_lamps_are_told_apart(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	unsigned int seed = 3;

	add_disc(room, 20.0F, 40.0F, 4.0F, 500.0F);
	add_disc(room, 170.0F, 20.0F, 4.0F, 4.0F); /* as it looks */
	const struct lp_ring_sample sample = look(room, &none, &view, &seed);

	lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
	assert_int_equal(view.count, 2);
	const int strong = room->parts->list[0].direction[2] < 0.0F ? 0 : 1;
	const float truth = true_excess(room, &room->parts->list[strong]);

	assert_float_equal(fusion.excess[strong], truth, 0.1F * truth);
	assert_true(fusion.excess[1 - strong] < 0.02F * truth);
}

/* Noise alone is no light: highlights that hardly clip stay as they were seen. */
static void test_noise_is_not_light(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	unsigned int seed = 4;
	int harmed = 0;

	add_disc(room, 20.0F, 40.0F, 2.0F, 4.0F);
	add_disc(room, 120.0F, 40.0F, 2.0F, 4.0F);
	add_disc(room, 250.0F, -40.0F, 2.0F, 4.0F);
	for (int trial = 0; trial < TRIALS; trial++) {
		struct lp_ring_view view;
		struct lp_ring_fusion fusion;
		const struct lp_ring_sample sample = look(room, &none, &view, &seed);
		float sum = 0.0F;

		lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
		for (int j = 0; j < view.count; j++)
			sum += fusion.excess[j];
		/* of an irradiance of about 3: a mean error over a sphere is a quarter of it */
		harmed += sum / 4.0F / 3.0F > 0.005F;
	}
	/* in nearly all cases nothing at all is changed */
	assert_true(harmed < TRIALS / 20);
}

static void test_darkness(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	unsigned int seed = 11;

	memset(room->seen_cells, 0, CELLS * sizeof(*room->seen_cells));
	memset(room->true_cells, 0, CELLS * sizeof(*room->true_cells));
	const struct lp_ring_sample sample = look(room, &none, &view, &seed);

	lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
	assert_float_equal(fusion.scale.lux_per_unit, SCALE, 1e-3F * SCALE);
	lp_ring_fuse(&view, &sample, NULL, &unknown, &fusion);
	assert_true(isfinite(fusion.misfit));
}

/* A sun somewhere in a white sky: the sky is taken apart, and the sun is found in one part. */
static void test_a_sun_in_a_white_sky(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	unsigned int seed = 12;
	float sum = 0.0F, middle[3] = {0.0F};

	add_disc(room, 0.0F, 90.0F, 75.0F, 4.0F);
	add_disc(room, 60.0F, 40.0F, 3.0F, 1500.0F);
	const struct lp_ring_sample sample = look(room, &none, &view, &seed);

	assert_int_equal(view.count, LP_MAX_CLIPPED_PARTS);
	lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
	assert_int_equal(fusion.verdict, LP_RING_AGREES);
	for (int j = 0; j < view.count; j++) {
		sum += fusion.excess[j];
		for (int a = 0; a < 3; a++)
			middle[a] += fusion.excess[j] * room->parts->list[j].direction[a];
	}
	float true_sun = 0.0F;

	for (int j = 0; j < view.count; j++)
		true_sun += true_excess(room, &room->parts->list[j]);

	assert_float_equal(sum, true_sun, 0.25F * true_sun);
	const float cosine =
		(middle[0] * 0.6634F + middle[1] * 0.6428F + middle[2] * -0.3830F) /
		sqrtf(middle[0] * middle[0] + middle[1] * middle[1] + middle[2] * middle[2]);

	assert_true(cosine > cosf(15.0F * (float)M_PI / 180.0F));
}

/* A reading that is mostly noise, as after a lag is taken off, decides nothing. */
static void test_noise_of_a_reading_counts(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	unsigned int seed = 13;

	add_disc(room, 0.0F, 30.0F, 2.0F, 900.0F);
	struct lp_ring_sample sample = look(room, &none, &view, &seed);
	const float truth = true_excess(room, &room->parts->list[0]);

	sample.illuminance_lux[0] *= 0.25F;
	lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
	assert_int_equal(fusion.wrong, 1);
	sample.noise_relative[0] = 4.0F;
	lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
	assert_int_equal(fusion.wrong, 0);
	assert_float_equal(fusion.excess[0], truth, 0.1F * truth);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_sums_are_exact),
		TEST(test_a_clipped_lamp_is_found),
		TEST(test_seats_turn_right_and_up),
		TEST(test_known_seats_find_the_lamp),
		TEST(test_two_lamps_are_told_apart),
		TEST(test_noise_is_not_light),
		TEST(test_noise_of_a_reading_counts),
		TEST(test_darkness),
		TEST(test_a_sun_in_a_white_sky),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
