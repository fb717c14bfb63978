/* SPDX-License-Identifier: Apache-2.0 */
/* What a flat sheet with two surfaces lets pass: against Fresnel's equations, ray by ray. */
#include "light/film/sheet.h"

#include <math.h>
#include <stdlib.h>

#include "lp_test.h"

#define RAD (M_PI / 180.0)

static double uniform(void)
{
	return rand() / (double)RAND_MAX;
}

static void cross(const double a[3], const double b[3], double product[3])
{
	for (int i = 0; i < 3; i++)
		product[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static double dot(const double a[3], const double b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Amplitudes (across, along the plane of incidence) that pass from index n1 to n2, and are
 * mirrored; c1, c2: cosines there. */
static void fresnel(double n1, double c1, double n2, double c2, double t[2], double r[2])
{
	t[0] = 2.0 * n1 * c1 / (n1 * c1 + n2 * c2);
	t[1] = 2.0 * n1 * c1 / (n2 * c1 + n1 * c2);
	r[0] = (n1 * c1 - n2 * c2) / (n1 * c1 + n2 * c2);
	r[1] = (n2 * c1 - n1 * c2) / (n2 * c1 + n1 * c2);
}

struct ray {
	double passed;	 /* of unpolarized light, without absorption inside */
	double field[3]; /* what passes was polarized so, unit vector */
};

/* What passes along e, across (0) and along (1) the plane of incidence, from direction k. */
static void passing(const double k[3], const double s[3], const double a[3], double e[2])
{
	double field[3], p[3];

	cross(k, a, field);
	cross(s, k, p);
	const double length = sqrt(dot(field, field));

	e[0] = dot(field, s) / length;
	e[1] = dot(field, p) / length;
}

/* Straight from the equations: a sheet across z that absorbs along a; d from above it. 200 ways to
 * and fro are added up one by one. */
static struct ray trace(const double d[3], const double a[3], double index)
{
	const double n[3] = {0.0, 0.0, 1.0}, c = d[2], sine = sqrt(1.0 - c * c);
	const double inner_c = sqrt(1.0 - sine * sine / (index * index));
	const double k[3] = {d[0] / index, d[1] / index, inner_c}, back[3] = {k[0], k[1], -inner_c};
	double s[3], p[3], e[2], e_back[2], in[2], out[2], mirrored[2], unused[2];
	struct ray ray = {0};

	cross(n, d, s);
	for (int i = 0; i < 3; i++)
		s[i] /= sine;
	cross(s, d, p);
	passing(k, s, a, e);
	passing(back, s, a, e_back);
	fresnel(1.0, c, index, inner_c, in, unused);
	fresnel(index, inner_c, 1.0, c, out, mirrored);
	const double u[2] = {in[0] * e[0], in[1] * e[1]};
	const double enters = (u[0] * u[0] + u[1] * u[1]) / 2.0;
	const double leaves = pow(out[0] * e[0], 2) + pow(out[1] * e[1], 2);
	const double turn = mirrored[0] * e[0] * e_back[0] + mirrored[1] * e[1] * e_back[1];
	double inside = enters;

	for (int way = 0; way < 200; way++, inside *= pow(turn, 4))
		ray.passed += inside * leaves;
	for (int i = 0; i < 3; i++)
		ray.field[i] = (u[0] * s[i] + u[1] * p[i]) / sqrt(2.0 * enters);
	return ray;
}

static double share_ahead(double index)
{
	const double r = pow((index - 1.0) / (index + 1.0), 2);

	return (1.0 - r) * (1.0 - r) / (1.0 - r * r) / 2.0;
}

/* The same in the daemon's frame, in which the normal is -Z. */
static struct lp_film_pass seen(float index, double wheel_deg, const double d[3])
{
	const struct lp_film film = lp_film_of_one_sheet(0.84F, 1e9F, index);
	const struct lp_rotation none = lp_rotation_identity();
	const struct lp_film_view view = lp_film_seen(&film, (float)wheel_deg, &none);
	const float direction[3] = {(float)d[0], (float)d[1], -(float)d[2]};

	return lp_film_pass(&view, direction);
}

static void test_rays_by_fresnels_equations(void **state)
{
	(void)state;
	srand(1);
	for (int k = 0; k < 3000; k++) {
		const double off = 74.9 * RAD * uniform() + 1e-3, round = 2.0 * M_PI * uniform();
		const double wheel = M_PI * uniform(), index = 1.0 + uniform();
		const double d[3] = {sin(off) * cos(round), sin(off) * sin(round), cos(off)};
		/* n x p is p a quarter turn on, seen from either side */
		const double a[3] = {-sin(wheel), cos(wheel), 0.0};
		const struct ray ray = trace(d, a, index);
		const struct lp_film_pass pass = seen((float)index, wheel / RAD, d);
		const float direction[3] = {(float)d[0], (float)d[1], -(float)d[2]};
		float right[3], up[3];
		double x = 0.0, y = 0.0;

		lp_stokes_frame(direction, right, up);
		for (int i = 0; i < 3; i++) {
			x += right[i] * (i == 2 ? -ray.field[i] : ray.field[i]);
			y += up[i] * (i == 2 ? -ray.field[i] : ray.field[i]);
		}
		assert_true(pass.polarizes);
		assert_float_equal(pass.gain, ray.passed / share_ahead(index), 2e-4);
		assert_float_equal(pass.axis[0], x * x - y * y, 1e-3);
		assert_float_equal(pass.axis[1], 2.0 * x * y, 1e-3);
		assert_true(ray.passed <= 0.5 + 1e-9); /* none is made */
	}
}

/* What a sweep would call DoLP of unpolarized light: (1 - Rs)^2 against (1 - Rp)^2 of acrylic, N
 * = 1.49 gives 0.086, 0.186 and 0.355. What is mirrored inside brings some of it back. */
static void test_how_polarized_unpolarized_light_seems(void **state)
{
	static const double off_deg[3] = {45.0, 60.0, 74.0}, dolp[3] = {0.086, 0.186, 0.355};

	(void)state;
	for (int k = 0; k < 3; k++) {
		const double c = cos(off_deg[k] * RAD), d[3] = {sin(off_deg[k] * RAD), 0.0, c};
		const double inner_c = sqrt(1.0 - (1.0 - c * c) / (1.49 * 1.49));
		double t[2], r[2];

		fresnel(1.0, c, 1.49, inner_c, t, r);
		const double s = pow(1.0 - r[0] * r[0], 2), p = pow(1.0 - r[1] * r[1], 2);
		const double within_s = s / (1.0 - pow(r[0], 4)),
			     within_p = p / (1.0 - pow(r[1], 4));

		assert_float_equal((p - s) / (p + s), dolp[k], 0.001);
		assert_float_equal(seen(1.49F, 0.0, d).gain, within_p / 2.0 / share_ahead(1.49),
				   1e-4);
		assert_float_equal(seen(1.49F, 90.0, d).gain, within_s / 2.0 / share_ahead(1.49),
				   1e-4);
	}
}

static void test_both_sides_are_alike_and_nothing_breaks(void **state)
{
	static const double off_deg[] = {0.0, 1e-5, 0.01, 30.0, 74.0, 76.0, 89.99, 90.0};

	(void)state;
	for (size_t k = 0; k < sizeof(off_deg) / sizeof(*off_deg); k++)
		for (int wheel = 0; wheel < 180; wheel += 15) {
			const double x = sin(off_deg[k] * RAD), z = cos(off_deg[k] * RAD);
			const struct lp_film_pass one = seen(1.5F, wheel, (double[]){x, 0.0, z});
			const struct lp_film_pass other = seen(1.5F, wheel, (double[]){-x, 0.0, z});
			const struct lp_film_pass ideal = seen(1.0F, wheel, (double[]){x, 0.0, z});
			const struct lp_film_pass behind =
				seen(1.5F, wheel, (double[]){x, 0.0, -z});

			assert_true(isfinite(one.axis[0]) && isfinite(one.axis[1]));
			assert_float_equal(one.gain, other.gain, 1e-5);
			assert_float_equal(one.gain, behind.gain, 1e-5);
			assert_float_equal(ideal.gain, 1.0, 1e-5);
			assert_true(one.gain > 0.4F && one.gain < 1.1F);
			assert_int_equal(one.polarizes, off_deg[k] < 75.0);
			if (off_deg[k] < 1.0)
				assert_float_equal(one.gain, 1.0, 1e-4);
		}
}

/* Nobody knows where the wheel stands: the mean over its angles. */
static void test_an_unknown_angle(void **state)
{
	const struct lp_film film = lp_film_of_one_sheet(0.84F, 500.0F, 1.5F);
	const struct lp_rotation none = lp_rotation_identity();
	const struct lp_film_view view = lp_film_seen(&film, NAN, &none);

	(void)state;
	for (double off_deg = 0.0; off_deg < 90.0; off_deg += 6.0) {
		const double d[3] = {sin(off_deg * RAD), 0.0, cos(off_deg * RAD)};
		const float direction[3] = {(float)d[0], 0.0F, -(float)d[2]};
		const struct lp_film_pass pass = lp_film_pass(&view, direction);
		double sum = 0.0, squares = 0.0;

		for (int wheel = 0; wheel < 180; wheel++) {
			const double one = seen(1.5F, wheel, d).gain;

			sum += one / 180.0;
			squares += one * one / 180.0;
		}
		assert_false(pass.polarizes);
		assert_float_equal(pass.gain, sum, 2e-3);
		assert_float_equal(pass.gain_sigma, sqrt(fmax(squares - sum * sum, 0.0)) / sum,
				   5e-3);
	}
}

/* By the simulator's Polarizer.through_stack(), 40 degrees off the axis and turned round it. */
static void test_a_stack(void **state)
{
	static const float expected[4] = {1.2040F, 1.2579F, 0.7574F, 0.7256F};
	struct lp_film film = lp_film_of_one_sheet(0.135F, 500.0F, 1.5F);
	const struct lp_rotation none = lp_rotation_identity();
	const struct lp_film_view view = lp_film_seen(&film, NAN, &none);
	const float ahead[3] = {0.0F, 0.0F, -1.0F};

	(void)state;
	film.is_stack = true;
	assert_float_equal(lp_film_pass(&view, ahead).gain, 1.0, 1e-5);
	for (int k = 0; k < 4; k++) {
		const double round = (20.0 + 45.0 * k) * RAD;
		const float direction[3] = {(float)(sin(40.0 * RAD) * cos(round)),
					    (float)(sin(40.0 * RAD) * sin(round)),
					    (float)((k % 2 ? 1.0 : -1.0) * cos(40.0 * RAD))};
		const struct lp_film_pass pass = lp_film_pass(&view, direction);

		assert_false(pass.polarizes);
		assert_float_equal(pass.gain, expected[k], 2e-3);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_rays_by_fresnels_equations),
		cmocka_unit_test(test_how_polarized_unpolarized_light_seems),
		cmocka_unit_test(test_both_sides_are_alike_and_nothing_breaks),
		cmocka_unit_test(test_an_unknown_angle),
		cmocka_unit_test(test_a_stack),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
