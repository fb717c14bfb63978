/* SPDX-License-Identifier: Apache-2.0 */
/* Polarization at its ends: light that is wholly polarized, or none; angles that coincide; float32
 * against long double; lamps at the poles. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "figure.h"
#include "light/film/polarization.h"
#include "light/film/reflection.h"
#include "random_normal.h"

#define RAD (M_PI / 180.0)
#define MANY 1000000

static const float odd[] = {NAN,    INFINITY, -INFINITY, 0.0F,	-1.0F,
			    1e-45F, 1e-38F,   1e-20F,	 1e20F, 3e38F};

static struct lp_stokes_reading reading_of(double s0, double q, double u, double wheel_deg,
					   double diattenuation)
{
	const double x = diattenuation * cos(2.0 * wheel_deg * RAD),
		     y = diattenuation * sin(2.0 * wheel_deg * RAD);

	return (struct lp_stokes_reading){.intensity = (float)(s0 * (1.0 + x * q + y * u)),
					  .sigma = (float)(0.005 * s0),
					  .axis = {(float)x, (float)y},
					  .misfit = 1.0F};
}

/* What is stated is finite, or said not to be known. */
static void assert_sane(const struct lp_polarization *p)
{
	const float all[] = {p->q,	    p->u,	 p->qq,
			     p->qu,	    p->uu,	 p->dolp,
			     p->dolp_sigma, p->aolp_deg, p->aolp_sigma_deg};

	ASSERT_FINITE(all);
	assert_true(p->dolp >= 0.0F && p->dolp <= 1.0F);
	assert_true(p->aolp_deg >= 0.0F && p->aolp_deg <= 180.0F);
	assert_true(p->dolp_sigma > 0.0F);
	assert_true(isnan(p->s0) || (isfinite(p->s0) && p->s0 > 0.0F));
	assert_false(p->known && isnan(p->s0));
}

/* ---------------------------------------------------------------- Stokes parameters */

/* Wholly polarized light, along, across and between the film's angles. */
static void test_wholly_polarized(void **state)
{
	double worst = 0.0;

	(void)state;
	for (int e = -12; e <= 12; e += 4)
		for (int angle = 0; angle < 180; angle += 15)
			for (int perfect = 0; perfect < 2; perfect++) {
				const double q = cos(2.0 * angle * RAD), u = sin(2.0 * angle * RAD);
				const double d = perfect ? 1.0 : 499.0 / 501.0;
				struct lp_stokes stokes = {0};

				for (int round = 0; round < 4; round++)
					for (int deg = 0; deg < 180; deg += 45) {
						const struct lp_stokes_reading r =
							reading_of(pow(10.0, e), q, u, deg, d);

						(void)lp_stokes_correct(&stokes, &r, 0.1F);
					}
				const struct lp_polarization p = lp_stokes_polarization(&stokes);

				assert_sane(&p);
				worst = fmax(worst, hypot(p.q - q, p.u - u) / p.dolp_sigma);
				if (p.known)
					worst = fmax(worst, fabs(1.0 - p.dolp) / p.dolp_sigma);
			}
	figure("polarization", "wholly polarized, light 1e-12 … 1e12", "S1, S2, DoLP, sigmas",
	       worst, 3.0);
}

/* The same sums in long double, solved by Cramer's rule on the differences of angles. */
static void solve_exactly(const struct lp_stokes_reading *readings, int count, long double scale,
			  long double s[3])
{
	long double m[3][4] = {{0.0L}};

	for (int k = 0; k < count; k++) {
		const long double h[4] = {1.0L, readings[k].axis[0], readings[k].axis[1],
					  readings[k].intensity};
		const long double film = 0.015L * scale;
		const long double w =
			1.0L / ((long double)readings[k].sigma * readings[k].sigma + film * film);

		for (int i = 0; i < 3; i++)
			for (int j = 0; j < 4; j++)
				m[i][j] += w * h[i] * h[j];
	}
	for (int i = 1; i < 3; i++)
		m[i][i] += 1.0L / (0.25L * scale * scale);
	for (int k = 0; k < 3; k++) /* positive definite: no rows need to be exchanged */
		for (int i = 0; i < 3; i++) {
			const long double by = m[i][k] / m[k][k];

			for (int j = 0; i != k && j < 4; j++)
				m[i][j] -= by * m[k][j];
		}
	for (int i = 0; i < 3; i++)
		s[i] = m[i][3] / m[i][i];
}

/* Of the matrix of three angles, relative to that of S0. */
static double condition_of(double step_deg)
{
	/* (1, cos 2a, sin 2a) at -step, 0, +step: eigenvalues by powers would hide the smallest */
	double h[3][3], squares = 0.0, determinant;

	for (int k = 0; k < 3; k++) {
		h[k][0] = 1.0;
		h[k][1] = cos(2.0 * (k - 1) * step_deg * RAD);
		h[k][2] = sin(2.0 * (k - 1) * step_deg * RAD);
		squares += 2.0;
	}
	determinant = h[0][0] * (h[1][1] * h[2][2] - h[1][2] * h[2][1]) -
		      h[0][1] * (h[1][0] * h[2][2] - h[1][2] * h[2][0]) +
		      h[0][2] * (h[1][0] * h[2][1] - h[1][1] * h[2][0]);
	return pow(squares, 3.0) / (determinant * determinant); /* an upper bound, of H' H */
}

/* Sums in float32 against long double, relative to the sigma that is stated. */
static void test_float_against_double(void **state)
{
	static const double steps_deg[] = {60.0, 20.0, 5.0, 1.0, 0.0};

	(void)state;
	for (int k = 0; k < 5; k++) {
		double worst = 0.0;
		bool known = false;
		char input[80];

		for (int trial = 0; trial < 100; trial++) {
			struct lp_stokes_reading readings[30];
			struct lp_stokes stokes = {0};
			long double s[3], scale = 0.0L;

			for (int n = 0; n < 30; n++) {
				readings[n] = reading_of(1.0, 0.4, -0.3,
							 30.0 + (n % 3 - 1) * steps_deg[k], 0.996);
				readings[n].intensity *= 1.0F + 0.003F * random_normal();
				scale = fmaxl(scale, readings[n].intensity);
			}
			stokes.scale = (float)scale;
			for (int n = 0; n < 30; n++)
				(void)lp_stokes_correct(&stokes, &readings[n], 0.0F);
			solve_exactly(readings, 30, scale, s);
			const struct lp_polarization p = lp_stokes_polarization(&stokes);

			assert_sane(&p);
			known |= p.known;
			worst = fmax(worst, hypot((double)(p.q - s[1] / s[0]) / sqrt(p.qq),
						  (double)(p.u - s[2] / s[0]) / sqrt(p.uu)));
		}
		(void)snprintf(input, sizeof(input), "angles %g° apart, condition %s%.0e",
			       steps_deg[k], k ? "≤ " : "", condition_of(steps_deg[k]));
		figure("polarization", input, "float32 against long double, sigmas", worst, 0.2);
		assert_true(steps_deg[k] > 10.0 || !known); /* angles that coincide tell nothing */
	}
}

/* Readings without sense, or beyond all light: nothing is known of them, and nothing remembered. */
static void test_odd_readings(void **state)
{
	(void)state;
	for (size_t o = 0; o < LP_COUNT(odd); o++)
		for (int field = 0; field < 5; field++) {
			struct lp_stokes stokes = {0};

			for (int round = 0; round < 40; round++)
				for (int deg = 0; deg < 180; deg += 45) {
					struct lp_stokes_reading r =
						reading_of(1.0, 0.3, 0.2, deg, 0.996);
					const bool is_odd =
						field == 4 ? round == 0 : round == 2 && deg == 45;
					float elapsed_s = 0.1F;

					if (is_odd && (field == 0 || field == 4)) {
						r.intensity = odd[o];
						r.sigma = 0.005F * odd[o];
					}
					if (is_odd && field == 1)
						r.sigma = odd[o];
					if (is_odd && field == 2)
						elapsed_s = odd[o];
					if (is_odd && field == 3)
						r.misfit = fmaxf(odd[o], 0.0F);
					(void)lp_stokes_correct(&stokes, &r, elapsed_s);
					const struct lp_polarization p =
						lp_stokes_polarization(&stokes);

					assert_sane(&p);
				}
			const struct lp_polarization p = lp_stokes_polarization(&stokes);

			if (!p.known || fabs(p.q - 0.3) > 0.05 || fabs(p.u - 0.2) > 0.05)
				fail_msg("field %d, %g: known %d, %g %g", field, (double)odd[o],
					 p.known, (double)p.q, (double)p.u);
		}
}

static void test_a_million_readings(void **state)
{
	struct lp_stokes stokes = {0};
	double worst = 0.0;

	(void)state;
	for (int n = 0; n < MANY; n++) {
		struct lp_stokes_reading r = reading_of(1.0, 0.6, -0.2, 45.0 * (n % 4), 0.996);

		r.intensity *= 1.0F + 0.003F * random_normal();
		(void)lp_stokes_correct(&stokes, &r, 0.033F);
		/* the head turns and turns back: the frame of the lamp goes with it */
		lp_stokes_turn(&stokes, n % 2 ? 0.3F : -0.3F);
		if (n % 2 == 0 || n % 1000 != 999)
			continue;
		const struct lp_polarization p = lp_stokes_polarization(&stokes);

		assert_sane(&p);
	}
	stokes = (struct lp_stokes){0};
	for (int n = 0; n < MANY; n++) {
		const struct lp_stokes_reading r =
			reading_of(1.0, 0.6, -0.2, 45.0 * (n % 4), 0.996);

		(void)lp_stokes_correct(&stokes, &r, 0.033F);
		if (n > 100 && n % 1000 == 0) {
			const struct lp_polarization p = lp_stokes_polarization(&stokes);

			worst = fmax(worst, hypot(p.q - 0.6, p.u + 0.2));
		}
	}
	figure("polarization", "1e6 readings", "S1, S2 of S0", worst, 1e-3);
}

/* ---------------------------------------------------------------- the sheet */

/* Any angle of the wheel, however far it has gone round, and any direction. */
static void test_the_sheet_anywhere(void **state)
{
	static const float directions[][3] = {{0, 0, -1},     {0, 0, 1},      {0, 1, 0},
					      {0, -1, 0},     {1, 0, 0},      {-1, 0, 0},
					      {0, 1, -1e-7F}, {1e-20F, 1, 0}, {0.6F, 0.8F, 0}};
	const struct lp_rotation none = lp_rotation_identity();
	static const float extinctions[] = {1.0F, 1.0001F, 500.0F, 1e30F};
	double worst = 0.0;

	(void)state;
	for (int e = 0; e < 4; e++)
		for (int n = 0; n < 2; n++) {
			const struct lp_film film =
				lp_film_of_one_sheet(0.8F, extinctions[e], n ? 1.5F : 1.0F);

			for (size_t d = 0; d < LP_COUNT(directions); d++)
				for (int deg = -720; deg <= 720; deg += 30) {
					const struct lp_film_view view =
						lp_film_seen(&film, (float)deg, &none);
					const struct lp_film_view round =
						lp_film_seen(&film, (float)deg + 36000.0F, &none);
					const struct lp_film_pass a =
						lp_film_pass(&view, directions[d]);
					const struct lp_film_pass b =
						lp_film_pass(&round, directions[d]);
					float turned[2];

					ASSERT_FINITE(a.axis);
					assert_true(isfinite(a.gain) && a.gain > 0.0F);
					assert_true(hypotf(a.axis[0], a.axis[1]) <= 1.0001F);
					worst = fmax(worst, fabs((double)a.gain - b.gain));
					worst = fmax(worst, fabs((double)a.axis[0] - b.axis[0]));
					lp_film_turned(&view, directions[d], turned);
					ASSERT_FINITE(turned);
				}
		}
	figure("film", "wheel 100 turns on, all directions and poles", "gain, axis", worst, 1e-4);
}

/* ---------------------------------------------------------------- mirror images */

static struct lp_suspect any_suspect(void)
{
	struct lp_suspect s = {.irradiance = 1.0F, .radius_deg = 1.0F};
	float length = 0.0F;

	for (int a = 0; a < 3; a++) {
		s.direction[a] = random_normal();
		length += s.direction[a] * s.direction[a];
	}
	for (int a = 0; a < 3; a++)
		s.direction[a] /= sqrtf(length);
	s.polarization = (struct lp_polarization){
		.s0 = 1.0F, .q = 0.3F, .u = -0.2F, .qq = 1e-3F, .uu = 1e-3F, .known = true};
	return s;
}

/* Unit vectors of float32 may be longer than 1; lamps may be dark, or hold all light. */
static void test_odd_suspects(void **state)
{
	static const float poles[][3] = {{0, 1.0000001F, 0},
					 {0, -1.0000001F, 0},
					 {0, 0, -1.0000001F},
					 {1e-8F, 1.0000002F, 0}};
	static const float strengths[] = {0.0F, 1e-45F, 1e-38F, 1e38F, 3e38F};

	(void)state;
	for (int trial = 0; trial < 4000; trial++) {
		struct lp_suspect suspects[8];
		struct lp_verdict verdicts[8];

		for (int k = 0; k < 8; k++) {
			suspects[k] = any_suspect();
			if (trial % 2 && k % 3 == 0)
				memcpy(suspects[k].direction, poles[(trial / 2 + k) % 4],
				       sizeof(poles[0]));
			if (trial % 3 == 0)
				suspects[k].irradiance = strengths[(trial + k) % 5];
			if (trial % 5 == 0 && k)
				memcpy(suspects[k].direction, suspects[0].direction,
				       sizeof(poles[0]));
			suspects[k].is_bound = (trial + k) % 4 == 0;
			suspects[k].polarization.known = trial % 7 != 0;
			if (trial % 11 == 0) { /* wholly polarized, and wholly certain */
				suspects[k].polarization.q = 1.0F;
				suspects[k].polarization.u = 0.0F;
				suspects[k].polarization.qq = suspects[k].polarization.uu = 0.0F;
			}
		}
		lp_tell_reflections(suspects, 8, verdicts);
		for (int k = 0; k < 8; k++)
			if (!(verdicts[k].reflection >= 0.0F && verdicts[k].reflection <= 1.0F))
				fail_msg("trial %d: %g", trial, (double)verdicts[k].reflection);
		assert_true(isfinite(lp_film_turned_evidence(suspects, 8)));
	}
}

static void test_fresnel_at_its_ends(void **state)
{
	(void)state;
	for (int k = 0; k <= 1000; k++) {
		const struct lp_fresnel f = lp_fresnel((float)k / 1000.0F);

		assert_true(f.reflectance >= 0.0F && f.reflectance <= 1.000001F);
		assert_true(f.dolp >= -1e-6F && f.dolp <= 1.000001F);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_wholly_polarized),
		cmocka_unit_test(test_float_against_double),
		cmocka_unit_test(test_odd_readings),
		cmocka_unit_test(test_a_million_readings),
		cmocka_unit_test(test_the_sheet_anywhere),
		cmocka_unit_test(test_odd_suspects),
		cmocka_unit_test(test_fresnel_at_its_ends),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
