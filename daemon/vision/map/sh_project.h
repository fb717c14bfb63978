/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Projection of the small panorama onto spherical harmonics, exact for radiance that is constant
 * over each cell: the basis is integrated over the cells in closed form, not sampled at their
 * centres, so a uniform sphere gives its radiance and nothing else.
 */
#ifndef LP_VISION_MAP_SH_PROJECT_H
#define LP_VISION_MAP_SH_PROJECT_H

#ifdef __cplusplus
extern "C" {
#endif

struct lp_panorama;
struct lp_sh_projector; /* tables of one grid size; immutable: any thread */

/* -EINVAL: width no multiple of 8, beyond LP_PANORAMA_MAX_WIDTH, or order beyond LP_SH_MAX_ORDER.
 */
int lp_sh_projector_create(int width, int height, int order, struct lp_sh_projector **projector);
void lp_sh_projector_destroy(struct lp_sh_projector *projector); /* accepts NULL */

/* sh[(order + 1)^2][3] = integral of radiance * Y_i; order at most the projector's. */
void lp_sh_project(const struct lp_sh_projector *projector, const struct lp_panorama *panorama,
		   int order, double (*sh)[3]);

#ifdef __cplusplus
}
#endif

#endif
