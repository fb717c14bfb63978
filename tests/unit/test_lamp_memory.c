/* SPDX-License-Identifier: Apache-2.0 */
/* Lamps over time: ids, what was measured of them, and what clipping and absence leave. */
#include "light/lamps/lamp_memory.h"

#include <math.h>
#include <stdlib.h>

#include "include/light_estimate.h"
#include "include/luminance.h"
#include "light/math/rotation.h"
#include "lp_test.h"

static const struct lp_memory_times frame = {.elapsed_s = 1.0F / 30.0F};

static struct lp_lamp_sighting sighting(float azimuth_deg, float strength)
{
	const float a = azimuth_deg * (float)M_PI / 180.0F;
	struct lp_lamp lamp = {.direction = {sinf(a), 0.0F, -cosf(a)},
			       .irradiance = {strength, strength, strength, strength},
			       .solid_angle_sr = 1e-3F,
			       .direction_sigma_deg = 0.05F,
			       .peak = 100.0F};

	memcpy(lamp.centroid, lamp.direction, sizeof(lamp.centroid));
	return (struct lp_lamp_sighting){.on_grid = lamp,
					 .pixels = lamp,
					 .refined = true,
					 .enters = true,
					 .strength_sigma = 0.02F,
					 .scale = 1.0F};
}

static float angle_deg(const float a[3], const float b[3])
{
	const float chord = hypotf(hypotf(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);

	return chord * 180.0F / (float)M_PI;
}

static const struct lp_remembered_lamp *only(const struct lp_lamp_memory *memory)
{
	const struct lp_remembered_lamp *found = NULL;

	for (int p = 0; p < LP_MAX_LAMPS; p++)
		if (memory->list[p].id) {
			assert_null(found);
			found = &memory->list[p];
		}
	assert_non_null(found);
	return found;
}

static uint32_t id_near(const struct lp_lamp_memory *memory, const struct lp_lamp *lamp)
{
	uint32_t id = 0;
	float best = -1.0F;

	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		const float *d = memory->list[p].lamp.direction;
		const float near = d[0] * lamp->direction[0] + d[1] * lamp->direction[1] +
				   d[2] * lamp->direction[2];

		if (memory->list[p].id && near > best) {
			best = near;
			id = memory->list[p].id;
		}
	}
	return id;
}

static void test_ids_follow_the_lamps(void **state)
{
	struct lp_lamp_memory memory = {0};
	uint32_t first = 0, second = 0;

	(void)state;
	for (int n = 0; n < 600; n++) { /* two lamps move past each other's first place */
		const float turn = (float)n * 0.3F;
		struct lp_lamp_sighting s[2] = {sighting(turn, 5.0F), sighting(turn + 40.0F, 4.0F)};

		if (n % 2) { /* the detector's order may change */
			const struct lp_lamp_sighting swap = s[0];
			s[0] = s[1];
			s[1] = swap;
		}
		lp_lamp_memory_update(&memory, s, 2, &frame);
		if (n == 0) {
			first = id_near(&memory, &s[0].on_grid);
			second = id_near(&memory, &s[1].on_grid);
			assert_true(first && second && first != second);
		}
		assert_int_equal(id_near(&memory, &s[n % 2].on_grid), first);
		assert_int_equal(id_near(&memory, &s[1 - n % 2].on_grid), second);
	}
}

/* Who walks before a lamp hides it from one side to the other: of what was seen last and what is
 * seen first each is a rim. */
static void test_a_lamp_that_comes_out_on_the_other_side_is_the_same(void **state)
{
	struct lp_lamp_memory memory = {0};
	struct lp_lamp_sighting whole = sighting(0.0F, 5.0F), rim = sighting(2.6F, 0.5F);

	(void)state;
	whole.on_grid.solid_angle_sr = whole.pixels.solid_angle_sr = 0.012F; /* 7 degrees */
	for (int n = 0; n < 90; n++)
		lp_lamp_memory_update(&memory, &whole, 1, &frame);
	lp_lamp_memory_update(&memory, &rim, 1, &frame);
	for (int n = 0; n < 12; n++)
		lp_lamp_memory_update(&memory, NULL, 0, &frame);
	rim = sighting(-2.6F, 0.5F);
	lp_lamp_memory_update(&memory, &rim, 1, &frame);
	assert_int_equal(only(&memory)->id, 1);
	assert_true(only(&memory)->seen);
	for (int n = 0; n < 12; n++)
		lp_lamp_memory_update(&memory, NULL, 0, &frame);
	rim = sighting(7.0F, 0.5F); /* beside it */
	lp_lamp_memory_update(&memory, &rim, 1, &frame);
	assert_int_equal(memory.last_id, 2);
}

/* A lamp that is measured in one exposure and clipped in the next two keeps what was measured. */
static void test_clipping_takes_nothing_away(void **state)
{
	struct lp_lamp_memory memory = {0};

	(void)state;
	for (int n = 0; n < 90; n++) {
		struct lp_lamp_sighting s = sighting(10.0F, 50.0F);

		if (n % 3) {
			s.pixels = sighting(10.5F, 0.2F).pixels; /* a lower bound */
			s.pixels.flags = LP_LIGHT_CLIPPED;
			s.scale = 0.004F; /* of a longer exposure */
		}
		lp_lamp_memory_update(&memory, &s, 1, &frame);
		assert_float_equal(only(&memory)->lamp.irradiance[0], 50.0F, 0.01F);
		assert_false(only(&memory)->lamp.flags & LP_LIGHT_CLIPPED);
		assert_true(only(&memory)->measured);
	}
	assert_true(only(&memory)->lamp.direction_sigma_deg < 0.06F);
}

/* Clipped in every exposure: the largest lower bound, whatever the order. */
static void test_the_largest_bound_counts(void **state)
{
	const float bounds[] = {0.2F, 3.0F, 1.0F};
	struct lp_lamp_memory memory = {0};

	(void)state;
	for (int n = 0; n < 30; n++) {
		struct lp_lamp_sighting s = sighting(10.0F, 3.0F);

		s.pixels = sighting(10.0F, bounds[n % 3]).pixels;
		s.pixels.flags = LP_LIGHT_CLIPPED;
		lp_lamp_memory_update(&memory, &s, 1, &frame);
		if (n > 0)
			assert_float_equal(only(&memory)->lamp.irradiance[0], 3.0F, 1e-6F);
		assert_true(only(&memory)->lamp.flags & LP_LIGHT_CLIPPED);
	}
}

/* Some frames clip it, others do not look closer: as long as one says the bound again, it is not
 * too old. */
static void test_a_bound_that_is_said_again_stays(void **state)
{
	struct lp_lamp_memory memory = {0};

	(void)state;
	for (int n = 0; n < 1200; n++) {
		struct lp_lamp_sighting s = sighting(10.0F, 2.5F);

		s.refined = n % 3 == 0;
		s.pixels = sighting(10.0F, 3.0F).pixels;
		s.pixels.flags = s.refined ? LP_LIGHT_CLIPPED : 0;
		lp_lamp_memory_update(&memory, &s, 1, &frame);
		assert_float_equal(only(&memory)->lamp.irradiance[0], 3.0F, 1e-6F);
		assert_true(only(&memory)->lamp.flags & LP_LIGHT_CLIPPED);
	}
}

/* A bound by one frame's pixels is no more than that: the panorama knows the lamp better. */
static void test_a_bound_below_the_panorama_does_not_stay(void **state)
{
	struct lp_lamp_memory memory = {0};

	(void)state;
	for (int n = 0; n < 6; n++) {
		struct lp_lamp_sighting s = sighting(10.0F, 6.0F);

		s.refined = n % 3 == 0;
		s.pixels = sighting(10.0F, 5.0F).pixels;
		s.pixels.flags = LP_LIGHT_CLIPPED;
		lp_lamp_memory_update(&memory, &s, 1, &frame);
		if (n)
			assert_float_equal(only(&memory)->lamp.irradiance[LP_LUMINANCE], 6, 1e-6);
	}
}

/* A few clipped pixels do not show in a panorama: what it shows of the lamp is a bound, too, until
 * a shorter exposure says nothing of clipping. */
static void test_what_a_panorama_shows_of_a_clipped_lamp_is_a_bound(void **state)
{
	struct lp_lamp_memory memory = {0};
	struct lp_lamp_sighting s = sighting(10.0F, 3.0F);

	(void)state;
	s.pixels.flags = LP_LIGHT_CLIPPED;
	lp_lamp_memory_update(&memory, &s, 1, &frame);
	s = sighting(10.0F, 6.0F);
	s.refined = false;
	for (int n = 0; n < 1200; n++) {
		lp_lamp_memory_update(&memory, &s, 1, &frame);
		assert_true(only(&memory)->lamp.flags & LP_LIGHT_CLIPPED);
	}
	assert_float_equal(only(&memory)->lamp.irradiance[0], 6.0F, 1e-6F);
	s.scale = 10.0F;
	s.on_grid = sighting(10.0F, 20.0F).on_grid;
	lp_lamp_memory_update(&memory, &s, 1, &frame);
	assert_float_equal(only(&memory)->lamp.irradiance[0], 20.0F, 1e-6F);
	assert_false(only(&memory)->lamp.flags & LP_LIGHT_CLIPPED);
}

/* Within a lamp there is no other as bright as it: it would be a piece of it. A brighter one, as a
 * bulb in its shade, is one; so is one beside it. */
static void test_pieces_of_a_lamp_are_no_lamps(void **state)
{
	const struct {
		float azimuth_deg, strength;
		int lamps;
	} cases[] = {{11.5F, 5.0F, 1}, {11.5F, 9.0F, 2}, {14.5F, 5.0F, 2}};

	(void)state;
	for (size_t k = 0; k < sizeof(cases) / sizeof(*cases); k++) {
		struct lp_lamp_sighting s[2] = {sighting(10.0F, 20.0F),
						sighting(cases[k].azimuth_deg, cases[k].strength)};
		struct lp_lamp_memory memory = {0};
		int count = 0;

		for (int n = 0; n < 2; n++) {
			s[0].on_grid.solid_angle_sr = s[0].pixels.solid_angle_sr =
				4e-3F; /* 2 deg */
			s[n].pixels.flags = LP_LIGHT_CLIPPED;
		}
		lp_lamp_memory_update(&memory, s, 2, &frame);
		lp_lamp_memory_update(&memory, s, 2, &frame);
		for (int p = 0; p < LP_MAX_LAMPS; p++)
			count += memory.list[p].id != 0;
		assert_int_equal(count, cases[k].lamps);
	}
}

/* A sun within a glow that clips like it: the picture shows both equally bright, the ring does not.
 */
static void test_a_lamp_that_the_ring_knows_is_no_piece_of_its_glow(void **state)
{
	(void)state;
	for (int known = 0; known < 2; known++) {
		struct lp_lamp_sighting s[2] = {sighting(14.5F, 5.0F), sighting(10.0F, 20.0F)};
		struct lp_lamp_memory memory = {0};
		int count = 0;

		s[1].on_grid.solid_angle_sr = s[1].pixels.solid_angle_sr = 4e-3F; /* 2 degrees */
		s[0].pixels.flags = s[1].pixels.flags = LP_LIGHT_CLIPPED;
		lp_lamp_memory_update(&memory, s, 2, &frame);
		s[1].on_grid.solid_angle_sr = s[1].pixels.solid_angle_sr = 4e-2F; /* 6 degrees */
		s[1].on_grid.irradiance[LP_LUMINANCE] = s[1].pixels.irradiance[LP_LUMINANCE] =
			200.0F;
		for (int n = 0; n < 2; n++) {
			memory.list[0].recovered[LP_LUMINANCE] = known ? 500.0F : 0.0F;
			lp_lamp_memory_update(&memory, s, 2, &frame);
		}
		for (int p = 0; p < LP_MAX_LAMPS; p++)
			count += memory.list[p].id != 0;
		assert_int_equal(count, known ? 2 : 1);
	}
}

/* Near the border of a lamp noise makes another come into it and leave it. Once known as a lamp it
 * stays one; what lies well within it does not become one. */
static void test_a_lamp_near_another_does_not_come_and_go(void **state)
{
	(void)state;
	for (int known = 0; known < 2; known++) {
		struct lp_lamp_memory memory = {0};
		uint32_t id = 0;

		for (int n = 0; n < 60; n++) {
			/* of a radius of 2.04 degrees */
			const float aside_deg = n % 2 ? 1.9F : known ? 2.2F : 1.7F;
			struct lp_lamp_sighting s[2] = {sighting(10.0F, 20.0F),
							sighting(10.0F + aside_deg, 5.0F)};
			int count = 0;

			for (int k = 0; k < 2; k++) {
				s[k].pixels.flags = LP_LIGHT_CLIPPED;
				s[k].pixels.direction_sigma_deg = 1.0F;
			}
			s[0].on_grid.solid_angle_sr = s[0].pixels.solid_angle_sr = 4e-3F;
			lp_lamp_memory_update(&memory, s, 2, &frame);
			for (int p = 0; p < LP_MAX_LAMPS; p++)
				count += memory.list[p].id != 0;
			assert_int_equal(count, 1 + known);
			if (n == 0)
				id = memory.last_id;
			assert_int_equal(memory.last_id, id);
		}
	}
}

/* The anchor frame drifts while the camera turns. The shortest exposure tells where a lamp is that
 * clips in each; the glow in longer ones moves it. */
static void test_a_clipped_lamp_is_followed(void **state)
{
	static const float longer[] = {1.0F, 0.1F, 0.01F};
	struct lp_memory_times turning = frame;
	struct lp_lamp_memory memory = {0};

	(void)state;
	turning.rotation_sigma_rad = 0.05F * (float)M_PI / 180.0F;
	for (int n = 0; n < 300; n++) {
		struct lp_lamp_sighting s = sighting(0.005F * (float)n, 5.0F);
		const struct lp_lamp_sighting glowing = sighting(0.005F * (float)n + 1.0F, 1.0F);

		if (n % 3)
			memcpy(s.pixels.direction, glowing.pixels.direction,
			       sizeof(s.pixels.direction));
		for (int c = 0; c < 4; c++)
			s.pixels.irradiance[c] *= longer[n % 3] * (1.0F - 5e-4F * (float)n);
		s.pixels.flags = LP_LIGHT_CLIPPED;
		lp_lamp_memory_update(&memory, &s, 1, &turning);
		const struct lp_lamp *known = &only(&memory)->lamp;
		const struct lp_lamp_sighting true_one = sighting(0.005F * (float)n, 5.0F);
		const float off_deg = 180.0F / (float)M_PI *
				      hypotf(known->direction[0] - true_one.pixels.direction[0],
					     known->direction[2] - true_one.pixels.direction[2]);

		assert_true(off_deg < 0.1F);
		assert_true(off_deg < 3.0F * known->direction_sigma_deg);
	}
}

/* While the camera turns a small lamp falls on the pixels in another place each time. */
static void test_turning_is_no_flicker(void **state)
{
	const float rotation_sigma_rad[] = {0.0F, 0.05F * (float)M_PI / 180.0F};

	(void)state;
	for (int turns = 0; turns < 2; turns++) {
		struct lp_memory_times times = frame;
		struct lp_lamp_memory memory = {0};

		times.rotation_sigma_rad = rotation_sigma_rad[turns];
		for (int n = 0; n < 60; n++) {
			struct lp_lamp_sighting s = sighting(10.0F, n % 2 ? 5.3F : 4.7F);

			s.scale = 10000.0F;
			lp_lamp_memory_update(&memory, &s, 1, &times);
		}
		assert_true((lp_lamp_memory_flicker(&memory) > 0.0F) == (turns == 0));
	}
}

/* Its light may be anywhere in a wide plateau: 0.2 of the radius, however often it is seen. */
static void test_a_wide_plateau_is_no_place(void **state)
{
	const float radius = 4.0F * (float)M_PI / 180.0F;
	struct lp_lamp_memory memory = {0};

	(void)state;
	for (int n = 0; n < 60; n++) {
		struct lp_lamp_sighting s = sighting(10.0F, 3.0F);

		s.pixels.flags = LP_LIGHT_CLIPPED;
		s.pixels.solid_angle_sr = (float)M_PI * radius * radius;
		lp_lamp_memory_update(&memory, &s, 1, &frame);
	}
	assert_float_equal(only(&memory)->lamp.direction_sigma_deg, 0.8F, 0.1F);
	for (int n = 0; n < 10; n++) { /* until an exposure shows it */
		const struct lp_lamp_sighting s = sighting(10.0F, 3.0F);

		lp_lamp_memory_update(&memory, &s, 1, &frame);
	}
	assert_true(only(&memory)->lamp.direction_sigma_deg < 0.1F);
}

/* What is not measured any more becomes uncertain, and in the end the panorama is asked. */
static void test_old_measurements_fade(void **state)
{
	struct lp_lamp_memory memory = {0};
	struct lp_lamp_sighting s = sighting(10.0F, 50.0F);
	float before;

	(void)state;
	lp_lamp_memory_update(&memory, &s, 1, &frame);
	before = only(&memory)->strength_variance;
	s.refined = false;
	s.on_grid.irradiance[LP_LUMINANCE] = 45.0F;
	for (int n = 0; n < 300; n++) {
		lp_lamp_memory_update(&memory, &s, 1, &frame);
		if (!only(&memory)->measured)
			break;
		assert_true(only(&memory)->strength_variance > before);
		before = only(&memory)->strength_variance;
	}
	assert_float_equal(only(&memory)->lamp.irradiance[LP_LUMINANCE], 45.0F, 0.0F);
}

/* Nobody knows how a film stands: what it takes off the axis is the same in every frame. The mean
 * of many is as uncertain as each, and one at a known angle says more. */
static void test_a_film_at_an_unknown_angle_errs_alike_in_all_frames(void **state)
{
	const struct lp_film film = lp_film_of_one_sheet(0.84F, 500.0F, 1.5F);
	const struct lp_rotation none = lp_rotation_identity();
	const struct lp_film_view unknown = lp_film_seen(&film, NAN, &none);
	struct lp_lamp_sighting s = sighting(70.0F, 50.0F);
	struct lp_lamp_memory memory = {0};

	(void)state;
	s.film = lp_film_pass(&unknown, s.pixels.direction);
	assert_true(s.film.gain_sigma > 0.15F);
	for (int n = 0; n < 100; n++)
		lp_lamp_memory_update(&memory, &s, 1, &frame);
	assert_true(sqrtf(only(&memory)->strength_variance) >= s.film.gain_sigma);
	s.film = (struct lp_film_pass){.gain = 1.0F};
	lp_lamp_memory_update(&memory, &s, 1, &frame);
	assert_true(sqrtf(only(&memory)->strength_variance) < 0.03F);
}

/* A lamp that is dimmed is followed in the frame that shows it, and noise is averaged. */
static void test_changes_and_noise(void **state)
{
	struct lp_lamp_memory memory = {0};
	double square = 0.0;

	(void)state;
	srand(1);
	for (int n = 0; n < 300; n++) {
		struct lp_lamp_sighting s = sighting(10.0F, 50.0F);
		const float error = 0.02F * 3.46F * ((float)rand() / (float)RAND_MAX - 0.5F);

		for (int c = 0; c < 4; c++)
			s.pixels.irradiance[c] *= 1.0F + error;
		lp_lamp_memory_update(&memory, &s, 1, &frame);
		if (n >= 100)
			square += pow(only(&memory)->lamp.irradiance[0] / 50.0 - 1.0, 2.0) / 200.0;
	}
	assert_true(sqrt(square) < 0.016);
	struct lp_lamp_sighting dimmed = sighting(10.0F, 20.0F);

	lp_lamp_memory_update(&memory, &dimmed, 1, &frame);
	assert_float_equal(only(&memory)->lamp.irradiance[0], 20.0F, 1e-4F);
}

/* Too faint to become a lamp, strong enough to stay one. */
static void test_entering_is_harder_than_staying(void **state)
{
	struct lp_lamp_memory memory = {0};
	struct lp_lamp_sighting faint = sighting(10.0F, 1.0F), clear = faint;

	(void)state;
	faint.enters = false;
	lp_lamp_memory_update(&memory, &faint, 1, &frame);
	assert_int_equal(memory.last_id, 0);
	lp_lamp_memory_update(&memory, &clear, 1, &frame);
	for (int n = 0; n < 100; n++)
		lp_lamp_memory_update(&memory, &faint, 1, &frame);
	assert_int_equal(only(&memory)->id, 1);
	assert_true(only(&memory)->seen);
}

static void test_absence(void **state)
{
	struct lp_lamp_memory memory = {0};
	struct lp_lamp_sighting s = sighting(10.0F, 1.0F);

	(void)state;
	s.came = 1.0F;
	lp_lamp_memory_update(&memory, &s, 1, &frame);
	for (int n = 0; n < 100; n++) /* seconds: the id stays */
		lp_lamp_memory_update(&memory, NULL, 0, &frame);
	assert_false(only(&memory)->seen);
	lp_lamp_memory_update(&memory, &s, 1, &frame);
	assert_int_equal(only(&memory)->id, 1);
	for (int n = 0; n < 150; n++)
		lp_lamp_memory_update(&memory, NULL, 0, &frame);
	lp_lamp_memory_update(&memory, &s, 1, &frame);
	assert_int_equal(only(&memory)->id, 2);
}

/* What the ring tells of a clipped lamp, now and then, does not move it up and down a list. */
static void test_a_lamp_that_the_ring_knows_hides_less_by_and_by(void **state)
{
	struct lp_lamp_memory memory = {0};
	struct lp_lamp_sighting seen = sighting(0, 10);
	float before;

	(void)state;
	seen.pixels.flags = LP_LIGHT_CLIPPED;
	for (int n = 0; n < 60; n++)
		lp_lamp_memory_update(&memory, &seen, 1, &frame);
	before = only(&memory)->hidden;
	assert_true(before > 1.0F);
	memory.list[0].recovered_sigma = 1.0F; /* by one frame */
	lp_lamp_memory_update(&memory, &seen, 1, &frame);
	assert_true(only(&memory)->hidden < before && only(&memory)->hidden > 0.9F * before);
	for (int n = 0; n < 90; n++)
		lp_lamp_memory_update(&memory, &seen, 1, &frame);
	assert_true(only(&memory)->hidden < 0.1F * before);
}

/* A small one that clips shines on for the one frame that does not show it; no other one does. */
static void test_a_clipped_lamp_may_be_hidden_for_a_frame(void **state)
{
	(void)state;
	for (int k = 0; k < 3; k++) {
		struct lp_lamp_memory memory = {0};
		struct lp_lamp_sighting seen = sighting(0, 10);

		seen.pixels.flags = k ? LP_LIGHT_CLIPPED : 0;
		seen.pixels.solid_angle_sr = k == 2 ? 1e-3F : 1e-4F;
		for (int round = 0; round < 3; round++) {
			lp_lamp_memory_update(&memory, &seen, 1, &frame);
			lp_lamp_memory_update(&memory, &seen, 1, &frame);
			assert_false(lp_lamp_may_be_hidden(only(&memory)));
			lp_lamp_memory_update(&memory, NULL, 0, &frame);
			assert_int_equal(lp_lamp_may_be_hidden(only(&memory)), k == 1);
			lp_lamp_memory_update(&memory, NULL, 0, &frame);
			assert_false(lp_lamp_may_be_hidden(only(&memory)));
		}
	}
}

/* A lamp that moves steadily is followed with an error that its sigma covers; noise alone is not
 * taken for a move. */
static void test_a_lamp_that_moves_is_followed(void **state)
{
	const float noise_deg[] = {0.03F, -0.05F, 0.06F, -0.02F, -0.04F, 0.01F};
	const float speeds_deg_s[] = {0.0F, 0.5F, 3.0F};

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(speeds_deg_s); k++) {
		struct lp_lamp_memory memory = {0};

		for (int n = 0; n < 300; n++) {
			const float at_deg = speeds_deg_s[k] * (float)n / 30.0F;
			const struct lp_lamp_sighting truth = sighting(at_deg, 10);
			const struct lp_lamp_sighting seen =
				sighting(at_deg + noise_deg[n % 6], 10);

			lp_lamp_memory_update(&memory, &seen, 1, &frame);
			const struct lp_lamp *lamp = &only(&memory)->lamp;
			const float error_deg = angle_deg(lamp->direction, truth.on_grid.direction);

			if (n > 30)
				assert_true(error_deg < 3.0F * lamp->direction_sigma_deg);
			if (n > 30 && k == 0)
				assert_true(error_deg < 0.02F);
		}
	}
}

/* As many as there is room for jump to and fro: new ones do not drive out what is more likely. Once
 * they stand still all are known. */
static void test_crowds(void **state)
{
	struct lp_lamp_memory memory = {0};
	struct lp_lamp_sighting s[LP_MAX_LAMPS];

	(void)state;
	for (int n = 0; n < 250; n++) {
		const float aside_deg = n < 50 ? 5.0F * (float)(n % 2) : 0.0F;

		for (int k = 0; k < LP_MAX_LAMPS; k++)
			s[k] = sighting(11.25F * (float)k + aside_deg, 1.0F + (float)k);
		lp_lamp_memory_update(&memory, s, LP_MAX_LAMPS, &frame);
		for (int k = 0; k < LP_MAX_LAMPS; k++)
			assert_true(memory.list[k].id != 0);
	}
	for (int k = 0; k < LP_MAX_LAMPS; k++)
		assert_true(memory.list[k].seen);
}

/* A lamp that is certain is missed for a moment, while there are more new things than places: it
 * keeps its place. */
static void test_what_is_certain_is_not_driven_out(void **state)
{
	struct lp_lamp_memory memory = {.clutter = {.age_s = 1000.0F}};
	struct lp_lamp_sighting s[LP_MAX_LAMPS + 1];

	(void)state;
	for (int n = 0; n < 40; n++) {
		const bool is_missed = n >= 20 && n < 30;

		for (int k = 0; k <= LP_MAX_LAMPS; k++)
			s[k] = sighting(10.5F * (float)k, 1.0F);
		s[0].came = n == 0 ? 1.0F : 0.0F;
		lp_lamp_memory_update(&memory, s + is_missed, LP_MAX_LAMPS, &frame);
		assert_int_equal(memory.list[0].id, 1);
		assert_int_equal(memory.list[0].seen, !is_missed);
	}
}

/* A camera that is taken to look half a degree off sees all lamps half a degree off: that is told.
 * A lamp that has been carried away is left out. */
static void test_lamps_are_landmarks(void **state)
{
	const double off[3] = {0.002, 0.008, -0.003};
	const struct lp_rotation turn = lp_rotation_of_vector(off);
	struct lp_lamp_memory memory = {0};
	struct lp_lamp_sighting s[4];
	double pull[3], information[3][3];

	(void)state;
	for (int k = 0; k < 4; k++) {
		s[k] = sighting(80.0F * (float)k, 5.0F);
		s[k].pixels.direction[1] = 0.3F;
		for (int a = 0; a < 3; a++)
			s[k].pixels.direction[a] /= sqrtf(1.09F);
		s[k].on_grid = s[k].pixels;
	}
	lp_lamp_memory_update(&memory, s, 4, &frame);
	for (int k = 0; k < 4; k++)
		lp_rotate_direction(&turn, s[k].pixels.direction);
	s[3] = sighting(243.0F, 5.0F); /* three degrees from its place */
	assert_int_equal(lp_lamp_memory_landmarks(&memory, s, 4, 0.005F, pull, information), 3);
	for (int a = 0; a < 3; a++) { /* the turn back solves the equations */
		double sum = 0.0;

		for (int b = 0; b < 3; b++)
			sum -= information[a][b] * off[b];
		assert_float_equal(sum / information[a][a], pull[a] / information[a][a], 2e-5);
	}
	const double before = information[1][1];

	for (int k = 0; k < 4; k++) /* clipped lamps tell less: they glow */
		s[k].pixels.flags = LP_LIGHT_CLIPPED;
	assert_int_equal(lp_lamp_memory_landmarks(&memory, s, 4, 0.005F, pull, information), 3);
	assert_true(information[1][1] < 0.5 * before && information[1][1] > 0.05 * before);
	for (int k = 0; k < 4; k++) /* and those that are not looked at closer nothing */
		s[k].refined = false;
	assert_int_equal(lp_lamp_memory_landmarks(&memory, s, 4, 0.005F, pull, information), 0);
}

/* A lamp whose light came with it, at once or later, is beyond doubt; another one, long after the
 * first frame, is not yet. */
static void test_light_that_came_proves_a_lamp(void **state)
{
	static const struct {
		float came;
		int at; /* frames after it was found */
		bool is_certain;
	} cases[] = {{1.0F, 0, true}, {0.6F, 0, true}, {0.4F, 0, false}, {1.0F, 5, true}};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		struct lp_lamp_memory memory = {.clutter = {.age_s = 1000.0F}};

		for (int n = 0; n < 6; n++) {
			struct lp_lamp_sighting s = sighting(10.0F, 5.0F);

			s.came = n == cases[i].at ? cases[i].came : 0.0F;
			lp_lamp_memory_update(&memory, &s, 1, &frame);
			assert_int_equal(lp_exists(&only(&memory)->existence),
					 cases[i].is_certain && n >= cases[i].at);
		}
		assert_int_equal(only(&memory)->existence.was_certain, cases[i].is_certain);
	}
}

static void test_turning(void **state)
{
	const struct lp_rotation turn =
		lp_rotation_of_vector((const double[]){0.0, M_PI / 2.0, 0.0});
	struct lp_lamp_memory memory = {0};
	const struct lp_lamp_sighting s = sighting(0.0F, 1.0F); /* along -Z */

	(void)state;
	lp_lamp_memory_update(&memory, &s, 1, &frame);
	lp_lamp_memory_turn(&memory, &turn);
	assert_float_equal(only(&memory)->lamp.direction[0], -1.0F, 1e-6F);
	assert_float_equal(only(&memory)->on_grid.direction[0], -1.0F, 1e-6F);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_ids_follow_the_lamps),
		cmocka_unit_test(test_a_lamp_that_comes_out_on_the_other_side_is_the_same),
		cmocka_unit_test(test_clipping_takes_nothing_away),
		cmocka_unit_test(test_the_largest_bound_counts),
		cmocka_unit_test(test_a_bound_that_is_said_again_stays),
		cmocka_unit_test(test_a_bound_below_the_panorama_does_not_stay),
		cmocka_unit_test(test_what_a_panorama_shows_of_a_clipped_lamp_is_a_bound),
		cmocka_unit_test(test_pieces_of_a_lamp_are_no_lamps),
		cmocka_unit_test(test_a_lamp_that_the_ring_knows_is_no_piece_of_its_glow),
		cmocka_unit_test(test_a_lamp_near_another_does_not_come_and_go),
		cmocka_unit_test(test_a_clipped_lamp_is_followed),
		cmocka_unit_test(test_a_wide_plateau_is_no_place),
		cmocka_unit_test(test_turning_is_no_flicker),
		cmocka_unit_test(test_old_measurements_fade),
		cmocka_unit_test(test_a_film_at_an_unknown_angle_errs_alike_in_all_frames),
		cmocka_unit_test(test_changes_and_noise),
		cmocka_unit_test(test_entering_is_harder_than_staying),
		cmocka_unit_test(test_absence),
		cmocka_unit_test(test_a_lamp_that_the_ring_knows_hides_less_by_and_by),
		cmocka_unit_test(test_a_clipped_lamp_may_be_hidden_for_a_frame),
		cmocka_unit_test(test_a_lamp_that_moves_is_followed),
		cmocka_unit_test(test_crowds),
		cmocka_unit_test(test_what_is_certain_is_not_driven_out),
		cmocka_unit_test(test_lamps_are_landmarks),
		cmocka_unit_test(test_light_that_came_proves_a_lamp),
		cmocka_unit_test(test_turning),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
