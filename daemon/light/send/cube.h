/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Light on the six faces of a cube around the probe: what a shiny surface mirrors.
 *
 * Faces come in the order +X -X +Y -Y +Z -Z, each with its rows and columns as OpenGL, WebGL and
 * WebXR want them (OpenGL 4.6, table 8.19). Texel (column s, row t), in -1..1 from the first to the
 * last, looks along
 *
 *   +X ( 1, -t, -s)   -X (-1, -t,  s)   +Y (s,  1,  t)
 *   -Y ( s, -1, -t)   +Z ( s, -t,  1)   -Z (-s, -t, -1)
 *
 * in a frame with +X right, +Y up, -Z forward (docs/users/conventions.md). Pure functions on plain
 * storage; a grid is immutable and may be read from any thread.
 */
#ifndef LP_LIGHT_SEND_CUBE_H
#define LP_LIGHT_SEND_CUBE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_light;

#define LP_CUBE_LEAST 16
#define LP_CUBE_MOST 64 /* texels along an edge: more is not in a panorama of 240 x 120 cells */
#define LP_CUBE_TEXELS(size) (6 * (size) * (size))
#define LP_CUBE_MOST_TEXELS LP_CUBE_TEXELS(LP_CUBE_MOST)
#define LP_CUBE_BANDS 9 /* coefficients that lp_cube_fit() holds to: up to order 2 */

struct lp_cube_grid {
	int size, texels;
	float *solid_angle_sr;	     /* per texel, exact; sums to 4 pi */
	float *basis[LP_CUBE_BANDS]; /* per texel: lp_sh_basis() along its centre */
};

/* Radiance, one plane per channel, `texels` floats each, 16-byte aligned; owned by the caller. */
struct lp_cube {
	const struct lp_cube_grid *grid; /* borrowed */
	float *rgb[3];
};

/* -EINVAL unless size is 16, 32 or 64; -ENOMEM. */
int lp_cube_grid_create(int size, struct lp_cube_grid **grid);
void lp_cube_grid_destroy(struct lp_cube_grid *grid); /* accepts NULL */

/* A vector (not of unit length) from the probe through the place (s, t) of a face. */
void lp_cube_vector(int face, float s, float t, float vector[3]);

/* Unit vector through the centre of a texel. */
void lp_cube_direction(int size, int texel, float direction[3]);

/* Texel that contains `direction` (any length > 0). */
int lp_cube_texel(int size, const float direction[3]);

/* Add a disc of the light's direction and radius that brings `irradiance` at normal incidence. Its
 * centroid is kept to a fraction of a texel. */
void lp_cube_add_light(struct lp_cube *cube, const struct lp_light *light,
		       const float irradiance[3]);

/* Take `irradiance` out of the texels that the light covers, as far as there is so much in them. */
void lp_cube_take_light(struct lp_cube *cube, const struct lp_light *light,
			const float irradiance[3]);

/*
 * Change the radiance, smoothly and as little as needed, so that its projection onto spherical
 * harmonics up to order 2 becomes `sh`, and with it the irradiance on every surface. Radiance stays
 * above 0; light without which that cannot be (much more than the cube holds) is added evenly all
 * around.
 */
void lp_cube_fit(struct lp_cube *cube, const double (*sh)[3]);

/* Add the cube's projection, times `scale`, to the coefficients up to order 2. */
void lp_cube_project(const struct lp_cube *cube, double scale, double (*sh)[3]);

/* Mean of each block of texels of a cube whose edge is a multiple, weighed by solid angle. */
void lp_cube_shrink(const struct lp_cube *from, struct lp_cube *to);

/*
 * Texels as RGB9E5 (OpenGL 4.6, 8.5.2: R, G, B of 9 bits and an exponent of 5 bits, from the lowest
 * bit upwards), little-endian, 4 bytes each. Radiance is the returned scale, a power of 2, times
 * what they say. -1: a texel is not finite.
 */
float lp_cube_encode(const struct lp_cube *cube, uint8_t *texels);

#ifdef __cplusplus
}
#endif

#endif
