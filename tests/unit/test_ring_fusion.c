/* SPDX-License-Identifier: Apache-2.0 */
/* What the ring of light sensors finds of clipped light, and how it bears wrong sensors. */
#include "light/ring_fusion.h"

#include <math.h>
#include <stdlib.h>

#include "include/luminance.h"
#include "include/panorama.h"
#include "light/grid.h"
#include "light/rotation.h"
#include "lp_test.h"

#define WIDTH 120
#define HEIGHT 60
#define CELLS (WIDTH * HEIGHT)
#define SIGMA 0.03F
#define SCALE 250.0F
#define TRIALS 200

static const struct lp_ring_scale known = {SCALE, 0.02F};
static const struct lp_ring_scale unknown = {NAN, NAN};

/* A room of radiance 1 above and 0.5 below, and clipped discs; what they truly hold is beside. */
struct room {
	struct lp_grid *grid;
	struct lp_panorama seen, truth;
	struct lp_clipped_parts *parts;
	float (*seen_cells)[4], (*true_cells)[4];
	uint8_t *flags;
};

static void set(float cell[4], float luminance)
{
	for (int c = 0; c < 4; c++)
		cell[c] = luminance;
}

static int set_up(void **state)
{
	struct room *room = calloc(1, sizeof(*room));

	assert_non_null(room);
	assert_int_equal(lp_grid_create(WIDTH, HEIGHT, &room->grid), 0);
	assert_int_equal(lp_clipped_parts_create(room->grid, &room->parts), 0);
	room->seen_cells = calloc(CELLS, sizeof(*room->seen_cells));
	room->true_cells = calloc(CELLS, sizeof(*room->true_cells));
	room->flags = calloc(CELLS, 1);
	for (int i = 0; i < CELLS; i++) {
		set(room->seen_cells[i], i < CELLS / 2 ? 1.0F : 0.5F);
		set(room->true_cells[i], i < CELLS / 2 ? 1.0F : 0.5F);
	}
	room->seen = (struct lp_panorama){.width = WIDTH,
					  .height = HEIGHT,
					  .cells = room->seen_cells,
					  .flags = room->flags};
	room->truth = room->seen;
	room->truth.cells = room->true_cells;
	*state = room;
	return 0;
}

static int tear_down(void **state)
{
	struct room *room = *state;

	free(room->flags);
	free(room->true_cells);
	free(room->seen_cells);
	lp_clipped_parts_destroy(room->parts);
	lp_grid_destroy(room->grid);
	free(room);
	return 0;
}

/* A disc that clips at radiance 4, and in truth has `radiance`. */
static void add_disc(struct room *room, float azimuth_deg, float elevation_deg, float radius_deg,
		     float radiance)
{
	const float rad = (float)M_PI / 180.0F;
	const float a = azimuth_deg * rad, e = elevation_deg * rad;
	const float centre[3] = {cosf(e) * sinf(a), sinf(e), -cosf(e) * cosf(a)};

	for (int i = 0; i < CELLS; i++) {
		float d[3];

		lp_grid_direction(room->grid, i, d);
		if (d[0] * centre[0] + d[1] * centre[1] + d[2] * centre[2] < cosf(radius_deg * rad))
			continue;
		set(room->seen_cells[i], 4.0F);
		set(room->true_cells[i], radiance);
		room->flags[i] = LP_CELL_CLIPPED;
	}
}

static float gauss(unsigned int *seed)
{
	float sum = -6.0F;

	for (int i = 0; i < 12; i++)
		sum += (float)rand_r(seed) / (float)RAND_MAX;
	return sum;
}

/* What a ring with these seats would read, and what the camera sees. */
static struct lp_ring_sample look_from_with(struct room *room, const struct lp_rotation *rotation,
					    struct lp_ring_sample sample, float sigma,
					    struct lp_ring_view *view, unsigned int *seed)
{
	struct lp_ring_view truth;

	lp_clipped_parts_clear(room->parts);
	lp_clipped_parts_find(room->parts, &room->seen);
	lp_ring_view_init(&truth, room->grid, &room->truth, room->parts, rotation, &sample,
			  LP_LUMINANCE);
	lp_ring_view_init(view, room->grid, &room->seen, room->parts, rotation, &sample,
			  LP_LUMINANCE);
	view->seen_sigma = 0.01F;
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		sample.illuminance_lux[k] = SCALE * truth.seen[k] * (1.0F + sigma * gauss(seed));
		sample.sigma_relative[k] = sigma;
	}
	return sample;
}

static struct lp_ring_sample look_from(struct room *room, const struct lp_rotation *rotation,
				       struct lp_ring_sample sample, struct lp_ring_view *view,
				       unsigned int *seed)
{
	return look_from_with(room, rotation, sample, SIGMA, view, seed);
}

static struct lp_ring_sample look_with(struct room *room, const struct lp_rotation *rotation,
				       float sigma, struct lp_ring_view *view, unsigned int *seed)
{
	return look_from_with(room, rotation, (struct lp_ring_sample){0}, sigma, view, seed);
}

static struct lp_ring_sample look(struct room *room, const struct lp_rotation *rotation,
				  struct lp_ring_view *view, unsigned int *seed)
{
	return look_from(room, rotation, (struct lp_ring_sample){0}, view, seed);
}

static float true_excess(const struct room *room, const struct lp_clipped_part *part)
{
	float sum = 0.0F;

	for (int i = part->first; i < part->first + part->count; i++) {
		const int cell = room->parts->cells[i];

		sum += lp_grid_solid_angle_sr(room->grid, cell) *
		       (room->true_cells[cell][LP_LUMINANCE] -
			room->seen_cells[cell][LP_LUMINANCE]);
	}
	return sum;
}

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

/* Readings from all around, each a second older than the one before. */
static void look_around(struct room *room, struct lp_ring_past *past, unsigned int *seed)
{
	past->count = LP_RING_POSES - 1;
	for (int p = 0; p < past->count; p++) {
		const double yaw[3] = {0.0, 2.0 * M_PI * (p + 1) / LP_RING_POSES, 0.0};
		const struct lp_rotation turned = lp_rotation_of_vector(yaw);

		past->list[p].sample = look(room, &turned, &past->list[p].view, seed);
		past->list[p].age_s = (float)(p + 1);
	}
}

/* Two lamps that one look hardly tells apart. */
static void test_a_turn_tells_lamps_apart(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	double alone = 0.0, with_past = 0.0;
	int within_3 = 0;
	unsigned int seed = 11;

	add_disc(room, 20.0F, 30.0F, 2.0F, 900.0F);
	add_disc(room, 50.0F, 10.0F, 2.0F, 300.0F);
	for (int trial = 0; trial < TRIALS; trial++) {
		struct lp_ring_past past;
		struct lp_ring_view view;
		struct lp_ring_fusion fusion;

		look_around(room, &past, &seed);
		const struct lp_ring_sample sample = look(room, &none, &view, &seed);
		const float truth = true_excess(room, &room->parts->list[0]);

		lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
		alone += pow(fusion.excess[0] - truth, 2.0);
		lp_ring_fuse(&view, &sample, &past, &known, &fusion);
		assert_false(fusion.changed);
		with_past += pow(fusion.excess[0] - truth, 2.0);
		within_3 += fabsf(fusion.excess[0] - truth) < 3.0F * fusion.sigma[0];
	}
	assert_true(with_past < 0.25 * alone);
	assert_true(within_3 >= TRIALS * 98 / 100);
}

static void test_other_light_is_not_averaged(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_past past;
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	unsigned int seed = 12;

	add_disc(room, 20.0F, 30.0F, 2.0F, 900.0F);
	look_around(room, &past, &seed);
	add_disc(room, 20.0F, 30.0F, 2.0F, 600.0F);
	const struct lp_ring_sample sample = look(room, &none, &view, &seed);
	const float truth = true_excess(room, &room->parts->list[0]);

	lp_ring_fuse(&view, &sample, &past, &known, &fusion);
	assert_true(fusion.changed);
	assert_float_equal(fusion.excess[0], truth, 0.1F * truth);
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
		struct lp_ring_sample sample = straight;
		const float truth = true_sum(room);
		float sigma;

		for (int k = 0; k < 8; k++)
			sample.illuminance_lux[k] = straight.illuminance_lux[(k + 1) % 8];
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
		struct lp_ring_sample sample = straight;

		for (int k = 0; k < 8;
		     k++) /* a sensor turned to the right looks at the next place */
			sample.illuminance_lux[k] = straight.illuminance_lux[(k + places + 8) % 8];
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

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_sums_are_exact),
		TEST(test_a_clipped_lamp_is_found),
		TEST(test_seats_turn_right_and_up),
		TEST(test_known_seats_find_the_lamp),
		TEST(test_two_lamps_are_told_apart),
		TEST(test_a_turn_tells_lamps_apart),
		TEST(test_other_light_is_not_averaged),
		TEST(test_noise_is_not_light),
		TEST(test_without_clipping_the_scale_is_found),
		TEST(test_a_wrong_scale_is_found),
		TEST(test_a_wrong_scale_or_hidden_light),
		TEST(test_many_strong_lamps_are_no_wrong_scale),
		TEST(test_a_turned_ring_is_not_taken_for_light),
		TEST(test_a_wrong_sensor_is_left_out),
		TEST(test_a_hand_before_neighbours),
		TEST(test_dead_sensors),
		TEST(test_a_turned_ring_is_found),
		TEST(test_a_ring_elsewhere_is_not_believed),
		TEST(test_darkness),
		TEST(test_a_sun_in_a_white_sky),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
