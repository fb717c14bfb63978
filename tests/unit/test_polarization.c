/* SPDX-License-Identifier: Apache-2.0 */
/* A flat sheet before the lens, and Stokes parameters from its angles: against closed forms. */
#include "light/film/polarization.h"

#include <math.h>
#include <stdlib.h>

#include "lp_test.h"

#define RAD (M_PI / 180.0)

static const float forward[3] = {0.0F, 0.0F, -1.0F};

static double uniform(void)
{
	return rand() / (double)RAND_MAX;
}

static double normal(void)
{
	return sqrt(-2.0 * log(uniform() + 1e-12)) * cos(2.0 * M_PI * uniform());
}

static struct lp_film ideal; /* N = 1; filled in by main() */

static struct lp_film_view seen_at(float wheel_deg)
{
	const struct lp_rotation none = lp_rotation_identity();

	return lp_film_seen(&ideal, wheel_deg, &none);
}

static bool film_axis(const struct lp_film_view *view, const float direction[3], float axis[2])
{
	const struct lp_film_pass pass = lp_film_pass(view, direction);

	for (int i = 0; pass.polarizes && i < 2; i++)
		axis[i] = pass.axis[i];
	assert_float_equal(pass.gain, 1.0, 1e-5);
	return pass.polarizes;
}

/* On the axis psi is the wheel's angle. */
static void test_on_the_axis(void **state)
{
	(void)state;
	for (int deg = 0; deg < 180; deg += 15) {
		const struct lp_film_view view = seen_at((float)deg);
		float axis[2];

		assert_true(film_axis(&view, forward, axis));
		assert_float_equal(axis[0], 499.0 / 501.0 * cos(2.0 * deg * RAD), 1e-5);
		assert_float_equal(axis[1], 499.0 / 501.0 * sin(2.0 * deg * RAD), 1e-5);
	}
}

/* A film that was not put in at 0 degrees of the wheel. */
static void test_an_offset_turns_the_axis(void **state)
{
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_film film = ideal;
	float axis[2], expected[2];

	(void)state;
	film.offset_deg = 90.0F;
	const struct lp_film_view view = lp_film_seen(&film, 20.0F, &none), other = seen_at(110.0F);

	assert_true(film_axis(&view, forward, axis));
	assert_true(film_axis(&other, forward, expected));
	assert_float_equal(axis[0], expected[0], 1e-5);
	assert_float_equal(axis[1], expected[1], 1e-5);
}

/* Off the axis, computed once more from e = d x (n x p) in double. */
static void test_off_the_axis_and_turned(void **state)
{
	int edge_on = 0, used = 0;

	(void)state;
	srand(1);
	for (int n = 0; n < 2000; n++) {
		const struct lp_film film = ideal;
		const double wheel = 180.0 * uniform();
		const double vector[3] = {normal(), normal(), normal()};
		const struct lp_rotation turn = lp_rotation_of_vector(vector);
		const struct lp_film_view view = lp_film_seen(&film, (float)wheel, &turn);
		double d[3] = {normal(), normal(), normal()}, p[3], m[3], axis[2];
		const double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
		const float direction[3] = {(float)(d[0] / length), (float)(d[1] / length),
					    (float)(d[2] / length)};
		float found[2];

		for (int i = 0; i < 3; i++)
			d[i] /= length;
		lp_rotate(&turn, (const double[]){cos(wheel * RAD), sin(wheel * RAD), 0.0}, p);
		lp_rotate(&turn, (const double[]){0.0, 0.0, -1.0}, m);
		const double a[3] = {m[1] * p[2] - m[2] * p[1], m[2] * p[0] - m[0] * p[2],
				     m[0] * p[1] - m[1] * p[0]};
		const double e[3] = {d[1] * a[2] - d[2] * a[1], d[2] * a[0] - d[0] * a[2],
				     d[0] * a[1] - d[1] * a[0]};
		const double h = hypot(d[0], d[2]);
		const double right[3] = {-d[2] / h, 0.0, d[0] / h};
		const double x = e[0] * right[0] + e[2] * right[2];
		/* y = right x d */
		const double y = e[0] * (-right[2] * d[1]) +
				 e[1] * (right[2] * d[0] - right[0] * d[2]) +
				 e[2] * (right[0] * d[1]);

		axis[0] = (x * x - y * y) / (x * x + y * y);
		axis[1] = 2.0 * x * y / (x * x + y * y);
		if (!film_axis(&view, direction, found)) {
			assert_true(fabs(d[0] * m[0] + d[1] * m[1] + d[2] * m[2]) < 0.26);
			edge_on++;
			continue;
		}
		used++;
		for (int i = 0; i < 2; i++)
			assert_float_equal(found[i], axis[i] * 499.0 / 501.0, 2e-4);
	}
	assert_true(edge_on > 400 && edge_on < 640); /* 26 % of the sphere */
	assert_true(used > 1000);
}

/* Two lenses back to back: the sheet behind is seen from its own side. */
static void test_a_sheet_for_each_lens(void **state)
{
	struct lp_film film = ideal;
	const struct lp_rotation none = lp_rotation_identity();
	float axis[2];

	(void)state;
	film.sheet_count = 2;
	film.lens[1] = lp_rotation_of_vector((const double[]){0.0, M_PI, 0.0});
	const struct lp_film_view view = lp_film_seen(&film, 30.0F, &none);

	assert_true(film_axis(&view, (const float[]){0.0F, 0.0F, 1.0F}, axis));
	assert_float_equal(atan2(axis[1], axis[0]) / RAD, 60.0, 1e-3);
}

struct light {
	double s0, s1, s2;
};

static struct lp_stokes_reading reading_of(const struct light *light, float wheel_deg, double sigma)
{
	const struct lp_film_view view = seen_at(wheel_deg);
	struct lp_stokes_reading reading = {.sigma = (float)sigma, .misfit = 1.0F};

	assert_true(film_axis(&view, forward, reading.axis));
	reading.intensity = (float)(light->s0 + reading.axis[0] * light->s1 +
				    reading.axis[1] * light->s2 + sigma * normal());
	return reading;
}

static struct lp_polarization measure(const struct light *light, const float *angles, int count,
				      double sigma)
{
	struct lp_stokes stokes = {0};

	for (int k = 0; k < count; k++) {
		struct lp_stokes_reading r = reading_of(light, angles[k], sigma);

		r.sigma = (float)fmax(sigma, 1e-3 * light->s0);
		(void)lp_stokes_correct(&stokes, &r, 0.1F);
	}
	return lp_stokes_polarization(&stokes);
}

/* Four angles in any order, also the darkest first; of any strength. */
static void test_stokes_from_four_angles(void **state)
{
	const float orders[][4] = {{0, 45, 90, 135}, {90, 0, 135, 45}, {135, 90, 45, 0}};
	const double strengths[] = {1e-6, 1.0, 1e6};

	(void)state;
	for (int n = 0; n < 9; n++) {
		const double s0 = strengths[n / 3];
		const struct light light = {s0, 0.95 * s0, -0.2 * s0};
		const struct lp_polarization p = measure(&light, orders[n % 3], 4, 0.0);

		assert_true(p.known);
		assert_float_equal(p.s0 / s0, 1.0, 0.01);
		assert_float_equal(p.q, 0.95, 0.02);
		assert_float_equal(p.u, -0.2, 0.02);
		assert_float_equal(p.dolp, 0.971, 0.02);
		assert_float_equal(p.aolp_deg, 174.06, 0.5);
	}
}

static void test_three_angles_suffice(void **state)
{
	const struct light light = {2.0, 0.4, 0.6};
	const struct lp_polarization p = measure(&light, (const float[]){0, 60, 120}, 3, 0.0);

	(void)state;
	assert_true(p.known);
	assert_float_equal(p.q, 0.2, 0.01);
	assert_float_equal(p.u, 0.3, 0.01);
}

/* What two angles, equal angles, or none tell is not enough, and the sigmas say so. */
static void test_too_few_angles_are_not_known(void **state)
{
	const struct light light = {1.0, 0.6, 0.5};
	const float angles[][4] = {{0, 90, 0, 90}, {45, 45, 45, 45}, {30, 30.5F, 31, 31.5F}};
	const struct lp_polarization none = lp_stokes_polarization(&(struct lp_stokes){0});

	(void)state;
	assert_false(none.known);
	assert_true(isnan(none.s0));
	for (int n = 0; n < 3; n++) {
		const struct lp_polarization p = measure(&light, angles[n], 4, 0.0);

		assert_false(p.known);
		assert_true(hypotf(p.q - 0.6F, p.u - 0.5F) < 3.0F * sqrtf(p.qq + p.uu));
	}
}

/* Sigmas cover, and DoLP of unpolarized light is not biased upwards by more than its sigma. */
static void test_noise_is_covered(void **state)
{
	const struct light light = {1.0, 0.2, -0.1}, plain = {1.0, 0.0, 0.0};
	const float angles[] = {0, 45, 90, 135, 0, 45, 90, 135};
	int within = 0;
	double degree = 0.0, sigma = 0.0;

	(void)state;
	srand(2);
	for (int n = 0; n < 1000; n++) {
		const struct lp_polarization p = measure(&light, angles, 8, 0.03);
		const struct lp_polarization q = measure(&plain, angles, 8, 0.03);

		within += fabsf(p.q - 0.2F) < sqrtf(p.qq) && fabsf(p.u + 0.1F) < sqrtf(p.uu);
		degree += q.dolp / 1000.0;
		sigma += q.dolp_sigma / 1000.0;
	}
	assert_true(within > 400 && within < 800); /* 0.68^2, or more: sigmas hold what is common */
	assert_true(degree < sigma);
}

static void test_no_more_than_wholly_polarized(void **state)
{
	const struct light light = {1.0, 1.2, 0.0}; /* noise, or a moving lamp */
	const struct lp_polarization p = measure(&light, (const float[]){0, 45, 90, 135}, 4, 0.0);
	struct lp_stokes black = {0};
	const struct lp_stokes_reading none = {.intensity = -1.0F, .sigma = 0.1F};

	(void)state;
	assert_true(p.dolp <= 1.0F);
	assert_true(p.dolp_sigma > 0.15F && !p.known); /* it is of different light */
	(void)lp_stokes_correct(&black, &none, 0.0F);
	assert_false(lp_stokes_polarization(&black).known);
}

/* Another light in mid-sweep is not taken for polarization by the readings from before. */
static void test_a_change_begins_anew(void **state)
{
	const struct light before = {1.0, 0.0, 0.0}, after = {0.4, 0.0, 0.0};
	const float angles[] = {0, 45, 90, 135};
	struct lp_stokes stokes = {0};
	bool changed = false;

	(void)state;
	for (int k = 0; k < 8; k++) {
		const struct lp_stokes_reading r = reading_of(&before, angles[k % 4], 0.01);

		assert_false(lp_stokes_correct(&stokes, &r, 0.1F));
	}
	for (int k = 0; k < 8; k++) {
		const struct lp_stokes_reading r = reading_of(&after, angles[(k + 2) % 4], 0.01);

		changed |= lp_stokes_correct(&stokes, &r, 0.1F);
	}
	const struct lp_polarization p = lp_stokes_polarization(&stokes);

	assert_true(changed);
	assert_true(p.known);
	assert_float_equal(p.s0, 0.4, 0.03);
	assert_true(p.dolp < 0.05F);
}

/* Half the light goes between the second and the third angle. Four angles explain that by
 * polarization; the last one of a sweep, where the film stands as at the first, contradicts it. */
static void test_a_change_in_mid_sweep_shows_at_its_end(void **state)
{
	const struct light before = {1.0, 0.0, 0.0}, after = {0.5, 0.0, 0.0};
	struct lp_stokes stokes = {0};

	(void)state;
	for (int k = 0; k < 15; k++) { /* three exposures at each angle */
		const float wheel_deg = 45.0F * (float)(k / 3);
		const struct lp_stokes_reading r =
			reading_of(k < 6 ? &before : &after, wheel_deg, 0.005);

		(void)lp_stokes_correct(&stokes, &r, 0.05F);
		const struct lp_polarization p = lp_stokes_polarization(&stokes);

		if (k == 11)
			assert_true(p.known && p.dolp > 0.2F);
		if (k == 14)
			assert_true(!p.known || p.dolp < 0.05F);
	}
}

/* A reading of something else is left out; what is known stays. */
static void test_one_outlier_changes_nothing(void **state)
{
	const struct light light = {1.0, 0.1, 0.0}, other = {0.05, 0.0, 0.0};
	struct lp_stokes stokes = {0};

	(void)state;
	for (int k = 0; k < 40; k++) {
		const struct lp_stokes_reading r =
			reading_of(k % 10 == 9 ? &other : &light, 45.0F * (float)(k % 4), 0.01);

		assert_false(lp_stokes_correct(&stokes, &r, 0.1F));
	}
	const struct lp_polarization p = lp_stokes_polarization(&stokes);

	assert_true(p.known);
	assert_float_equal(p.s0, 1.0, 0.02);
	assert_float_equal(p.q, 0.1, 0.03);
}

/* Readings that scatter more than they say are believed less. */
static void test_scatter_shows_in_sigma(void **state)
{
	const struct light light = {1.0, 0.0, 0.0};
	struct lp_stokes stokes = {0};

	(void)state;
	srand(3);
	for (int k = 0; k < 200; k++) {
		struct lp_stokes_reading r = reading_of(&light, 45.0F * (float)(k % 4), 0.06);

		r.sigma = 0.005F;
		(void)lp_stokes_correct(&stokes, &r, 0.1F);
	}
	const struct lp_polarization p = lp_stokes_polarization(&stokes);

	assert_true(p.dolp < 3.0F * p.dolp_sigma);
}

/* While the camera turns, the first few readings are not believed. */
static void test_doubtful_readings_must_agree_for_longer(void **state)
{
	const struct light light = {1.0, 0.0, 0.0};
	struct lp_stokes stokes = {0};
	int first = 0;

	(void)state;
	for (int k = 0; k < 100; k++) {
		struct lp_stokes_reading r = reading_of(&light, 45.0F * (float)(k % 4), 0.01);

		r.misfit = 100.0F;
		(void)lp_stokes_correct(&stokes, &r, 0.03F);
		if (!first && lp_stokes_polarization(&stokes).known)
			first = k + 1;
	}
	assert_in_range(first, 4, 40); /* three suffice otherwise */
}

static void test_old_readings_fade(void **state)
{
	const struct light light = {1.0, 0.5, 0.0};
	struct lp_stokes stokes = {0};

	(void)state;
	for (int k = 0; k < 4; k++) {
		const struct lp_stokes_reading r = reading_of(&light, 45.0F * (float)k, 0.01);

		(void)lp_stokes_correct(&stokes, &r, 0.1F);
	}
	assert_true(lp_stokes_polarization(&stokes).known);
	for (int k = 0; k < 600; k++) { /* a minute at one angle */
		const struct lp_stokes_reading r = reading_of(&light, 0.0F, 0.01);

		(void)lp_stokes_correct(&stokes, &r, 0.1F);
	}
	assert_false(lp_stokes_polarization(&stokes).known);
}

/* Where the film rests between sweeps, a sweep is remembered until the next one. */
static void test_readings_last_over_a_rest(void **state)
{
	const struct light light = {1.0, 0.5, 0.0};
	struct lp_stokes stokes = {0};

	(void)state;
	for (int k = 0; k < 4; k++) {
		struct lp_stokes_reading r = reading_of(&light, 45.0F * (float)k, 0.01);

		r.rest_s = 60.0F;
		(void)lp_stokes_correct(&stokes, &r, 0.1F);
	}
	for (int k = 0; k < 600; k++) { /* a minute at one angle */
		struct lp_stokes_reading r = reading_of(&light, 0.0F, 0.01);

		r.rest_s = 60.0F;
		(void)lp_stokes_correct(&stokes, &r, 0.1F);
	}
	assert_true(lp_stokes_polarization(&stokes).known);
	assert_float_equal(lp_stokes_polarization(&stokes).dolp, 0.5, 0.03);
}

/* Equal to a measurement in the turned frame. */
static void test_a_turned_frame(void **state)
{
	const struct light light = {1.0, 0.5, 0.0}; /* AoLP 0 */
	struct lp_stokes stokes = {0};

	(void)state;
	for (int k = 0; k < 4; k++) {
		const struct lp_stokes_reading r = reading_of(&light, 45.0F * (float)k, 0.001);

		(void)lp_stokes_correct(&stokes, &r, 0.1F);
	}
	struct lp_polarization turned = lp_stokes_polarization(&stokes);

	lp_polarization_turn(&turned, (float)(20.0 * RAD));
	lp_stokes_turn(&stokes, (float)(20.0 * RAD));
	const struct lp_polarization p = lp_stokes_polarization(&stokes);

	assert_true(p.known);
	assert_float_equal(p.aolp_deg, 160.0, 0.5);
	assert_float_equal(p.dolp, 0.5, 0.01);
	/* what has been told before is turned alike */
	assert_float_equal(turned.aolp_deg, p.aolp_deg, 0.01);
	assert_float_equal(turned.q, p.q, 1e-4);
	assert_float_equal(turned.u, p.u, 1e-4);
	assert_float_equal(turned.qq / p.qq, 1.0, 1e-3);
	assert_float_equal(turned.qu, p.qu, 1e-3 * p.qq);
	assert_float_equal(turned.uu / p.uu, 1.0, 1e-3);
}

static void test_what_passes(void **state)
{
	const struct light light = {1.0, 0.5, 0.2};
	const struct lp_polarization p = measure(&light, (const float[]){0, 45, 90, 135}, 4, 0.0);
	const struct lp_stokes_reading r = reading_of(&light, 20.0F, 0.0);
	float factor, sigma;

	(void)state;
	lp_film_factor(&p, r.axis, &factor, &sigma);
	assert_float_equal(factor, r.intensity, 0.02);
	assert_true(sigma > 0.0F && sigma < 0.05F);
}

int main(void)
{
	ideal = lp_film_of_one_sheet(0.84F, 500.0F, 1.0F);
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_on_the_axis),
		cmocka_unit_test(test_an_offset_turns_the_axis),
		cmocka_unit_test(test_off_the_axis_and_turned),
		cmocka_unit_test(test_a_sheet_for_each_lens),
		cmocka_unit_test(test_stokes_from_four_angles),
		cmocka_unit_test(test_three_angles_suffice),
		cmocka_unit_test(test_too_few_angles_are_not_known),
		cmocka_unit_test(test_noise_is_covered),
		cmocka_unit_test(test_no_more_than_wholly_polarized),
		cmocka_unit_test(test_a_change_begins_anew),
		cmocka_unit_test(test_a_change_in_mid_sweep_shows_at_its_end),
		cmocka_unit_test(test_one_outlier_changes_nothing),
		cmocka_unit_test(test_scatter_shows_in_sigma),
		cmocka_unit_test(test_doubtful_readings_must_agree_for_longer),
		cmocka_unit_test(test_old_readings_fade),
		cmocka_unit_test(test_readings_last_over_a_rest),
		cmocka_unit_test(test_a_turned_frame),
		cmocka_unit_test(test_what_passes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
