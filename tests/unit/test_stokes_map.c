/* SPDX-License-Identifier: Apache-2.0 */
/* How the cells of a panorama are polarized. */
#include "vision/film/stokes_map.h"

#include <math.h>
#include <stdlib.h>

#include "include/luminance.h"
#include "include/polarization_grid.h"
#include "light/math/grid.h"
#include "lp_test.h"
#include "vision/map/radiance_map.h"

#define WIDTH 96
#define CELLS (WIDTH * WIDTH / 2)

struct room {
	struct lp_grid *grid;
	struct lp_stokes_map *map;
	struct lp_film film;
	int ahead; /* a cell */
	float radiance[CELLS][4];
	uint8_t flags[CELLS];
};

static void film_axis(const struct lp_film_view *view, const float direction[3], float axis[2])
{
	const struct lp_film_pass pass = lp_film_pass(view, direction);

	for (int i = 0; pass.polarizes && i < 2; i++)
		axis[i] = pass.axis[i];
}

static void open_room(struct room *room)
{
	*room = (struct room){.film = lp_film_of_one_sheet(0.84F, 500.0F, 1.5F)};
	assert_int_equal(lp_grid_create(WIDTH, WIDTH / 2, &room->grid), 0);
	assert_int_equal(lp_stokes_map_create(room->grid, &room->map), 0);
	room->ahead = lp_grid_cell(room->grid, (const float[]){0.05F, 0.05F, -1.0F});
}

static void close_room(struct room *room)
{
	lp_stokes_map_destroy(room->map);
	lp_grid_destroy(room->grid);
}

/* One frame at an angle of the wheel, of light that is q, u polarized below a height. */
static void see_below(struct room *room, float wheel_deg, float height, float light, float q,
		      float u)
{
	const struct lp_rotation none = lp_rotation_identity();
	const struct lp_film_view view = lp_film_seen(&room->film, wheel_deg, &none);
	const struct lp_observation seen = {.radiance = (const float(*)[4])room->radiance,
					    .flags = room->flags,
					    .elapsed_s = 0.05F};

	for (int i = 0; i < CELLS; i++) {
		float direction[3], axis[2] = {0};

		lp_grid_direction(room->grid, i, direction);
		if (direction[1] < height)
			film_axis(&view, direction, axis);
		for (int c = 0; c < 4; c++)
			room->radiance[i][c] = light * (1.0F + axis[0] * q + axis[1] * u);
	}
	lp_stokes_map_learn(room->map, &view, &seen);
}

/* The same, polarized everywhere. */
static void see(struct room *room, float wheel_deg, float light, float q, float u)
{
	see_below(room, wheel_deg, INFINITY, light, q, u);
}

static struct lp_polarization lamp_ahead(struct room *room, float radiance, float background)
{
	const int32_t cell = room->ahead;

	room->radiance[cell][LP_LUMINANCE] = radiance;
	return lp_stokes_map_of(room->map, (const float(*)[4])room->radiance, background, &cell, 1);
}

static void test_a_lamp_is_polarized_as_its_cells(void **state)
{
	struct room room;

	(void)state;
	open_room(&room);
	for (int k = 0; k < 8; k++)
		see(&room, 45.0F * (float)(k % 4), 2.0F, 0.3F, 0.4F);
	const struct lp_polarization p = lamp_ahead(&room, 2.0F, 0.5F);

	assert_true(p.known);
	assert_float_equal(p.dolp, 0.5, 0.02);
	assert_float_equal(p.aolp_deg, 26.57, 1.0);
	close_room(&room);
}

/* What was read while the lamp was off, or clipped, or in one block with its surround, is of other
 * light than the lamp's. */
static void test_cells_that_tell_of_other_light_tell_nothing_of_the_lamp(void **state)
{
	struct room room;

	(void)state;
	open_room(&room);
	for (int k = 0; k < 8; k++)
		see(&room, 45.0F * (float)(k % 4), 0.5F, 0.0F, 0.0F);
	assert_true(lamp_ahead(&room, 0.6F, 0.1F).known);
	assert_false(lamp_ahead(&room, 30.0F, 0.5F).known);
	assert_false(lamp_ahead(&room, 0.2F, 0.1F).known);
	close_room(&room);
}

static float floor_q;

static float everywhere_below(const float d[3])
{
	return d[1] < 0.0F ? floor_q : 0.0F;
}

static float all_around(const float d[3])
{
	(void)d;
	return floor_q;
}

/* A glossy wall on the left, and a floor that is matt. */
static float on_the_left(const float d[3])
{
	return d[1] < 0.0F && d[0] < 0.0F ? floor_q : 0.0F;
}

/* q: S1/S0 of the light from a direction; the film stands off_deg from where it is taken to be. */
/* What tells that the film stands off_deg from where the wheel says. */
static bool tells(bool (*judge)(const struct lp_stokes_map *), float (*q)(const float direction[3]),
		  float value, float off_deg)
{
	struct room room;

	open_room(&room);
	floor_q = value;
	for (int k = 0; k < 8; k++) {
		const struct lp_rotation none = lp_rotation_identity();
		const float wheel_deg = 45.0F * (float)(k % 4);
		const struct lp_film_view view = lp_film_seen(&room.film, wheel_deg, &none),
					  real = lp_film_seen(&room.film, wheel_deg + off_deg,
							      &none);
		const struct lp_observation seen = {.radiance = (const float(*)[4])room.radiance,
						    .flags = room.flags,
						    .elapsed_s = 0.05F};

		for (int i = 0; i < CELLS; i++) {
			float direction[3], axis[2] = {0};

			lp_grid_direction(room.grid, i, direction);
			film_axis(&real, direction, axis);
			const float gain = lp_film_pass(&real, direction).gain /
					   lp_film_pass(&view, direction).gain;

			for (int c = 0; c < 4; c++)
				room.radiance[i][c] = gain * (1.0F + axis[0] * q(direction));
		}
		lp_stokes_map_learn(room.map, &view, &seen);
	}
	const bool told = judge(room.map);

	close_room(&room);
	return told;
}

static bool floor_is_upright(float (*q)(const float direction[3]), float value, float off_deg)
{
	return tells(lp_stokes_map_floor_is_upright, q, value, off_deg);
}

static bool surfaces_tell(float (*q)(const float direction[3]), float value, float off_deg)
{
	return tells(lp_stokes_map_surfaces_seem_turned, q, value, off_deg);
}

static void test_a_floor_that_seems_upright(void **state)
{
	struct room room;

	(void)state;
	assert_true(floor_is_upright(everywhere_below, 0.06F, 90.0F));
	assert_true(floor_is_upright(everywhere_below, 0.1F, 90.0F));
	assert_false(floor_is_upright(everywhere_below, 0.06F, 0.0F));
	assert_false(floor_is_upright(everywhere_below, 0.0F, 90.0F)); /* matt */
	assert_false(floor_is_upright(everywhere_below, 0.0F, 0.0F));
	assert_false(
		floor_is_upright(everywhere_below, -0.06F, 0.0F)); /* of panes: no such floor */
	assert_false(floor_is_upright(all_around, 0.06F, 90.0F));  /* the response, or a sky */
	assert_false(floor_is_upright(on_the_left, 0.06F, 90.0F));
	open_room(&room);
	assert_false(lp_stokes_map_floor_is_upright(room.map));
	close_room(&room);
}

static void test_surfaces_tell_of_a_film_put_in_wrong(void **state)
{
	(void)state;
	assert_true(surfaces_tell(everywhere_below, 0.0F, 90.0F)); /* matt: the floor is silent */
	assert_true(surfaces_tell(everywhere_below, 0.1F, 90.0F));
	assert_true(surfaces_tell(all_around, 0.06F, 90.0F));
	assert_false(surfaces_tell(everywhere_below, 0.0F, 0.0F));
	assert_false(surfaces_tell(everywhere_below, 0.3F, 0.0F));
	assert_false(surfaces_tell(all_around, 0.3F, 0.0F));
	assert_false(surfaces_tell(on_the_left, -0.3F, 0.0F));
}

static void to_floats(const uint16_t half[4], float value[4])
{
	for (int k = 0; k < 4; k++) {
		const int exponent = half[k] >> 10 & 31, mantissa = half[k] & 1023;

		value[k] = exponent == 31  ? NAN
			   : exponent == 0 ? ldexpf((float)mantissa, -24)
					   : ldexpf((float)(1024 + mantissa), exponent - 25);
		if (half[k] & 0x8000)
			value[k] = -value[k];
	}
}

/* The cell of a picture along a direction. */
static const uint16_t *cell_along(const struct lp_polarization_grid *picture,
				  const float direction[3])
{
	struct lp_grid *grid;

	assert_int_equal(lp_grid_create(LP_POLARIZATION_WIDTH, LP_POLARIZATION_HEIGHT, &grid), 0);
	const int cell = lp_grid_cell(grid, direction);

	lp_grid_destroy(grid);
	return picture->cells[cell];
}

static void test_a_picture_holds_what_is_known(void **state)
{
	static struct lp_polarization_grid picture;
	const struct lp_rotation none = lp_rotation_identity();
	struct room room;
	float value[4];

	(void)state;
	open_room(&room);
	lp_stokes_map_picture(room.map, &none, &picture);
	for (int i = 0; i < LP_POLARIZATION_CELLS; i++) {
		to_floats(picture.cells[i], value);
		assert_true(isnan(value[0]) && isnan(value[1]) && isnan(value[3]));
	}
	for (int k = 0; k < 8; k++)
		see(&room, 45.0F * (float)(k % 4), 20000.0F, 0.3F, -0.4F);
	lp_stokes_map_picture(room.map, &none, &picture);
	to_floats(cell_along(&picture, (const float[]){0.3F, 0.2F, -1.0F}), value);
	assert_float_equal(value[0] * picture.s0_unit, 20000.0, 100.0);
	assert_float_equal(value[1], 0.3, 0.01);
	assert_float_equal(value[2], -0.4, 0.01);
	assert_true(value[3] > 0.0F && value[3] < 0.1F);
	/* The sheet is seen edge-on. */
	to_floats(cell_along(&picture, (const float[]){1.0F, 0.0F, 0.0F}), value);
	assert_true(isnan(value[0]));
	close_room(&room);
}

/* A camera that has rolled by 30 degrees (its right side up) sees all light polarized 30 degrees
 * less, and what was straight above 30 degrees to the right of it. */
static void test_a_picture_is_in_the_cameras_frame(void **state)
{
	static struct lp_polarization_grid picture;
	const double turn = M_PI / 6.0;
	const struct lp_rotation roll = lp_rotation_of_quaternion(
		(const double[]){0.0, 0.0, sin(turn / 2.0), cos(turn / 2.0)});
	struct room room;
	float up[3] = {0.1F, 0.6F, -0.8F}, value[4];

	(void)state;
	open_room(&room);
	for (int k = 0; k < 8; k++)
		see(&room, 45.0F * (float)(k % 4), 1.0F, 0.5F, 0.0F);
	/* One bright place, in the frame of the map. */
	const int bright = lp_grid_cell(room.grid, up);

	int around[LP_NEIGHBOURS + 1] = {bright};

	lp_grid_neighbours(room.grid, bright, around + 1);
	for (int k = 0; k <= LP_NEIGHBOURS; k++) {
		struct lp_stokes *cell = &room.map->cells[around[k]];

		cell->scale *= 4.0F;
		for (int i = 0; i < 3; i++)
			cell->right[i] *= 4.0F;
	}
	lp_stokes_map_picture(room.map, &roll, &picture);
	to_floats(cell_along(&picture, (const float[]){0.02F, 0.02F, -1.0F}), value);
	assert_float_equal(value[1], 0.5 * cos(-2.0 * turn), 0.03);
	assert_float_equal(value[2], 0.5 * sin(-2.0 * turn), 0.03);
	lp_grid_direction(room.grid, bright, up);
	const struct lp_rotation back = lp_rotation_inverse(&roll);

	lp_rotate_direction(&back, up);
	assert_true(up[0] > 0.3F);
	to_floats(cell_along(&picture, up), value);
	assert_float_equal(value[0] * picture.s0_unit, 4.0, 0.1);
	close_room(&room);
}

/* A reading of every cell through the film, as it would be without. */
static float seen_through(struct room *room, float wheel_deg, float light, float *sigma)
{
	const struct lp_rotation none = lp_rotation_identity();
	const struct lp_film_view view = lp_film_seen(&room->film, wheel_deg, &none);
	struct lp_observation seen = {.radiance = (const float(*)[4])room->radiance,
				      .flags = room->flags};

	for (int i = 0; i < CELLS; i++)
		for (int c = 0; c < 4; c++)
			room->radiance[i][c] = light;
	lp_stokes_map_see_through(room->map, &view, &seen);
	const float radiance = seen.radiance[room->ahead][LP_LUMINANCE];

	*sigma = sqrtf(seen.place_variance[room->ahead]) / radiance;
	return radiance;
}

/* Else the map would not follow a lamp, before its polarization is known. */
static void test_light_of_unknown_polarization_is_taken_as_it_is(void **state)
{
	struct room room;
	float sigma;

	(void)state;
	open_room(&room);
	assert_float_equal(seen_through(&room, 0.0F, 2.0F, &sigma), 2.0, 1e-6);
	assert_true(sigma > 0.05F && sigma < 0.3F);
	see(&room, 0.0F, 2.0F, 0.0F, 0.0F);
	assert_float_equal(seen_through(&room, 90.0F, 1.0F, &sigma), 1.0, 1e-6);
	assert_true(sigma > 0.05F && sigma < 0.3F);
	close_room(&room);
}

/* The rim of a lamp that comes and goes seems polarized; a lamp that then lies there is as it is.
 */
static void test_other_light_is_not_divided_by_what_was_known(void **state)
{
	struct room room;
	float sigma;

	(void)state;
	open_room(&room);
	for (int k = 0; k < 40; k++)
		see(&room, 45.0F * (float)(k % 4), 2.0F, 0.8F, 0.0F);
	assert_float_equal(seen_through(&room, 90.0F, 0.4F, &sigma), 2.0, 0.2);
	assert_float_equal(seen_through(&room, 90.0F, 2.0F, &sigma), 2.0, 1e-6);
	assert_true(sigma > 0.1F);
	close_room(&room);
}

static void test_polarized_light_is_seen_through(void **state)
{
	struct room room;
	float sigma;

	(void)state;
	open_room(&room);
	for (int k = 0; k < 40; k++)
		see(&room, 45.0F * (float)(k % 4), 2.0F, 0.6F, 0.0F);
	assert_float_equal(seen_through(&room, 90.0F, 0.8F, &sigma), 2.0, 0.1);
	assert_true(sigma < 0.1F);
	close_room(&room);
}

/* Light from below the horizon is polarized. */
static void see_a_floor(struct room *room, float wheel_deg)
{
	see_below(room, wheel_deg, 0.0F, 2.0F, 0.4F, 0.0F);
}

/* Wherever the camera looks, only what is not polarized is compared with the map. */
static void test_polarized_light_is_not_compared(void **state)
{
	const struct lp_rotation to_map = lp_rotation_of_vector((const double[3]){0.0, 0.7, 0.9});
	struct room room;
	int above = 0, below = 0;

	(void)state;
	open_room(&room);
	for (int k = 0; k < 40; k++)
		see_a_floor(&room, 45.0F * (float)(k % 4));
	struct lp_observation seen = {.radiance = (const float(*)[4])room.radiance,
				      .flags = room.flags};

	const struct lp_rotation none = lp_rotation_identity();
	const struct lp_film_view view = lp_film_seen(&room.film, 0.0F, &none);

	lp_stokes_map_leave_out(room.map, &view, &to_map, &seen);
	for (int i = 0; i < CELLS; i++) {
		float d[3];

		lp_grid_direction(room.grid, i, d);
		lp_rotate_direction(&to_map, d);
		above += d[1] > 0.1F && seen.flags[i];
		below += d[1] < -0.1F && seen.flags[i];
	}
	assert_int_equal(above, 0);
	assert_true(below > CELLS / 5);
	close_room(&room);
}

/* While the camera turns, cells at the rim of a lamp read more or less of it, by chance: no film
 * did that. */
static void test_rims_of_a_turning_picture_are_not_polarized(void **state)
{
	const struct lp_rotation none = lp_rotation_identity();
	float step2[CELLS];
	struct room room;
	int wrong = 0;

	(void)state;
	srand(5);
	open_room(&room);
	for (int i = 0; i < CELLS; i++)
		step2[i] = 1.0F; /* from light 0 to 1 in one cell */
	for (int k = 0; k < 400; k++) {
		const struct lp_film_view view =
			lp_film_seen(&room.film, 45.0F * (float)(k / 5 % 4), &none);
		const struct lp_observation seen = {.radiance = (const float(*)[4])room.radiance,
						    .flags = room.flags,
						    .step2 = step2,
						    .elapsed_s = 0.1F};
		const float light = 0.5F + 0.5F * (float)rand() / (float)RAND_MAX;

		for (int i = 0; i < CELLS; i++)
			for (int c = 0; c < 4; c++)
				room.radiance[i][c] = light;
		lp_stokes_map_learn(room.map, &view, &seen);
		const struct lp_polarization p =
			lp_stokes_polarization(&room.map->cells[room.ahead]);

		wrong += p.known && p.dolp > 3.0F * p.dolp_sigma;
	}
	assert_true(wrong < 8);
	close_room(&room);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_floor_that_seems_upright),
		cmocka_unit_test(test_surfaces_tell_of_a_film_put_in_wrong),
		cmocka_unit_test(test_a_picture_holds_what_is_known),
		cmocka_unit_test(test_a_picture_is_in_the_cameras_frame),
		cmocka_unit_test(test_a_lamp_is_polarized_as_its_cells),
		cmocka_unit_test(test_cells_that_tell_of_other_light_tell_nothing_of_the_lamp),
		cmocka_unit_test(test_light_of_unknown_polarization_is_taken_as_it_is),
		cmocka_unit_test(test_other_light_is_not_divided_by_what_was_known),
		cmocka_unit_test(test_polarized_light_is_seen_through),
		cmocka_unit_test(test_polarized_light_is_not_compared),
		cmocka_unit_test(test_rims_of_a_turning_picture_are_not_polarized),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
