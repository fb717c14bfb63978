/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "include/light_estimate.h"
#include "include/panorama.h"
#include "light/clipped/clipped_parts.h"
#include "light/lamps/lamp_memory.h"
#include "light/math/grid.h"

#define WIDTH 240
#define HEIGHT 120
#define CELLS (WIDTH * HEIGHT)

static struct lp_grid *grid;
static struct lp_clipped_parts *parts;
static float radiance[CELLS][4];
static uint8_t flags[CELLS];

static int set_up(void **state)
{
	(void)state;
	assert_int_equal(lp_grid_create(WIDTH, HEIGHT, &grid), 0);
	return lp_clipped_parts_create(grid, &parts);
}

static int tear_down(void **state)
{
	(void)state;
	lp_clipped_parts_destroy(parts);
	lp_grid_destroy(grid);
	return 0;
}

/* The cells of a square, side * side, into cells[]; they clip. */
static void square(int row, int column, int side, int32_t *cells)
{
	for (int r = 0; r < side; r++)
		for (int c = 0; c < side; c++) {
			const int32_t cell = (row + r) * WIDTH + column + c;

			cells[r * side + c] = cell;
			flags[cell] = LP_CELL_CLIPPED;
			for (int k = 0; k < 4; k++)
				radiance[cell][k] = 1.0F;
		}
}

/* A sky that clips, which has been known for longer, and the sun within it. */
static void test_a_sun_within_a_sky_is_a_part_of_its_own(void **state)
{
	static struct lp_lamp_memory memory;
	static int32_t cells[9 * 9 + 3 * 3];
	const struct lp_panorama panorama = {.width = WIDTH,
					     .height = HEIGHT,
					     .cells = radiance,
					     .flags = flags};
	int sky = 0;

	(void)state;
	square(40, 100, 9, cells);
	square(43, 103, 3, cells + 81);
	memory.list[0] =
		(struct lp_remembered_lamp){.id = 1,
					    .seen = true,
					    .wide = true,
					    .lamp = {.count = 81, .flags = LP_LIGHT_CLIPPED}};
	memory.list[1] = (struct lp_remembered_lamp){.id = 2,
						     .seen = true,
						     .lamp = {.first = 81,
							      .count = 9,
							      .flags = LP_LIGHT_CLIPPED}};
	memory.list[2] =
		(struct lp_remembered_lamp){.id = 3,
					    .seen = false,
					    .lamp = {.count = 81, .flags = LP_LIGHT_CLIPPED}};
	lp_clipped_parts_of_lamps(parts, &panorama, cells, &memory);
	lp_clipped_parts_find(parts, &panorama);
	assert_int_equal(parts->list[0].owner, 1);
	assert_int_equal(parts->list[0].count, 9);
	for (int k = 1; k < parts->count; k++)
		sky += parts->list[k].owner == 0 ? parts->list[k].count : 0;
	assert_int_equal(sky, 81 - 9);
}

/* A sun of 3 * 3 cells in the middle of an area light of side * side. */
static void find_sun_and_area(int side, struct lp_lamp_memory *memory)
{
	static int32_t cells[CELLS];
	const struct lp_panorama panorama = {.width = WIDTH,
					     .height = HEIGHT,
					     .cells = radiance,
					     .flags = flags};
	const int area = side * side, from = 60 - side / 2;

	memset(flags, 0, sizeof(flags));
	square(from, from, side, cells);
	square(59, 59, 3, cells + area);
	*memory = (struct lp_lamp_memory){0};
	memory->list[0] =
		(struct lp_remembered_lamp){.id = 1,
					    .seen = true,
					    .wide = true,
					    .lamp = {.count = area, .flags = LP_LIGHT_CLIPPED}};
	memory->list[1] = (struct lp_remembered_lamp){.id = 2,
						      .seen = true,
						      .lamp = {.first = area,
							       .count = 9,
							       .flags = LP_LIGHT_CLIPPED}};
	lp_clipped_parts_of_lamps(parts, &panorama, cells, memory);
	lp_clipped_parts_find(parts, &panorama);
	lp_clipped_parts_give_glow(parts, memory);
}

static void test_a_glow_is_its_lamps(void **state)
{
	struct lp_lamp_memory memory;

	(void)state;
	find_sun_and_area(9, &memory);
	assert_int_equal(parts->count, 2);
	assert_int_equal(parts->list[0].owner, 1);
	assert_int_equal(parts->list[1].owner, 1);
}

static void test_a_sky_is_not_its_suns(void **state)
{
	struct lp_lamp_memory memory;
	int sky = 0;

	(void)state;
	find_sun_and_area(61, &memory);
	for (int k = 0; k < parts->count; k++)
		sky += parts->list[k].owner == 0 ? parts->list[k].count : 0;
	assert_true(sky > 61 * 61 / 2);
}

static void test_a_lamp_beside_a_lamp_is_itself(void **state)
{
	struct lp_lamp_memory memory;

	(void)state;
	find_sun_and_area(9, &memory);
	memory.list[0].wide = false;
	parts->list[1].owner = 0;
	lp_clipped_parts_give_glow(parts, &memory);
	assert_int_equal(parts->list[0].owner, 1);
	assert_int_equal(parts->list[1].owner, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_sun_within_a_sky_is_a_part_of_its_own),
		cmocka_unit_test(test_a_glow_is_its_lamps),
		cmocka_unit_test(test_a_sky_is_not_its_suns),
		cmocka_unit_test(test_a_lamp_beside_a_lamp_is_itself),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
