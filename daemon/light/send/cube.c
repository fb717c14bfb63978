/* SPDX-License-Identifier: Apache-2.0 */
#include "light/send/cube.h"

#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "include/light_estimate.h"
#include "light/math/sh.h"

#define RAD ((float)M_PI / 180.0F)
/* Points that stand for a lamp's disc: some in each texel of the largest lamp on the finest cube. A
 * disc below this share of a texel is one point. */
#define DISC_POINTS 64
#define POINT_SHARE 0.25F
#define GOLDEN_ANGLE 2.39996323F

/* RGB9E5 (OpenGL 4.6, 8.5.2): 9 bits of mantissa, exponents biased by 15. */
#define MANTISSA_BITS 9
#define EXPONENT_BIAS 15
#define LARGEST 65408.0F /* (2^9 - 1) / 2^9 * 2^16 */
/* Light below this has a scale of its own. */
#define LEAST_SCALED (FLT_MIN * LARGEST)

/* ---------------------------------------------------------------- geometry */

/* The vector through (s, t) of a face is main + s * across + t * down. */
static const int8_t face_axes[6][3][3] = {
	{{1, 0, 0}, {0, 0, -1}, {0, -1, 0}}, {{-1, 0, 0}, {0, 0, 1}, {0, -1, 0}},
	{{0, 1, 0}, {1, 0, 0}, {0, 0, 1}},   {{0, -1, 0}, {1, 0, 0}, {0, 0, -1}},
	{{0, 0, 1}, {1, 0, 0}, {0, -1, 0}},  {{0, 0, -1}, {-1, 0, 0}, {0, -1, 0}},
};

void lp_cube_vector(int face, float s, float t, float vector[3])
{
	for (int a = 0; a < 3; a++)
		vector[a] = (float)face_axes[face][0][a] + s * (float)face_axes[face][1][a] +
			    t * (float)face_axes[face][2][a];
}

static float dot(const float a[3], const float b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static float place_of(int size, float index)
{
	return (2.0F * index + 1.0F) / (float)size - 1.0F;
}

void lp_cube_direction(int size, int texel, float direction[3])
{
	const int face = texel / (size * size), row = texel / size % size, column = texel % size;

	lp_cube_vector(face, place_of(size, (float)column), place_of(size, (float)row), direction);
	const float length = sqrtf(dot(direction, direction));

	for (int a = 0; a < 3; a++)
		direction[a] /= length;
}

/* Face and place (s, t) on it along `direction`. */
static int find_place(const float direction[3], float *s, float *t)
{
	const float x = fabsf(direction[0]), y = fabsf(direction[1]), z = fabsf(direction[2]);
	const int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
	const int face = 2 * axis + (direction[axis] < 0.0F);
	const float main = fabsf(direction[axis]);

	*s = *t = 0.0F;
	for (int a = 0; a < 3; a++) {
		*s += direction[a] * (float)face_axes[face][1][a] / main;
		*t += direction[a] * (float)face_axes[face][2][a] / main;
	}
	return face;
}

static int index_of(int size, float place)
{
	const int index = (int)floorf(0.5F * (place + 1.0F) * (float)size);

	return index < 0 ? 0 : index >= size ? size - 1 : index;
}

int lp_cube_texel(int size, const float direction[3])
{
	float s, t;
	const int face = find_place(direction, &s, &t);

	return (face * size + index_of(size, t)) * size + index_of(size, s);
}

/* Solid angle of the rectangle from the centre of a face to (s, t): the integral of
 * (1 + s^2 + t^2)^-3/2. */
static double corner_solid_angle(double s, double t)
{
	return atan2(s * t, sqrt(s * s + t * t + 1.0));
}

static double texel_solid_angle(int size, int row, int column)
{
	const double left = 2.0 * column / size - 1.0, right = 2.0 * (column + 1) / size - 1.0;
	const double top = 2.0 * row / size - 1.0, bottom = 2.0 * (row + 1) / size - 1.0;

	return corner_solid_angle(right, bottom) - corner_solid_angle(left, bottom) -
	       corner_solid_angle(right, top) + corner_solid_angle(left, top);
}

/* ---------------------------------------------------------------- grid */

void lp_cube_grid_destroy(struct lp_cube_grid *grid)
{
	if (!grid)
		return;
	for (int i = 0; i < LP_CUBE_BANDS; i++)
		free(grid->basis[i]);
	free(grid->solid_angle_sr);
	free(grid);
}

static void fill_grid(struct lp_cube_grid *grid)
{
	const int size = grid->size;
	double y[LP_CUBE_BANDS];
	float direction[3];

	for (int i = 0; i < grid->texels; i++) {
		lp_cube_direction(size, i, direction);
		lp_sh_basis(2, (const double[]){direction[0], direction[1], direction[2]}, y);
		for (int k = 0; k < LP_CUBE_BANDS; k++)
			grid->basis[k][i] = (float)y[k];
		grid->solid_angle_sr[i] = (float)texel_solid_angle(size, i / size % size, i % size);
	}
}

static float *new_plane(int texels)
{
	return aligned_alloc(16, (size_t)texels * sizeof(float));
}

int lp_cube_grid_create(int size, struct lp_cube_grid **grid)
{
	struct lp_cube_grid *self;
	bool complete;

	if (size != 16 && size != 32 && size != 64)
		return -EINVAL;
	self = calloc(1, sizeof(*self));
	if (!self)
		return -ENOMEM;
	self->size = size;
	self->texels = LP_CUBE_TEXELS(size);
	self->solid_angle_sr = new_plane(self->texels);
	complete = self->solid_angle_sr;
	for (int k = 0; k < LP_CUBE_BANDS; k++) {
		self->basis[k] = new_plane(self->texels);
		complete = complete && self->basis[k];
	}
	if (!complete) {
		lp_cube_grid_destroy(self);
		return -ENOMEM;
	}
	fill_grid(self);
	*grid = self;
	return 0;
}

/* ---------------------------------------------------------------- lights */

/* Two unit vectors across `direction` and each other. */
static void tangents(const float direction[3], float x[3], float y[3])
{
	const int least = fabsf(direction[0]) < 0.6F ? 0 : 1;
	float length;

	for (int a = 0; a < 3; a++)
		x[a] = (float)(a == least) - direction[least] * direction[a];
	length = sqrtf(dot(x, x));
	for (int a = 0; a < 3; a++)
		x[a] /= length;
	for (int a = 0; a < 3; a++)
		y[a] = direction[(a + 1) % 3] * x[(a + 2) % 3] -
		       direction[(a + 2) % 3] * x[(a + 1) % 3];
}

/* Spread flux over the four texels around `direction` so that its centroid stays there. Beyond the
 * edge of a face the plane goes on, which leads to the neighbouring face. */
static void add_point(struct lp_cube *cube, const float direction[3], const float flux[3])
{
	const int size = cube->grid->size;
	float s, t, corner[3];
	const int face = find_place(direction, &s, &t);
	const float u = 0.5F * (s + 1.0F) * (float)size - 0.5F, left = floorf(u);
	const float v = 0.5F * (t + 1.0F) * (float)size - 0.5F, top = floorf(v);

	for (int k = 0; k < 4; k++) {
		const int right = k % 2, below = k / 2;
		const float share =
			(right ? u - left : left + 1.0F - u) * (below ? v - top : top + 1.0F - v);

		lp_cube_vector(face, place_of(size, left + (float)right),
			       place_of(size, top + (float)below), corner);
		const int texel = lp_cube_texel(size, corner);

		for (int c = 0; c < 3; c++)
			cube->rgb[c][texel] += share * flux[c] / cube->grid->solid_angle_sr[texel];
	}
}

void lp_cube_add_light(struct lp_cube *cube, const struct lp_light *light,
		       const float irradiance[3])
{
	const float radius = light->angular_radius_deg * RAD;
	const float texel = (float)M_PI / 2.0F / (float)cube->grid->size;
	const int points = radius < POINT_SHARE * texel ? 1 : DISC_POINTS;
	float x[3], y[3], point[3], flux[3];

	for (int c = 0; c < 3; c++)
		flux[c] = irradiance[c] / (float)points;
	if (points == 1) {
		add_point(cube, light->direction, flux);
		return;
	}
	tangents(light->direction, x, y);
	for (int k = 0; k < points; k++) {
		/* Vogel's spiral: even over the disc */
		const float turn = (float)k * GOLDEN_ANGLE;
		const float off = radius * sqrtf(((float)k + 0.5F) / (float)points);

		for (int a = 0; a < 3; a++)
			point[a] = cosf(off) * light->direction[a] +
				   sinf(off) * (cosf(turn) * x[a] + sinf(turn) * y[a]);
		add_point(cube, point, flux);
	}
}

/* Squared distance from the light's centre; 1 on its edge. */
static float place_in_light(const struct lp_light *light, const float direction[3], float margin)
{
	const float *const axis = light->axis;
	const float cosine = dot(light->direction, direction);
	float across[3], a, b;

	if (cosine <= 0.0F)
		return INFINITY;
	if (!(light->flags & LP_LIGHT_EXTENDED)) {
		a = light->angular_radius_deg * RAD + margin;
		return (2.0F - 2.0F * cosine) / (a * a);
	}
	for (int k = 0; k < 3; k++)
		across[k] = light->direction[(k + 1) % 3] * axis[(k + 2) % 3] -
			    light->direction[(k + 2) % 3] * axis[(k + 1) % 3];
	a = asinf(fminf(fabsf(dot(axis, direction)), 1.0F)) /
	    (light->half_angle_deg[0] * RAD + margin);
	b = asinf(fminf(fabsf(dot(across, direction)), 1.0F)) /
	    (light->half_angle_deg[1] * RAD + margin);
	return a * a + b * b;
}

void lp_cube_take_light(struct lp_cube *cube, const struct lp_light *light,
			const float irradiance[3])
{
	const struct lp_cube_grid *grid = cube->grid;
	const float margin = (float)M_PI / 4.0F / (float)grid->size; /* half a texel */
	float flux[3] = {0.0F}, direction[3], keep[3];

	for (int pass = 0; pass < 2; pass++) {
		for (int i = 0; i < grid->texels; i++) {
			lp_cube_direction(grid->size, i, direction);
			if (place_in_light(light, direction, margin) > 1.0F)
				continue;
			for (int c = 0; c < 3; c++) {
				if (pass)
					cube->rgb[c][i] *= keep[c];
				else
					flux[c] += cube->rgb[c][i] * grid->solid_angle_sr[i];
			}
		}
		for (int c = 0; c < 3; c++)
			keep[c] = flux[c] > irradiance[c] ? 1.0F - irradiance[c] / flux[c] : 0.0F;
	}
}

void lp_cube_shrink(const struct lp_cube *from, struct lp_cube *to)
{
	const int size = to->grid->size, step = from->grid->size / size;

	for (int i = 0; i < to->grid->texels; i++) {
		const int row = i / size,
			  column = i % size; /* rows of all faces, one after another */
		float sum[3] = {0.0F}, weight = 0.0F;

		for (int k = 0; k < step * step; k++) {
			const int at =
				(row * step + k / step) * step * size + column * step + k % step;
			const float w = from->grid->solid_angle_sr[at];

			weight += w;
			for (int c = 0; c < 3; c++)
				sum[c] += w * from->rgb[c][at];
		}
		for (int c = 0; c < 3; c++)
			to->rgb[c][i] = sum[c] / weight;
	}
}

/* ---------------------------------------------------------------- RGB9E5 */

/* Of two numbers, neither NAN: fmaxf() would be a call. */
static inline float larger(float a, float b)
{
	return a > b ? a : b;
}

static float largest_of(const struct lp_cube *cube)
{
	float largest = 0.0F;

	for (int c = 0; c < 3; c++)
		for (int i = 0; i < cube->grid->texels; i++) {
			if (!(fabsf(cube->rgb[c][i]) <= FLT_MAX)) /* NAN, too */
				return INFINITY;
			largest = larger(largest, cube->rgb[c][i]);
		}
	return largest;
}

/* 2^exponent, -126..127. */
static float power_of_2(int exponent)
{
	const uint32_t bits = (uint32_t)(exponent + 127) << 23;
	float power;

	memcpy(&power, &bits, sizeof(power));
	return power;
}

/* The least e with value < 2^e; value > 0. */
static int exponent_of(float value)
{
	uint32_t bits;

	memcpy(&bits, &value, sizeof(bits));
	return (int)(bits >> 23) - 126;
}

/* Values up to LARGEST; those below 0 are 0. */
static uint32_t encode_texel(const float rgb[3])
{
	const float most = larger(larger(rgb[0], rgb[1]), rgb[2]);
	const int least = -EXPONENT_BIAS;
	uint32_t bits = 0;
	int exponent = most > 0.0F ? exponent_of(most) : least;

	exponent = exponent < least ? least : exponent;
	/* what rounds up to the next power of 2 */
	exponent += most * power_of_2(MANTISSA_BITS - exponent) + 0.5F >= 1 << MANTISSA_BITS;
	for (int c = 0; c < 3; c++) {
		const float steps = rgb[c] * power_of_2(MANTISSA_BITS - exponent);

		bits |= (uint32_t)(larger(steps, 0.0F) + 0.5F) << (MANTISSA_BITS * c);
	}
	return bits | (uint32_t)(exponent + EXPONENT_BIAS) << (3 * MANTISSA_BITS);
}

float lp_cube_encode(const struct lp_cube *cube, uint8_t *texels)
{
	const float largest = largest_of(cube);
	float scale = 1.0F, rgb[3];

	if (isinf(largest))
		return -1.0F;
	if (largest >= LEAST_SCALED)
		scale = power_of_2(exponent_of(largest / LARGEST));
	else if (largest > 0.0F)
		scale = FLT_MIN;
	const float by = 1.0F / scale; /* exact: a power of 2 */

	for (int i = 0; i < cube->grid->texels; i++) {
		for (int c = 0; c < 3; c++)
			rgb[c] = cube->rgb[c][i] * by;
		const uint32_t bits = encode_texel(rgb);

		for (int k = 0; k < 4; k++)
			texels[4 * i + k] = (uint8_t)(bits >> (8 * k));
	}
	return scale;
}
