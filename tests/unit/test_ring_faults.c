/* SPDX-License-Identifier: Apache-2.0 */
/* What the ring of light sensors finds wrong with itself and with the camera's scale. */
#include "light/clipped/ring_fusion.h"

#include <math.h>

#include "light/math/rotation.h"
#include "lp_test.h"
#include "ring_room.h"

static float sum_of(const struct lp_ring_fusion *fusion, int count, float *sigma)
{
	float sum = 0.0F, variance = 0.0F;

	for (int i = 0; i < count; i++) {
		sum += fusion->excess[i];
		for (int j = 0; j < count; j++)
			variance += fusion->covariance[i][j];
	}
	*sigma = sqrtf(variance);
	return sum;
}

static float true_sum(const struct room *room)
{
	float sum = 0.0F;

	for (int j = 0; j < room->parts->count; j++)
		sum += true_excess(room, &room->parts->list[j]);
	return sum;
}

static void test_without_clipping_the_scale_is_found(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	unsigned int seed = 5;
	const struct lp_ring_sample sample = look(room, &none, &view, &seed);

	lp_ring_fuse(&view, &sample, NULL, &unknown, &fusion);
	assert_int_equal(fusion.verdict, LP_RING_AGREES);
	assert_float_equal(fusion.scale.lux_per_unit, SCALE, 3.0F * fusion.scale.sigma * SCALE);
	assert_true(fusion.scale.sigma > 0.005F && fusion.scale.sigma < 0.02F);
}

static void test_a_wrong_scale_is_found(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	const float off[] = {0.7F, 1.3F};
	unsigned int seed = 6;

	add_disc(room, 20.0F, 40.0F, 4.0F, 300.0F);
	for (int i = 0; i < 2; i++) {
		const struct lp_ring_scale wrong = {off[i] * SCALE, 0.02F};
		struct lp_ring_view view;
		struct lp_ring_fusion fusion;
		const struct lp_ring_sample sample = look(room, &none, &view, &seed);

		lp_ring_fuse(&view, &sample, NULL, &wrong, &fusion);
		assert_true(fusion.scale_is_wrong);
		assert_float_equal(fusion.scale.lux_per_unit, SCALE, 0.1F * SCALE);
		const float truth = true_excess(room, &room->parts->list[0]);

		assert_float_equal(fusion.excess[0], truth, 0.15F * truth);
	}
}

/* A scale that is a third too low, and clipped spots all around, one of which hardly any sensor
 * sees: light that hides in the spots explains the readings as well, and the sigma says so. */
static void test_a_wrong_scale_or_hidden_light(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	const struct lp_ring_scale low = {0.7F * SCALE, 0.02F};
	unsigned int seed = 21;

	add_disc(room, 20.0F, 40.0F, 4.0F, 100.0F);
	add_disc(room, 0.0F, -85.0F, 3.0F, 4.0F);
	for (int azimuth = 0; azimuth < 360; azimuth += 60)
		add_disc(room, (float)azimuth, -10.0F, 2.0F, 4.0F);
	for (int trial = 0; trial < 20; trial++) {
		struct lp_ring_view view;
		struct lp_ring_fusion fusion;
		const struct lp_ring_sample sample = look(room, &none, &view, &seed);
		const float truth = true_sum(room);
		float sigma, sum;

		lp_ring_fuse(&view, &sample, NULL, &low, &fusion);
		sum = sum_of(&fusion, view.count, &sigma);
		assert_float_equal(sum, truth, fminf(3.0F * sigma, 2.0F * truth));
		for (int j = 0; j < view.count; j++)
			assert_true(fusion.excess[j] < 3.0F * truth);
	}
}

/* A scale that is right is not overruled because several lamps hide much light, nor called wrong,
 * whatever noise the sensors have. */
static void test_many_strong_lamps_are_no_wrong_scale(void **state)
{
	const float sigmas[] = {0.002F, 0.03F, 0.1F};
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	unsigned int seed = 23;

	for (int azimuth = 0; azimuth < 360; azimuth += 45)
		add_disc(room, (float)azimuth, 25.0F + (float)(azimuth % 90) / 5.0F, 3.0F, 40.0F);
	for (unsigned int s = 0; s < LP_COUNT(sigmas); s++)
		for (int trial = 0; trial < 20; trial++) {
			struct lp_ring_view view;
			struct lp_ring_fusion fusion;
			struct lp_ring_sample sample =
				look_with(room, &none, sigmas[s], &view, &seed);
			const float truth = true_sum(room);
			float sigma, sum;

			lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
			assert_int_equal(fusion.verdict, LP_RING_AGREES);
			assert_false(fusion.scale_is_wrong);
			assert_float_equal(fusion.scale.lux_per_unit, SCALE,
					   3.0F * SCALE * fmaxf(fusion.scale.sigma, 0.02F));
			sum = sum_of(&fusion, view.count, &sigma);
			assert_float_equal(sum, truth, 3.0F * sigma);
		}
}

/* The same for a ring that is turned by one place, though light that hides in the spots could
 * explain it: the light is that of a ring that is turned. */
static void test_a_turned_ring_is_not_taken_for_light(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	unsigned int seed = 22;
	int found = 0;

	for (int azimuth = 0; azimuth < 360; azimuth += 36)
		add_disc(room, (float)azimuth, azimuth % 72 ? 20.0F : -20.0F, 3.0F, 4.0F);
	add_disc(room, 20.0F, 40.0F, 4.0F, 300.0F);
	for (int trial = 0; trial < 20; trial++) {
		struct lp_ring_view view;
		struct lp_ring_fusion fusion;
		const struct lp_ring_sample straight = look(room, &none, &view, &seed);
		const struct lp_ring_sample sample = turned_by(&straight, 1);
		const float truth = true_sum(room);
		float sigma;

		lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
		found += fusion.verdict == LP_RING_TURNED && fusion.turned_deg == 45.0F;
		assert_float_equal(sum_of(&fusion, view.count, &sigma), truth, 0.15F * truth);
	}
	assert_true(found >= 18);
}

/* One sensor reads half, or twice, or next to nothing: it is named, and costs little. */
static void test_a_wrong_sensor_is_left_out(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	const float factors[] = {0.5F, 2.0F, 0.01F, 20.0F};
	unsigned int seed = 7;

	add_disc(room, 20.0F, 40.0F, 4.0F, 300.0F);
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		for (unsigned int f = 0; f < LP_COUNT(factors); f++) {
			struct lp_ring_view view;
			struct lp_ring_fusion fusion;
			struct lp_ring_sample sample = look(room, &none, &view, &seed);

			sample.illuminance_lux[k] *= factors[f];
			lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
			assert_int_equal(fusion.verdict, LP_RING_AGREES);
			assert_int_equal(fusion.wrong, 1U << k);
			const float truth = true_excess(room, &room->parts->list[0]);

			assert_float_equal(fusion.excess[0], truth, 0.15F * truth);
		}
	}
}

/* A hand before two or three neighbours: they are named, and light is neither hidden nor of another
 * scale. */
static void test_a_hand_before_neighbours(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	unsigned int seed = 24;

	add_disc(room, 20.0F, 40.0F, 4.0F, 300.0F);
	add_disc(room, 200.0F, 20.0F, 4.0F, 60.0F);
	for (int count = 2; count <= 3; count++)
		for (int first = 0; first < 8; first++) {
			struct lp_ring_view view;
			struct lp_ring_fusion fusion;
			struct lp_ring_sample sample = look(room, &none, &view, &seed);
			const float truth = true_sum(room);
			uint32_t hand = 0;
			float sigma, sum;

			for (int k = first; k < first + count; k++) {
				sample.illuminance_lux[k % 8] *= 0.1F;
				hand |= 1U << k % 8;
			}
			lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
			assert_int_equal(fusion.verdict, LP_RING_AGREES);
			assert_int_equal(fusion.wrong, hand);
			assert_false(fusion.scale_is_wrong);
			sum = sum_of(&fusion, view.count, &sigma);
			assert_float_equal(sum, truth, fminf(3.0F * sigma, 0.5F * truth));
		}
}

static void test_dead_sensors(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	unsigned int seed = 8;

	add_disc(room, 20.0F, 40.0F, 4.0F, 300.0F);
	struct lp_ring_sample sample = look(room, &none, &view, &seed);

	for (int k = 0; k < 5; k++)
		sample.illuminance_lux[k] = sample.sigma_relative[k] = NAN;
	lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
	assert_int_equal(fusion.verdict, LP_RING_AGREES);
	assert_true(fusion.excess[0] > 0.0F);
	for (int k = 5; k < LP_RING_SENSORS; k++)
		sample.illuminance_lux[k] = NAN;
	lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
	assert_int_equal(fusion.verdict, LP_RING_NO_READING);
	assert_float_equal(fusion.excess[0], 0.0F, 0.0F);
	assert_float_equal(fusion.scale.lux_per_unit, SCALE, 0.0F);
}

/* Mounted 45 degrees off: said, and read as if it were. */
static void test_a_turned_ring_is_found(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	unsigned int seed = 9;

	add_disc(room, 20.0F, 40.0F, 4.0F, 300.0F);
	add_disc(room, 100.0F, 10.0F, 4.0F, 100.0F);
	for (int places = -3; places <= 4; places++) {
		struct lp_ring_view view;
		struct lp_ring_fusion fusion;
		const struct lp_ring_sample straight = look(room, &none, &view, &seed);
		const struct lp_ring_sample sample = turned_by(&straight, places);

		lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
		if (places == 0) {
			assert_int_equal(fusion.verdict, LP_RING_AGREES);
			continue;
		}
		assert_int_equal(fusion.verdict, LP_RING_TURNED);
		assert_float_equal(fusion.turned_deg, 45.0F * (float)places, 0.0F);
		for (int j = 0; j < view.count; j++) {
			const float truth = true_excess(room, &room->parts->list[j]);

			assert_float_equal(fusion.excess[j], truth, 0.2F * truth);
		}
	}
}

static void test_noise_turns_with_its_sensor(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	unsigned int seed = 9;

	add_disc(room, 20.0F, 40.0F, 4.0F, 300.0F);
	add_disc(room, 100.0F, 10.0F, 4.0F, 100.0F);
	const struct lp_ring_sample straight = look(room, &none, &view, &seed);
	struct lp_ring_sample sample = turned_by(&straight, 2);

	sample.illuminance_lux[0] *= 0.2F;
	sample.noise_relative[0] = 5.0F;
	lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
	assert_int_equal(fusion.verdict, LP_RING_TURNED);
	for (int j = 0; j < view.count; j++) {
		const float truth = true_excess(room, &room->parts->list[j]);

		assert_float_equal(fusion.excess[j], truth, 0.2F * truth);
	}
}

static void test_a_ring_elsewhere_is_not_believed(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	const float elsewhere[LP_RING_SENSORS] = {100, 900, 40, 2000, 10, 700, 300, 5, 60};
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	unsigned int seed = 10;

	add_disc(room, 20.0F, 40.0F, 4.0F, 300.0F);
	struct lp_ring_sample sample = look(room, &none, &view, &seed);

	memcpy(sample.illuminance_lux, elsewhere, sizeof(elsewhere));
	lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
	assert_int_equal(fusion.verdict, LP_RING_DISAGREES);
	assert_float_equal(fusion.excess[0], 0.0F, 0.0F);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_without_clipping_the_scale_is_found),
		TEST(test_a_wrong_scale_is_found),
		TEST(test_a_wrong_scale_or_hidden_light),
		TEST(test_many_strong_lamps_are_no_wrong_scale),
		TEST(test_a_turned_ring_is_not_taken_for_light),
		TEST(test_a_wrong_sensor_is_left_out),
		TEST(test_a_hand_before_neighbours),
		TEST(test_dead_sensors),
		TEST(test_a_turned_ring_is_found),
		TEST(test_noise_turns_with_its_sensor),
		TEST(test_a_ring_elsewhere_is_not_believed),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
