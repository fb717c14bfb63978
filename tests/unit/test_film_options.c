/* SPDX-License-Identifier: Apache-2.0 */
/* Which film stands before the lens: command line, camera file, and what is usual. */
#include "app/options/film_options.h"

#include <errno.h>
#include <stdio.h>

#include "app/options/options.h"
#include "lp_test.h"

#include "camera_file_test.h"

static const char camera[] = "[camera]\nname = a\nprojection = equirect\nwidth_px = 960\n"
			     "height_px = 480\n";

static struct lp_film_numbers film_of(const char *section, const char *first, const char *second)
{
	char *argv[] = {"lightprobed", (char *)first, (char *)second, NULL}, text[512];
	struct lp_camera_file *file;
	struct lp_options options;

	(void)snprintf(text, sizeof(text), "%s%s", camera, section);
	assert_int_equal(read_camera_file(text, &file), 0);
	assert_int_equal(lp_options_read(&options, second ? 3 : 2, argv), 0);
	const struct lp_film_numbers film = lp_film_options(&options, file);

	lp_camera_file_destroy(file);
	return film;
}

static const char measured[] =
	"[polarizer]\ntransmission = 0.7\nextinction = 90\noffset_deg = -88.5\n";

static void test_what_is_usual(void **state)
{
	const struct lp_film_numbers film = film_of("", "--polarizer=sweep", NULL);

	(void)state;
	assert_float_equal(film.transmission, 0.84, 1e-6);
	assert_float_equal(film.extinction, 500, 1e-3);
	assert_float_equal(film.offset_deg, 0, 1e-6);
}

static void test_the_camera_file_and_the_command_line_over_it(void **state)
{
	struct lp_film_numbers film = film_of(measured, "--polarizer=sweep", NULL);

	(void)state;
	assert_float_equal(film.transmission, 0.7, 1e-6);
	assert_float_equal(film.extinction, 90, 1e-4);
	assert_float_equal(film.offset_deg, -88.5, 1e-5);
	assert_float_equal(film.rest_s, 0, 0);
	film = film_of(measured, "--polarizer=sweep", "--polarizer-rest=60");
	assert_float_equal(film.rest_s, 60, 1e-6);
	film = film_of(measured, "--polarizer=fixed:30", "--polarizer-offset=3");
	assert_float_equal(film.offset_deg, 3, 1e-6);
	assert_float_equal(film.extinction, 90, 1e-4);
}

static void test_no_film(void **state)
{
	(void)state;
	assert_float_equal(film_of(measured, "--polarizer=off", NULL).transmission, 0, 0);
}

/* Real sheets: 3.89 stops; ideal ones: an eighth, equations 1 to 3 of the research. */
static void test_a_stack_of_three(void **state)
{
	(void)state;
	assert_float_equal(film_of("", "--polarizer=films", NULL).transmission, 2 * 0.0675, 2e-4);
	assert_float_equal(film_of("[polarizer]\ntransmission = 1\nextinction = 1e9\n",
				   "--polarizer=films", NULL)
				   .transmission,
			   2.0 / 8.0, 1e-4);
}

static void test_a_broken_section_is_named(void **state)
{
	struct lp_camera_file *file;
	char text[256];

	(void)state;
	(void)snprintf(text, sizeof(text), "%s[polarizer]\nextinction = 0.5\n", camera);
	assert_int_equal(read_camera_file(text, &file), -EBADMSG);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_what_is_usual),
		cmocka_unit_test(test_the_camera_file_and_the_command_line_over_it),
		cmocka_unit_test(test_no_film),
		cmocka_unit_test(test_a_stack_of_three),
		cmocka_unit_test(test_a_broken_section_is_named),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
