/* SPDX-License-Identifier: Apache-2.0 */
/* The panorama on the six faces of a cube (light/send/cube.h). Pure functions. */
#ifndef LP_VISION_MAP_CUBE_SAMPLE_H
#define LP_VISION_MAP_CUBE_SAMPLE_H

#ifdef __cplusplus
extern "C" {
#endif

struct lp_grid;
struct lp_rotation;

/*
 * Mean radiance of `cells` (R, G, B, luminance, on `grid`) over each texel of a cube with `size`
 * (16, 32, 64) texels along an edge, one plane per channel. `rotation` turns a direction of the
 * cube into one of the grid. As many samples are taken of a small cube as of a large one:
 * LP_CUBE_MOST along each edge, each bilinear.
 */
void lp_cube_sample(const struct lp_grid *grid, const float (*cells)[4],
		    const struct lp_rotation *rotation, int size, float *const rgb[3]);

#ifdef __cplusplus
}
#endif

#endif
