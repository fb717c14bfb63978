/* SPDX-License-Identifier: Apache-2.0 */
/* How the cells of a panorama are polarized. */
#include "vision/stokes_map.h"

#include <math.h>
#include <stdlib.h>

#include "include/luminance.h"
#include "light/grid.h"
#include "lp_test.h"
#include "vision/radiance_map.h"

#define WIDTH 32
#define CELLS (WIDTH * WIDTH / 2)

struct room {
	struct lp_grid *grid;
	struct lp_stokes_map *map;
	struct lp_film film;
	int ahead; /* a cell */
	float radiance[CELLS][4];
	uint8_t flags[CELLS];
};

static void open_room(struct room *room)
{
	*room = (struct room){.film = lp_film_of_one_sheet(0.84F, 500.0F)};
	assert_int_equal(lp_grid_create(WIDTH, WIDTH / 2, &room->grid), 0);
	assert_int_equal(lp_stokes_map_create(room->grid, &room->map), 0);
	room->ahead = lp_grid_cell(room->grid, (const float[]){0.05F, 0.05F, -1.0F});
}

static void close_room(struct room *room)
{
	lp_stokes_map_destroy(room->map);
	lp_grid_destroy(room->grid);
}

/* One frame at an angle of the wheel, of light that is q, u polarized everywhere. */
static void see(struct room *room, float wheel_deg, float light, float q, float u)
{
	const struct lp_rotation none = lp_rotation_identity();
	const struct lp_film_view view = lp_film_seen(&room->film, wheel_deg, &none);
	const struct lp_observation seen = {.radiance = (const float(*)[4])room->radiance,
					    .flags = room->flags,
					    .elapsed_s = 0.05F};

	for (int i = 0; i < CELLS; i++) {
		float direction[3], axis[2] = {0};

		lp_grid_direction(room->grid, i, direction);
		(void)lp_film_axis(&view, direction, axis);
		for (int c = 0; c < 4; c++)
			room->radiance[i][c] = light * (1.0F + axis[0] * q + axis[1] * u);
	}
	lp_stokes_map_learn(room->map, &view, &seen);
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

	*sigma = sqrtf(seen.step2[room->ahead] * seen.place_variance) / radiance;
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
		cmocka_unit_test(test_a_lamp_is_polarized_as_its_cells),
		cmocka_unit_test(test_cells_that_tell_of_other_light_tell_nothing_of_the_lamp),
		cmocka_unit_test(test_light_of_unknown_polarization_is_taken_as_it_is),
		cmocka_unit_test(test_polarized_light_is_seen_through),
		cmocka_unit_test(test_rims_of_a_turning_picture_are_not_polarized),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
