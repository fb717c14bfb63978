/* SPDX-License-Identifier: Apache-2.0 */
/* The normal equations that the parts really solve, where what they ask can hardly be told: how
 * ill-conditioned they are, and what double leaves of the answer against long double. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "figure.h"
#include "light/clipped/ring_residuals.h"
#include "light/linear/cholesky.h"
#include "light/linear/nnls.h"
#include "light/math/grid.h"
#include "light/place/room.h"
#include "light/place/room_fit.h"
#include "random_normal.h"

#define MOST LP_NNLS_MAX
#define SWEEPS 40

/* Each unknown in a unit of its own, as Cholesky's method does not care for units. */
static void scale(int size, long double m[MOST][MOST])
{
	long double by[MOST];

	for (int i = 0; i < size; i++)
		by[i] = 1.0L / sqrtl(m[i][i]);
	for (int i = 0; i < size; i++)
		for (int j = 0; j < size; j++)
			m[i][j] *= by[i] * by[j];
}

/* Largest over smallest eigenvalue, by Jacobi's rotations. */
static double condition_of(int size, long double m[MOST][MOST])
{
	long double least = INFINITY, most = 0.0L;

	scale(size, m);
	for (int turn = 0; turn < SWEEPS * size * size; turn++) {
		const int p = turn % size, q = turn / size % size;

		if (p >= q || m[p][q] == 0.0L)
			continue;
		const long double theta = (m[q][q] - m[p][p]) / (2.0L * m[p][q]);
		const long double t =
			(theta < 0.0L ? -1.0L : 1.0L) / (fabsl(theta) + hypotl(theta, 1.0L));
		const long double c = 1.0L / hypotl(t, 1.0L), s = t * c;

		for (int k = 0; k < size; k++) {
			const long double kp = m[k][p], kq = m[k][q];

			m[k][p] = c * kp - s * kq;
			m[k][q] = s * kp + c * kq;
		}
		for (int k = 0; k < size; k++) {
			const long double pk = m[p][k], qk = m[q][k];

			m[p][k] = c * pk - s * qk;
			m[q][k] = s * pk + c * qk;
		}
	}
	for (int i = 0; i < size; i++) {
		least = fminl(least, m[i][i]);
		most = fmaxl(most, m[i][i]);
	}
	return (double)(most / least);
}

/* The diagonal of the inverse, by elimination without square roots. */
static void variances_of(int size, long double m[MOST][MOST], long double *variance)
{
	for (int unknown = 0; unknown < size; unknown++) {
		long double a[MOST][MOST + 1];

		for (int i = 0; i < size; i++) {
			memcpy(a[i], m[i], sizeof(m[i]));
			a[i][size] = i == unknown;
		}
		for (int k = 0; k < size; k++)
			for (int i = 0; i < size; i++) {
				const long double by = a[i][k] / a[k][k];

				for (int j = k; i != k && j <= size; j++)
					a[i][j] -= by * a[k][j];
			}
		variance[unknown] = a[unknown][size] / a[unknown][unknown];
	}
}

/* ---------------------------------------------------------------- the room */

/* Places of all views within so many metres of the first. */
static struct lp_room_guess weighed(double reach_m)
{
	static struct lp_room_views views;
	struct lp_room_guess guess = {0};
	struct lp_room *room;

	assert_int_equal(lp_room_create(&room), 0);
	views = (struct lp_room_views){.grid = lp_room_grid(room), .count = LP_ROOM_MOST_VIEWS};
	for (int k = 0; k < views.count; k++) {
		for (int a = 0; k && a < 3; a++)
			views.list[k].position_m[a] = reach_m * sin(1.7 * k + 2.0 * a);
		for (int i = 0; i < LP_COARSE_CELLS; i++)
			views.list[k].cells[i] =
				0.5F + 0.3F * sinf(0.4F * (float)(i % LP_COARSE_COLUMNS)) *
					       cosf(0.3F * (float)(i / LP_COARSE_COLUMNS));
	}
	for (int w = 0; w < 6; w++)
		guess.at[w] = log(1.0 + 0.5 * w);
	lp_room_weigh(&views, &guess);
	lp_room_destroy(room);
	return guess;
}

static void test_the_room(void **state)
{
	static const double reaches_m[] = {0.0, 1e-6, 1e-3, 0.3, 30.0};

	(void)state;
	for (int k = 0; k < 5; k++) {
		const struct lp_room_guess guess = weighed(reaches_m[k]);
		long double m[MOST][MOST], variance[MOST];
		double worst = 0.0, x[LP_ROOM_SIZE];
		char input[80];

		for (int i = 0; i < LP_ROOM_SIZE; i++)
			for (int j = 0; j < LP_ROOM_SIZE; j++)
				m[i][j] = guess.normal[i][j];
		variances_of(LP_ROOM_SIZE, m, variance);
		for (int i = 0; i < LP_ROOM_SIZE; i++) {
			double of[LP_ROOM_SIZE] = {0.0};

			of[i] = 1.0;
			assert_true(lp_cholesky_solve(LP_ROOM_SIZE, guess.normal[0], of, x));
			worst = fmax(worst, fabs((double)(x[i] / variance[i]) - 1.0));
		}
		const double condition = condition_of(LP_ROOM_SIZE, m);

		(void)snprintf(input, sizeof(input), "pictures within %g m, condition %.1g",
			       reaches_m[k], condition);
		figure("normal equations of the room", input, "variance, relative", worst,
		       16.0 * DBL_EPSILON * condition);
	}
}

/* ---------------------------------------------------------------- the ring */

/* Nine readings of sixteen parts that lie within an angle of each other, each seen by its cosine.
 */
static struct lp_nnls normal_of(double apart_rad, double *hidden)
{
	struct lp_ring_view view = {.count = LP_MAX_CLIPPED_PARTS, .seen_sigma = 0.02F};
	struct lp_ring_sample sample = {.t_ns = 1};
	const struct lp_ring_problem problem = {.view = &view,
						.sample = &sample,
						.scale = {1.0F, 0.02F}};
	double bound[LP_NNLS_MAX] = {0.0};
	struct lp_ring_fit fit;
	struct lp_nnls normal;

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		view.seen[k] = sample.illuminance_lux[k] = 1.0F;
		sample.sigma_relative[k] = 0.03F;
	}
	for (int j = 0; j < view.count; j++) {
		const double turn = 0.4 + apart_rad * (j - view.count / 2.0);
		const float d[3] = {(float)(0.8 * sin(turn)), 0.6F, (float)(-0.8 * cos(turn))};

		view.parts[j].bound = 0.1F;
		for (int k = 0; k < LP_RING_SENSORS; k++) {
			float n[3];

			lp_ring_direction(k, n);
			view.parts[j].weight[k] =
				fmaxf(n[0] * d[0] + n[1] * d[1] + n[2] * d[2], 0.0F);
			sample.illuminance_lux[k] += 10.0F * view.parts[j].weight[k];
		}
	}
	lp_ring_fit(&problem, (1U << LP_RING_SENSORS) - 1U, &fit);
	lp_ring_normal(&problem, &fit, &normal, bound);
	*hidden = 0.0;
	for (int j = 0; j < view.count; j++)
		*hidden += fit.x[j + 1] / fit.x[0] / 10.0 / view.count;
	return normal;
}

static void test_the_ring(void **state)
{
	static const double apart_rad[] = {0.3, 1e-3, 1e-8, 0.0};

	(void)state;
	for (int k = 0; k < 4; k++) {
		const double all[LP_NNLS_MAX] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
		double worst = 0.0, hidden;
		const struct lp_nnls normal = normal_of(apart_rad[k], &hidden);
		long double m[MOST][MOST], variance[MOST];
		char input[80];

		for (int i = 0; i < normal.count; i++)
			for (int j = 0; j < normal.count; j++)
				m[i][j] = normal.normal[i][j];
		variances_of(normal.count, m, variance);
		for (int i = 0; i < normal.count; i++)
			worst = fmax(worst,
				     fabs(lp_nnls_variance(&normal, all, i) / (double)variance[i] -
					  1.0));
		const double condition = condition_of(normal.count, m);

		(void)snprintf(input, sizeof(input), "16 parts %g rad apart, condition %.1g",
			       apart_rad[k], condition);
		figure("normal equations of the ring", input, "variance, relative", worst,
		       16.0 * DBL_EPSILON * condition);
		figure("normal equations of the ring", input, "sum of all parts, relative",
		       fabs(hidden - 1.0), 0.1);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_the_room),
		cmocka_unit_test(test_the_ring),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
