/* SPDX-License-Identifier: Apache-2.0 */
#include "light/math/rotation.h"

#include <math.h>

#include "light/math/quadrature.h"
#include "light/math/sh.h"

struct lp_rotation lp_rotation_identity(void)
{
	return (struct lp_rotation){.m = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}};
}

bool lp_rotation_is_identity(const struct lp_rotation *rotation)
{
	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			if (rotation->m[i][j] != (i == j ? 1.0 : 0.0))
				return false;
	return true;
}

struct lp_rotation lp_rotation_of_quaternion(const double quaternion[4])
{
	const double x = quaternion[0], y = quaternion[1], z = quaternion[2], w = quaternion[3];
	const double s = 2.0 / (x * x + y * y + z * z + w * w);

	return (struct lp_rotation){
		.m = {{1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)},
		      {s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)},
		      {s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)}}};
}

struct lp_rotation lp_rotation_of_vector(const double vector[3])
{
	const double angle =
		sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
	const double scale = angle > 1e-12 ? sin(angle / 2.0) / angle : 0.5;

	return lp_rotation_of_quaternion((const double[]){scale * vector[0], scale * vector[1],
							  scale * vector[2], cos(angle / 2.0)});
}

/* The unit quaternion of a rotation, from the largest of its four squares (Shepperd 1978). */
void lp_rotation_quaternion(const struct lp_rotation *r, double q[4])
{
	const double trace = r->m[0][0] + r->m[1][1] + r->m[2][2];
	int largest = 3;
	double most = trace;

	for (int a = 0; a < 3; a++)
		if (r->m[a][a] > most) {
			most = r->m[a][a];
			largest = a;
		}
	const int i = largest, j = (i + 1) % 3, k = (i + 2) % 3;

	if (largest == 3) {
		const double w = sqrt(1.0 + trace), by = 0.5 / w;

		q[0] = (r->m[2][1] - r->m[1][2]) * by;
		q[1] = (r->m[0][2] - r->m[2][0]) * by;
		q[2] = (r->m[1][0] - r->m[0][1]) * by;
		q[3] = 0.5 * w;
		return;
	}
	const double root = sqrt(1.0 + 2.0 * most - trace), half = 0.5 / root;

	q[i] = 0.5 * root;
	q[j] = (r->m[i][j] + r->m[j][i]) * half;
	q[k] = (r->m[i][k] + r->m[k][i]) * half;
	q[3] = (r->m[k][j] - r->m[j][k]) * half;
}

void lp_rotation_vector(const struct lp_rotation *rotation, double vector[3])
{
	double q[4];

	lp_rotation_quaternion(rotation, q);
	const double sine = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]);
	const double sign = q[3] < 0.0 ? -1.0 : 1.0; /* the shorter way round */
	const double scale = sign * (sine > 1e-12 ? 2.0 * atan2(sine, sign * q[3]) / sine : 2.0);

	for (int a = 0; a < 3; a++)
		vector[a] = scale * q[a];
}

struct lp_rotation lp_rotation_product(const struct lp_rotation *outer,
				       const struct lp_rotation *inner)
{
	struct lp_rotation product = {0};
	double q[4];

	if (lp_rotation_is_identity(outer))
		return *inner;
	if (lp_rotation_is_identity(inner))
		return *outer;
	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			for (int k = 0; k < 3; k++)
				product.m[i][j] += outer->m[i][k] * inner->m[k][j];
	lp_rotation_quaternion(&product, q);
	return lp_rotation_of_quaternion(q);
}

struct lp_rotation lp_rotation_inverse(const struct lp_rotation *rotation)
{
	struct lp_rotation inverse;

	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			inverse.m[i][j] = rotation->m[j][i];
	return inverse;
}

void lp_rotate(const struct lp_rotation *rotation, const double from[3], double to[3])
{
	for (int i = 0; i < 3; i++)
		to[i] = rotation->m[i][0] * from[0] + rotation->m[i][1] * from[1] +
			rotation->m[i][2] * from[2];
}

void lp_rotate_direction(const struct lp_rotation *rotation, float direction[3])
{
	const double from[3] = {direction[0], direction[1], direction[2]};
	double to[3];

	if (lp_rotation_is_identity(rotation))
		return;
	lp_rotate(rotation, from, to);
	for (int a = 0; a < 3; a++)
		direction[a] = (float)to[a];
}

void lp_sh_rotate(const struct lp_rotation *rotation, int order, float (*sh)[3])
{
	const struct lp_rotation back = lp_rotation_inverse(rotation);
	const int count = (order + 1) * (order + 1), nodes = order + 1, azimuths = 2 * order + 2;
	double node[LP_SH_MAX_ORDER + 1] = {0.0}, weight[LP_SH_MAX_ORDER + 1] = {0.0};
	double turned[LP_SH_MAX_COUNT][3] = {0};

	if (lp_rotation_is_identity(rotation))
		return;
	lp_gauss_legendre(nodes, node, weight);
	/* Of two nodes opposite each other one is enough: bands of even degree are the same in
	 * both, those of odd degree have the other sign. */
	for (int k = 0; k < nodes * azimuths / 2; k++) {
		const double z = node[k / azimuths], sine = sqrt(1.0 - z * z);
		const double phi = 2.0 * M_PI * (k % azimuths) / azimuths;
		const double to[3] = {sine * cos(phi), sine * sin(phi), z};
		const double share = weight[k / azimuths] * 4.0 * M_PI / azimuths;
		double from[3], y[LP_SH_MAX_COUNT], light[2][3] = {{0.0}};

		lp_rotate(&back, to, from);
		lp_sh_basis(order, from, y);
		for (int l = 0; l <= order; l++)
			for (int i = l * l; i < (l + 1) * (l + 1); i++)
				for (int c = 0; c < 3; c++)
					light[l % 2][c] += y[i] * sh[i][c];
		lp_sh_basis(order, to, y);
		for (int l = 0; l <= order; l++)
			for (int i = l * l; i < (l + 1) * (l + 1); i++)
				for (int c = 0; c < 3; c++)
					turned[i][c] += share * y[i] * light[l % 2][c];
	}
	for (int i = 0; i < count; i++)
		for (int c = 0; c < 3; c++)
			sh[i][c] = (float)turned[i][c];
}
