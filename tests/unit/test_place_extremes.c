/* SPDX-License-Identifier: Apache-2.0 */
/* Places at their ends: lamps at 1 mm and 10^6 m, a probe that stands still, in a lamp or in a
 * wall, poses that are no numbers. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "figure.h"
#include "light/math/grid.h"
#include "light/place/box.h"
#include "light/place/coarse.h"
#include "light/place/parallax.h"
#include "light/place/room.h"
#include "light/place/room_worth.h"
#include "random_normal.h"

#define MANY 1000000
#define SKIPPED 100 /* so many frames for each that is seen */

static const double odd[] = {NAN, INFINITY, -INFINITY, 0.0, 1e-320, 1e-30, 1e30, 1e200, -1e200};

/* ---------------------------------------------------------------- lamps */

/* A head that goes to and fro before a lamp; the app errs by sigma_m. */
struct walk {
	double lamp_m[3], reach_m, sigma_m, sigma_rad;
	int sightings;
};

static struct lp_parallax watch(const struct walk *walk)
{
	struct lp_parallax p = {0};

	for (int n = 0; n < walk->sightings; n++) {
		const double t_s = n / 30.0;
		struct lp_probe_pose pose = {.t_ns = (int64_t)(t_s * 1e9) + 1,
					     .world = 1,
					     .rotation = lp_rotation_identity(),
					     .sigma_rad = walk->sigma_rad,
					     .sigma_m = walk->sigma_m};
		struct lp_parallax_sighting sighting = {.sigma_rad = (float)walk->sigma_rad};
		const double at_m[3] = {walk->reach_m * sin(1.1 * t_s),
					0.3 * walk->reach_m * sin(0.7 * t_s),
					walk->reach_m * sin(1.7 * t_s)};
		double toward[3], length = 0.0;

		for (int a = 0; a < 3; a++) {
			toward[a] = walk->lamp_m[a] - at_m[a];
			length += toward[a] * toward[a];
			pose.position_m[a] = at_m[a] + walk->sigma_m * (double)random_normal();
		}
		for (int a = 0; a < 3; a++)
			sighting.direction[a] =
				length > 0.0 ? (float)(toward[a] / sqrt(length)) : (float)(a == 1);
		lp_parallax_see(&p, &pose, &sighting);
	}
	return p;
}

/* Numbers, and if a distance is stated, one that is true by its sigma. Returns how many. */
static double assert_true_distance(const struct lp_parallax *p, const struct walk *walk)
{
	const struct lp_lamp_distance d = lp_parallax_distance(p);
	double here2 = 0.0;

	assert_false(isinf(d.distance_m));
	assert_true(isfinite(d.nearest_m) && d.nearest_m >= 0.0F);
	for (int a = 0; a < 3; a++)
		here2 += walk->lamp_m[a] * walk->lamp_m[a];
	const double truth_m = sqrt(here2), off_m = walk->reach_m * 2.0;

	if (d.nearest_m > 0.0F && (double)d.nearest_m > truth_m + off_m)
		fail_msg("a lamp at %g m is at least %g m away", truth_m, (double)d.nearest_m);
	if (isnan(d.distance_m))
		return 0.0;
	assert_true(d.distance_m > 0.0F && isfinite(d.sigma) && d.sigma > 0.0F);
	/* the probe has gone: the distance is from where it is now */
	return fmax(fabs((double)d.distance_m - truth_m) - off_m, 0.0) /
	       ((double)d.sigma * truth_m);
}

static void test_lamps_near_and_far(void **state)
{
	static const double distances_m[] = {0.0, 1e-3, 0.03, 0.3, 3.0, 1e3, 1e6, 1e12};
	static const double reaches_m[] = {0.0, 1e-4, 0.25, 1e3};
	double worst = 0.0;

	(void)state;
	for (int k = 0; k < 8; k++)
		for (int r = 0; r < 4; r++)
			for (int sigma = 0; sigma < 2; sigma++) {
				const double far_m = distances_m[k];
				const struct walk walk = {.lamp_m = {0.6 * far_m, 0.48 * far_m,
								     -0.64 * far_m},
							  .reach_m = reaches_m[r],
							  .sigma_m = sigma ? 0.005 : 1e-9,
							  .sigma_rad = sigma ? 2e-3 : 1e-7,
							  .sightings = 200};
				const struct lp_parallax p = watch(&walk);

				/* within the way nobody knows where the probe ends */
				worst = fmax(worst, assert_true_distance(&p, &walk));
			}
	figure("places: lamps", "0 … 1e12 m, way 0 … 1e3 m", "distance, sigmas", worst, 4.0);
}

static void test_odd_sightings(void **state)
{
	(void)state;
	for (size_t o = 0; o < LP_COUNT(odd); o++)
		for (int field = 0; field < 9; field++) {
			struct lp_parallax p = {0};
			struct lp_lamp_distance d;

			for (int n = 0; n < 300; n++) {
				const bool is_odd = n == 40;
				const double x = 0.3 * sin(0.04 * n);
				const double length = sqrt(x * x + 4.0);
				struct lp_probe_pose pose = {.t_ns = 1 + n * INT64_C(33000000),
							     .world = 1,
							     .rotation = lp_rotation_identity(),
							     .position_m = {x, 0.0, 0.0},
							     .sigma_rad = 1e-3,
							     .sigma_m = 1e-3};
				struct lp_parallax_sighting s = {
					.direction = {(float)(-x / length), 0.0F,
						      (float)(-2.0 / length)},
					.sigma_rad = 1e-3F,
					.irradiance = 1.0F,
					.radius_rad = 0.02F};

				if (is_odd) {
					double *const doubles[] = {&pose.position_m[0],
								   &pose.sigma_rad,
								   &pose.sigma_m,
								   &pose.late_sigma_s,
								   &pose.rate_rad_s[1],
								   &pose.velocity_m_s[2]};
					float *const floats[] = {&s.sigma_rad, &s.irradiance,
								 &s.direction[0]};

					if (field < 6)
						*doubles[field] = odd[o];
					else
						*floats[field - 6] = (float)odd[o];
				}
				lp_parallax_see(&p, &pose, &s);
				d = lp_parallax_distance(&p);
				assert_false(isinf(d.distance_m) || isnan(d.nearest_m));
				if (!isnan(d.distance_m))
					assert_true(isfinite(d.sigma) && d.sigma > 0.0F);
			}
			/* a wrong number that could be right makes it doubt; nonsense does not */
			const double told = field < 6 ? odd[o] : (double)(float)odd[o];
			const bool could_be = fabs(told) <= 1e9 && !(field == 8 && told != 0.0);

			if (could_be && isnan(d.distance_m))
				continue;
			if (isnan(d.distance_m) ||
			    fabs((double)d.distance_m - 2.0) > 3.0 * d.sigma * 2.0 + 0.1)
				fail_msg("field %d, %g: %g m", field, odd[o], (double)d.distance_m);
		}
}

/* A step towards a lamp, onto it and beyond. */
static void test_steps_onto_a_lamp(void **state)
{
	static const double inverses[] = {0.0, 1e-12, 1.0, 1e3, 1e30, NAN, INFINITY};

	(void)state;
	for (size_t k = 0; k < LP_COUNT(inverses); k++)
		for (size_t o = 0; o < LP_COUNT(odd); o++) {
			const double way_m[3] = {0.0, 0.0, odd[o]};
			float direction[3] = {0.0F, 0.0F, -1.0F};
			const double nearer = lp_nearer(way_m, inverses[k], direction);

			ASSERT_FINITE(direction);
			assert_float_equal(hypot(direction[1], direction[2]), 1.0, 1e-6);
			assert_true(isfinite(nearer) && nearer >= 0.0);
		}
}

/* ---------------------------------------------------------------- the box */

static void assert_unit_hit(const struct lp_box_view *view, const double along[3])
{
	const struct lp_box_hit hit = lp_box_hit(view, along);

	assert_true(hit.wall >= 0 && hit.wall < 6);
	for (int a = 0; a < 3; a++)
		assert_true(isfinite(hit.at_m[a]) && isfinite(hit.normal[a]));
	assert_true(hit.cosine > 0.0);
}

/* A box from 1 mm to 10^6 m, a probe in the middle, on a wall, in it and far outside. */
static void test_light_through_any_box(void **state)
{
	static const double sizes_m[] = {0.0, 1e-3, 2.0, 1e6};
	static const double places[] = {0.0, 0.5, 0.95, 1.0, 1.0000001, 50.0, -1e9};
	static double seen[LP_BOX_RAYS][LP_BOX_SH_COUNT];
	static struct lp_box_rays rays;
	double worst = 0.0;

	(void)state;
	lp_box_fill_rays(&rays);
	for (int s = 0; s < 4; s++)
		for (int thin = 0; thin < 3; thin++)
			for (int p = 0; p < 7; p++) {
				struct lp_box box = {.yaw_rad = 0.3 + p};
				double sh[LP_BOX_SH_COUNT] = {0.0};
				double moved[LP_BOX_ORDERS][LP_BOX_SH_COUNT];
				double from_m[3];

				for (int w = 0; w < 6; w++)
					box.wall_m[w] = sizes_m[s];
				if (thin == 1) /* the probe is in a wall */
					box.wall_m[2] = 0.0;
				if (thin == 2) /* on the ground of a field */
					box.wall_m[2] = 1e-9, box.wall_m[3] = 1e9;
				for (int a = 0; a < 3; a++)
					from_m[a] = places[p] * sizes_m[s];
				const struct lp_box_view view = lp_box_look(&box, from_m);

				for (int k = 0; k < LP_BOX_RAYS; k++)
					assert_unit_hit(&view, rays.along[k]);
				assert_unit_hit(&view, (const double[]){0.0, 1.0, 0.0});
				assert_unit_hit(&view, (const double[]){-1.0, 0.0, 0.0});
				for (int i = 0; i < LP_BOX_SH_COUNT; i++)
					sh[i] = 1.0 / (1 + i);
				lp_box_look_around(&rays, &box, from_m, seen);
				lp_box_move_sh(&rays, (const double(*)[LP_BOX_SH_COUNT])seen, sh,
					       moved);
				for (int o = 0; o < LP_BOX_ORDERS; o++)
					for (int i = 0; i < LP_BOX_SH_COUNT; i++) {
						assert_true(fabs(moved[o][i]) < 20.0);
						if (places[p] == 0.0)
							worst = fmax(worst,
								     fabs(moved[o][i] - sh[i]));
					}
			}
	figure("places: box", "walls 0 … 1e9 m, probe in a wall", "light where the probe is", worst,
	       1e-12);
}

/* ---------------------------------------------------------------- the room */

static void fill_cells(float *cells, int view)
{
	for (int k = 0; k < LP_COARSE_CELLS; k++)
		cells[k] = 1.0F +
			   0.5F * sinf(0.3F * (float)(k % LP_COARSE_COLUMNS) + 0.2F * (float)view) *
				   cosf(0.2F * (float)(k / LP_COARSE_COLUMNS));
}

/* Poses that are no numbers, or beyond all rooms: no room, or one that is made of numbers. */
static void test_a_room_of_odd_poses(void **state)
{
	static float cells[LP_COARSE_CELLS];

	(void)state;
	for (size_t o = 0; o < LP_COUNT(odd); o++)
		for (int field = 0; field < 3; field++) {
			struct lp_room_found found;
			struct lp_room *room;

			assert_int_equal(lp_room_create(&room), 0);
			for (int n = 0; n < 10; n++) {
				struct lp_probe_pose pose = {.t_ns = 1 + n * INT64_C(500000000),
							     .world = 1,
							     .rotation = lp_rotation_identity(),
							     .position_m = {0.2 * sin(n),
									    0.1 * cos(n),
									    0.15 * sin(2 * n)},
							     .sigma_m = 1e-3};

				if (n % 3 == 2 && field == 0)
					pose.position_m[1] = odd[o];
				if (n % 3 == 2 && field == 1)
					pose.velocity_m_s[0] = odd[o];
				if (n == 5 && field == 2)
					pose.t_ns = INT64_MAX / 4;
				fill_cells(cells, n);
				if (lp_room_wants(room, &pose))
					lp_room_see(room, &pose, cells, cells);
				for (int k = 0; k < 8; k++)
					lp_room_work(room);
				if (!lp_room_found(room, &pose, &found))
					continue;
				for (int w = 0; w < 6; w++)
					if (!(isfinite(found.box.wall_m[w]) &&
					      found.wall_sigma_m[w] > 0.0))
						fail_msg("wall %g ± %g m", found.box.wall_m[w],
							 found.wall_sigma_m[w]);
				assert_true(isfinite(found.box.yaw_rad));
				for (int k = 0; k < LP_BOX_ORDERS; k++)
					assert_false(isnan(found.error_per_m[k]) ||
						     isnan(found.bare_error_per_m[k]));
			}
			lp_room_destroy(room);
		}
}

/* Views that lie beyond the walls of a guess. */
static void test_views_outside_the_box(void **state)
{
	static struct lp_room_views views;
	static struct lp_box_rays rays;
	double error_per_m[LP_BOX_ORDERS], bare_per_m[LP_BOX_ORDERS];
	const struct lp_box box = {.wall_m = {0.1, 0.1, 0.1, 0.1, 0.1, 0.1}};
	struct lp_room *room;

	(void)state;
	assert_int_equal(lp_room_create(&room), 0);
	lp_box_fill_rays(&rays);
	views.grid = lp_room_grid(room);
	views.count = LP_ROOM_MOST_VIEWS;
	for (int k = 0; k < views.count; k++) {
		struct lp_room_view *v = &views.list[k];

		fill_cells(v->cells, k);
		for (int a = 0; a < 3; a++)
			v->position_m[a] = k % 3 == a ? 0.1 * k : 0.0;
		v->light.mean = lp_coarse_project(views.grid, v->cells, v->light.sh);
		v->bare = v->light;
	}
	lp_room_find_errors(&rays, &views, &box, 0.0, error_per_m, bare_per_m);
	for (int k = 0; k < LP_BOX_ORDERS; k++)
		assert_false(isnan(error_per_m[k]) || isnan(bare_per_m[k]));
	lp_room_destroy(room);
}

/* ---------------------------------------------------------------- many frames */

static void test_a_lamp_over_a_million_frames(void **state)
{
	struct lp_parallax p = {0};
	double worst = 0.0;

	(void)state;
	for (int n = 0; n < MANY / SKIPPED; n++) {
		const double t_s = n * SKIPPED / 30.0;
		const double x = 0.3 * sin(0.9 * t_s), y = 0.1 * sin(0.61 * t_s);
		const double length = sqrt(x * x + y * y + 9.0);
		const struct lp_probe_pose pose = {
			.t_ns = (int64_t)(t_s * 1e9) + 1,
			.world = 1,
			.rotation = lp_rotation_identity(),
			.position_m = {x + 0.003 * (double)random_normal(), y, 0.0},
			.sigma_rad = 1e-3,
			.sigma_m = 0.003};
		const struct lp_parallax_sighting s = {.direction = {(float)(-x / length),
								     (float)(-y / length),
								     (float)(-3.0 / length)},
						       .sigma_rad = 1e-3F};

		lp_parallax_see(&p, &pose, &s);
		const struct lp_lamp_distance d = lp_parallax_distance(&p);

		assert_false(isinf(d.distance_m));
		if (n > 300 && !isnan(d.distance_m))
			worst = fmax(worst, fabs((double)d.distance_m - length) /
						    ((double)d.sigma * length));
	}
	figure("places: lamps", "9 hours, every 100th of 1e6 frames", "distance, sigmas", worst,
	       5.0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_lamps_near_and_far),
		cmocka_unit_test(test_odd_sightings),
		cmocka_unit_test(test_steps_onto_a_lamp),
		cmocka_unit_test(test_light_through_any_box),
		cmocka_unit_test(test_a_room_of_odd_poses),
		cmocka_unit_test(test_views_outside_the_box),
		cmocka_unit_test(test_a_lamp_over_a_million_frames),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
