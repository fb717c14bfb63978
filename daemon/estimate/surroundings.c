/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/surroundings.h"

#include <math.h>
#include <string.h>

#include "include/panorama.h"
#include "light/find/lamps.h"
#include "light/lamps/lamp_memory.h"
#include "light/math/grid.h"
#include "vision/map/cube_sample.h"

/* The lamp of this light as the newest panorama shows it; NULL: it does not. */
static const struct lp_lamp *lamp_of(const struct lp_lamp_memory *memory,
				     const struct lp_light *light)
{
	for (int k = 0; k < LP_MAX_LAMPS; k++) {
		const struct lp_remembered_lamp *m = &memory->list[k];

		if (m->id == light->id)
			return m->seen ? &m->on_grid : NULL;
	}
	return NULL;
}

void lp_surroundings_look(struct lp_surroundings *surroundings, const struct lp_view_of_lamps *view,
			  const struct lp_light_estimate *estimate, float (*cells)[4])
{
	const struct lp_panorama *panorama = view->panorama;
	float *const planes[3] = {surroundings->rgb[0], surroundings->rgb[1], surroundings->rgb[2]};

	memcpy(cells, panorama->cells,
	       (size_t)panorama->width * (size_t)panorama->height * sizeof(*cells));
	surroundings->kept_count = 0;
	for (int k = 0; k < estimate->light_count; k++) {
		const struct lp_light *light = &estimate->lights[k];
		const struct lp_lamp *lamp = lamp_of(view->memory, light);

		if (!lamp || (light->flags & LP_LIGHT_EXTENDED)) {
			surroundings->kept[surroundings->kept_count++] = light->id;
			continue;
		}
		for (int i = 0; i < lamp->count; i++)
			for (int c = 0; c < 4; c++)
				cells[view->finder->cells[lamp->first + i]][c] =
					fmaxf(lamp->background[c], 0.0F);
	}
	lp_cube_sample(view->grid, (const float(*)[4])cells, view->rotation, surroundings->size,
		       planes);
}
