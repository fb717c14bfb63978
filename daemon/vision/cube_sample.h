/* SPDX-License-Identifier: Apache-2.0 */
/* The panorama on the six faces of a cube (light/cube.h). Pure functions. */
#ifndef LP_VISION_CUBE_SAMPLE_H
#define LP_VISION_CUBE_SAMPLE_H

#ifdef __cplusplus
extern "C" {
#endif

struct lp_cube;
struct lp_grid;
struct lp_rotation;

/*
 * Fill the cube with the mean radiance over each texel of `cells` (R, G, B, luminance, on `grid`).
 * `rotation` turns a direction of the cube into one of the grid. As many samples are taken of a
 * small cube as of a large one: LP_CUBE_MOST along each edge, each bilinear.
 */
void lp_cube_sample(const struct lp_grid *grid, const float (*cells)[4],
		    const struct lp_rotation *rotation, struct lp_cube *cube);

#ifdef __cplusplus
}
#endif

#endif
