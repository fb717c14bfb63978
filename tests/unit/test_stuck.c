/* SPDX-License-Identifier: Apache-2.0 */
/* Places of the picture that shine by themselves, and lamps, which do not. */
#include "vision/stuck/stuck.h"

#include <math.h>
#include <stdlib.h>

#include "include/luminance.h"
#include "light/math/rotation.h"
#include "lp_test.h"
#include "vision/camera/camera.h"
#include "vision/picture/cells.h"

#define COLUMNS 120
#define ROWS 60
#define CELLS (COLUMNS * ROWS)
#define CELL_PX 8
/* A pixel at full scale, of the 64 of a cell. */
#define PIXEL (1.0F / 64.0F)
/* Exposures of a bracket: full scale to radiance. */
static const float scales[3] = {30.0F, 500.0F, 10000.0F};

static struct lp_camera *camera;
static struct lp_stuck stuck;
static struct lp_cells cells;
static float own[CELLS];  /* of full scale, in every exposure */
static float dark[CELLS]; /* radiance: what grows with the exposure */
static double yaw_rad, nod_rad;
static int frames;
static bool hand; /* before the left half */
/* How much light lies in a direction; NULL: that is not known. */
static float (*know)(const void *context, const float direction[3]);

static int set_up(void **state)
{
	(void)state;
	assert_int_equal(lp_camera_create(NULL, &camera), 0);
	return lp_cells_reserve(&cells, COLUMNS, ROWS, CELL_PX);
}

static int tear_down(void **state)
{
	(void)state;
	lp_cells_release(&cells);
	lp_camera_destroy(camera);
	return 0;
}

static int begin(void **state)
{
	(void)state;
	srand(1);
	memset(own, 0, sizeof(own));
	memset(dark, 0, sizeof(dark));
	yaw_rad = nod_rad = 0.0;
	frames = 0;
	hand = false;
	know = NULL;
	return lp_stuck_fit(&stuck, camera, COLUMNS * CELL_PX, ROWS * CELL_PX, CELL_PX);
}

static int end(void **state)
{
	(void)state;
	lp_stuck_release(&stuck);
	return 0;
}

static struct lp_rotation to_anchor(void)
{
	const double turn[3] = {0.0, yaw_rad, 0.0}, nod[3] = {nod_rad, 0.0, 0.0};
	const struct lp_rotation about_up = lp_rotation_of_vector(turn);
	const struct lp_rotation about_right = lp_rotation_of_vector(nod);

	return lp_rotation_product(&about_up, &about_right);
}

/* Radiance of a room with texture, and of lamps a cell wide at several heights, as far apart from
 * each other as lamps in a row are. */
static float world(const float d[3])
{
	const float azimuth = atan2f(d[0], -d[2]);
	float light = 4.0F + 1.5F * sinf(9.0F * d[0]) * sinf(7.0F * d[1] + 1.0F) +
		      1.5F * sinf(11.0F * d[2] + 2.0F * d[0]);

	for (int k = 0; k < 12; k++) {
		const float off = remainderf(azimuth - 0.5F * (float)k - 0.02F * (float)(k * k),
					     (float)(2.0 * M_PI));
		const float up = asinf(d[1]) - 0.2F * (float)(k % 4) + 0.1F;

		if (off * off + up * up < 0.02F * 0.02F)
			light += 3000.0F;
	}
	return light;
}

static bool is_covered(const void *context, const float direction[3])
{
	(void)context;
	return direction[0] < 0.0F;
}

/* As the imager's map tells it: most of what lies within a cell of a direction. */
static float known(const void *context, const float direction[3])
{
	const float cell = 2.0F * (float)M_PI / COLUMNS;
	float most = 0.0F;

	(void)context;
	for (int k = 0; k < 49; k++) {
		const double turn[3] = {(double)((float)(k % 7 - 3) * cell / 2.0F),
					(double)((float)(k / 7 - 3) * cell / 2.0F), 0.0};
		const struct lp_rotation aside = lp_rotation_of_vector(turn);
		float d[3] = {direction[0], direction[1], direction[2]};

		lp_rotate_direction(&aside, d);
		const float length = sqrtf(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);

		for (int a = 0; a < 3; a++)
			d[a] /= length;
		most = fmaxf(most, world(d));
	}
	return most;
}

static float everything_bright(const void *context, const float direction[3])
{
	(void)context;
	(void)direction;
	return 1e9F;
}

/* One frame, as the imager goes about it. `turns`: it is known that the camera does. */
static void frame(bool turns)
{
	const struct lp_rotation rotation = to_anchor();

	cells.scale = scales[frames++ % 3];
	cells.clipped_count = 0;
	for (int i = 0; i < CELLS; i++) {
		float d[3] = {stuck.ray[i][0], stuck.ray[i][1], stuck.ray[i][2]};
		const bool hidden = hand && is_covered(NULL, d);

		lp_rotate_direction(&rotation, d);
		const float seen = hidden ? 0.0F : world(d) / cells.scale;
		const float noise = 0.0003F * (float)rand() / (float)RAND_MAX;
		const float light = fminf(seen + dark[i] / cells.scale + own[i] + noise, 1.0F);

		for (int c = 0; c < 4; c++)
			cells.radiance[i][c] = light * cells.scale;
		cells.clipped[i] = light >= 1.0F;
		cells.clipped_count += cells.clipped[i];
	}
	const struct lp_stuck_look look = {.cells = &cells,
					   .to_anchor = &rotation,
					   .turns = turns,
					   .covered = hand ? is_covered : NULL,
					   .known = know};

	lp_stuck_fill(&stuck, &cells);
	lp_stuck_learn(&stuck, &look);
}

/* As a head looks around, for so many frames at 30 Hz. */
static void look_around(int count)
{
	for (int n = 0; n < count; n++) {
		const double t_s = frames / 30.0;

		yaw_rad = 0.7 * sin(2.0 * M_PI * 0.5 * t_s);
		nod_rad = 0.26 * sin(2.0 * M_PI * 0.31 * t_s);
		frame(true);
	}
}

/* Cells that are left out, of those where own[] or dark[] shine; and of the others. */
static int found(void)
{
	int count = 0;

	for (int i = 0; i < CELLS; i++)
		count += (own[i] > 0.0F || dark[i] > 0.0F) && lp_stuck_leaves_out(&stuck, i);
	return count;
}

static int others(void)
{
	return stuck.count - found();
}

static void shine(int count, float light)
{
	for (int k = 0; k < count; k++)
		own[(5 + 7 * k % 50) * COLUMNS + 37 * k % COLUMNS] = light;
}

static void test_a_stuck_pixel_is_found_while_the_camera_turns(void **state)
{
	(void)state;
	shine(12, PIXEL);
	look_around(90);
	assert_int_equal(found(), 12);
	assert_int_equal(others(), 0);
}

static void test_lamps_are_none(void **state)
{
	(void)state;
	for (int n = 0; n < 20; n++) {
		look_around(30);
		assert_int_equal(stuck.count, 0);
	}
}

/* A spot that stays where it was seen is a lamp, and only one that is gone there counts. */
static void test_what_is_still_where_it_was_is_a_lamp(void **state)
{
	(void)state;
	shine(12, PIXEL);
	know = everything_bright;
	look_around(300);
	assert_int_equal(stuck.count, 0);
	know = known;
	look_around(150);
	assert_int_equal(found(), 12);
	assert_int_equal(others(), 0);
}

static void test_a_camera_that_holds_still_tells_nothing(void **state)
{
	(void)state;
	shine(12, PIXEL);
	for (int n = 0; n < 300; n++)
		frame(n % 2); /* also if it seems to turn, but looks the same way */
	assert_int_equal(stuck.count, 0);
}

/* A turn by one cell shows the same lamps again. */
static void test_a_little_turn_tells_nothing(void **state)
{
	(void)state;
	shine(12, PIXEL);
	for (int n = 0; n < 300; n++) {
		yaw_rad = 2.0 * M_PI / COLUMNS * sin(0.1 * n);
		frame(true);
	}
	assert_int_equal(stuck.count, 0);
}

/* Several times as bright as the room is, in a cell. */
static void test_a_warm_pixel_is_found(void **state)
{
	(void)state;
	for (int k = 0; k < 12; k++)
		dark[(5 + 4 * k) * COLUMNS + 11 * k] = 40.0F;
	look_around(90);
	assert_true(found() >= 11);
	assert_int_equal(others(), 0);
}

static void test_what_is_cured_is_forgotten(void **state)
{
	(void)state;
	shine(12, PIXEL);
	look_around(90);
	assert_int_equal(stuck.count, 12);
	memset(own, 0, sizeof(own));
	look_around(120);
	assert_int_equal(stuck.count, 0);
}

static void test_a_light_of_the_box_is_found(void **state)
{
	(void)state;
	for (int k = 0; k < 4; k++)
		own[(40 + k / 2) * COLUMNS + 20 + k % 2] = 0.8F;
	look_around(120);
	assert_int_equal(found(), 4);
	assert_int_equal(others(), 0);
}

static void test_a_row_is_found(void **state)
{
	(void)state;
	for (int c = 0; c < COLUMNS; c++)
		own[30 * COLUMNS + c] = 8.0F * PIXEL;
	look_around(150);
	assert_true(found() >= COLUMNS * 95 / 100);
	assert_int_equal(others(), 0);
}

/* A lamp at the zenith shines in all cells of the first row, however the camera turns about it; and
 * where it is thought to be turned otherwise, in other directions than before. */
static void test_a_lamp_at_a_pole_is_none(void **state)
{
	(void)state;
	for (int c = 0; c < COLUMNS; c++)
		own[c] = 0.8F;
	look_around(300);
	assert_int_equal(stuck.count, 0);
}

static void test_a_thousand_are_found(void **state)
{
	(void)state;
	for (int k = 0; k < 1000; k++)
		own[2 * COLUMNS + rand() % (CELLS - 4 * COLUMNS)] = PIXEL;
	look_around(300);
	int all = 0;

	for (int i = 0; i < CELLS; i++)
		all += own[i] > 0.0F;
	assert_true(found() >= all * 95 / 100);
	assert_true(others() <= 2);
}

static void test_every_cell_shines(void **state)
{
	(void)state;
	for (int i = 0; i < CELLS; i++)
		own[i] = 1.0F;
	look_around(60);
	assert_int_equal(stuck.count, 0); /* nothing stands out */
}

static void test_a_hand_shows_what_shines_and_lamps_are_behind_it(void **state)
{
	(void)state;
	shine(12, PIXEL);
	int behind = 0;

	for (int i = 0; i < CELLS; i++)
		behind += own[i] > 0.0F && stuck.ray[i][0] < 0.0F;
	for (int n = 0; n < 3; n++) {
		for (int k = 0; k < 90; k++) {
			hand = k >= 60;
			frame(false);
		}
		if (n == 0)
			assert_int_equal(stuck.count, 0); /* a hand that stays is one look */
	}
	assert_int_equal(stuck.count, behind);
	assert_int_equal(others(), 0);
}

static void test_a_cell_that_is_left_out_shows_what_is_beside_it(void **state)
{
	(void)state;
	const int cell = 20 * COLUMNS + 37;

	own[cell] = 1.0F;
	look_around(120);
	assert_true(lp_stuck_leaves_out(&stuck, cell));
	for (int n = 0; n < 3; n++) {
		frame(false);
		const float around = 0.25F * (cells.radiance[cell - 1][LP_LUMINANCE] +
					      cells.radiance[cell + 1][LP_LUMINANCE] +
					      cells.radiance[cell - COLUMNS][LP_LUMINANCE] +
					      cells.radiance[cell + COLUMNS][LP_LUMINANCE]);
		int clipped = 0;

		assert_float_equal(cells.radiance[cell][LP_LUMINANCE], around, 0.2F * around);
		for (int i = 0; i < CELLS; i++)
			clipped += cells.clipped[i];
		assert_false(cells.clipped[cell]);
		assert_int_equal(cells.clipped_count, clipped);
	}
}

/* The anchor frame is the camera's again: that is no turn. */
static void test_another_anchor_is_no_look(void **state)
{
	(void)state;
	shine(12, PIXEL);
	yaw_rad = 0.3;
	for (int n = 0; n < 300; n++) {
		const double turn[3] = {0.0, n % 2 ? 0.6 : -0.6, 0.0};
		const struct lp_rotation rotation = lp_rotation_of_vector(turn);

		frame(true);
		yaw_rad += turn[1];
		lp_stuck_turn(&stuck, &rotation);
	}
	assert_int_equal(stuck.count, 0);
}

static void test_what_is_known_is_carried_over_to_another_size(void **state)
{
	struct lp_stuck next = {0};

	(void)state;
	shine(12, PIXEL);
	look_around(90);
	assert_int_equal(stuck.count, 12);
	const int first = stuck.list[0];

	assert_int_equal(lp_stuck_inherit(&next, &stuck), 0);
	assert_int_equal(lp_stuck_fit(&next, camera, COLUMNS * CELL_PX, ROWS * CELL_PX, CELL_PX),
			 0);
	assert_int_equal(next.count, 12);
	lp_stuck_release(&next);
	assert_int_equal(lp_stuck_fit(&stuck, camera, 2 * COLUMNS * CELL_PX, 2 * ROWS * CELL_PX,
				      CELL_PX),
			 0);
	assert_int_equal(stuck.count, 4 * 12);
	assert_true(lp_stuck_leaves_out(&stuck, 2 * (first / COLUMNS) * 2 * COLUMNS +
							2 * (first % COLUMNS)));
	assert_int_equal(lp_stuck_fit(&stuck, camera, COLUMNS * CELL_PX, ROWS * CELL_PX, CELL_PX),
			 0);
	assert_int_equal(stuck.count, 12);
}

static void test_a_camera_file_names_them(void **state)
{
	float pixels[2][2] = {{100, 200}, {399, 80}}; /* of 960 x 480; the second at a border */
	struct lp_camera told = *camera;
	struct lp_stuck known = {0};

	(void)state;
	told.width_px = COLUMNS * CELL_PX;
	told.height_px = ROWS * CELL_PX;
	told.stuck_px = pixels;
	told.stuck_count = 2;
	assert_int_equal(lp_stuck_fit(&known, &told, COLUMNS * CELL_PX, ROWS * CELL_PX, CELL_PX),
			 0);
	assert_true(lp_stuck_leaves_out(&known, 25 * COLUMNS + 12));
	assert_true(lp_stuck_leaves_out(&known, 10 * COLUMNS + 49));
	assert_true(lp_stuck_leaves_out(&known, 10 * COLUMNS + 50));
	assert_false(lp_stuck_leaves_out(&known, 10 * COLUMNS + 51));
	lp_stuck_release(&known);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, begin, end)
	const struct CMUnitTest tests[] = {
		TEST(test_a_stuck_pixel_is_found_while_the_camera_turns),
		TEST(test_lamps_are_none),
		TEST(test_what_is_still_where_it_was_is_a_lamp),
		TEST(test_a_camera_that_holds_still_tells_nothing),
		TEST(test_a_little_turn_tells_nothing),
		TEST(test_a_warm_pixel_is_found),
		TEST(test_what_is_cured_is_forgotten),
		TEST(test_a_light_of_the_box_is_found),
		TEST(test_a_row_is_found),
		TEST(test_a_lamp_at_a_pole_is_none),
		TEST(test_a_thousand_are_found),
		TEST(test_every_cell_shines),
		TEST(test_a_hand_shows_what_shines_and_lamps_are_behind_it),
		TEST(test_a_cell_that_is_left_out_shows_what_is_beside_it),
		TEST(test_another_anchor_is_no_look),
		TEST(test_what_is_known_is_carried_over_to_another_size),
		TEST(test_a_camera_file_names_them),
	};
#undef TEST

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
