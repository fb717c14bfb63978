/* SPDX-License-Identifier: Apache-2.0 */
#include "app/lamp_stage.h"

#include <math.h>
#include <string.h>

#include "include/luminance.h"
#include "include/panorama.h"
#include "light/detection.h"
#include "light/grid.h"
#include "light/rotation.h"
#include "vision/imager.h"

#define DEG (180.0F / (float)M_PI)
/* What the wire can say. */
#define LEAST_IRRADIANCE_SIGMA 0.001F
/* A lamp that detection misses no longer than this still shines where a cell is as bright as this
 * share of its peak. Chosen by hand. */
#define LONGEST_MISS_S 0.3F
#define STILL_THERE 0.5F

static float radius_rad(const struct lp_lamp *lamp)
{
	/* of Omega = 4 pi sin^2(r / 2): exact for tiny ones */
	return 2.0F * asinf(fminf(sqrtf(lamp->solid_angle_sr / (4.0F * (float)M_PI)), 1.0F));
}

/* Lamps are looked at in full resolution, the small ones that the grid misplaces above all. */
static void look_closer(const struct lp_lamp_memory *memory, struct lp_imager *imager,
			const struct lp_detection *detection, const struct lp_lamp_stage_work *work,
			int index, struct lp_lamp_sighting *sighting)
{
	const struct lp_lamp_finder *finder = detection->finder;
	struct lp_lamp *pixels = &sighting->pixels;

	sighting->on_grid = *pixels = finder->lamps[index];
	sighting->enters = lp_detection_enters(detection, pixels);
	sighting->refined = index < work->wanted_lights && work->refine_cells &&
			    (sighting->enters || lp_lamp_memory_knows(memory, pixels)) &&
			    lp_imager_refine(imager, finder, pixels, work->refine_cells);
	const float noise = pixels->background_noise * pixels->solid_angle_sr /
			    fmaxf(pixels->irradiance[LP_LUMINANCE], 1e-30F);

	sighting->scale = lp_imager_scale(imager);
	sighting->strength_sigma = fmaxf(hypotf(lp_imager_strength_sigma(imager, pixels), noise),
					 LEAST_IRRADIANCE_SIGMA);
}

void lp_lamp_stage_steer(struct lp_lamp_stage *stage, struct lp_imager *imager,
			 const struct lp_detection *detection,
			 const struct lp_lamp_stage_work *work)
{
	struct lp_lamp_sighting sightings[LP_MAX_LIGHTS];
	struct lp_imager_status status;
	double pull[3], information[3][3];
	int count = 0;

	lp_imager_status(imager, &status);
	if (!(status.rotation_sigma_deg > 0.0F) || !work->refine_cells)
		return;
	for (int k = 0; k < LP_MAX_LAMPS && count < work->wanted_lights; k++) {
		const struct lp_remembered_lamp *m = &stage->memory.list[k];
		struct lp_lamp_sighting *s = &sightings[count];

		if (!m->id || !m->seen || !m->measured)
			continue;
		s->pixels = m->on_grid;
		s->refined =
			lp_imager_refine(imager, detection->finder, &s->pixels, work->refine_cells);
		count += s->refined;
	}
	if (lp_lamp_memory_landmarks(&stage->memory, sightings, count,
				     status.rotation_sigma_deg / DEG, pull, information))
		lp_imager_correct_rotation(imager, pull, (const double(*)[3])information);
}

void lp_lamp_stage_update(struct lp_lamp_stage *stage, struct lp_imager *imager,
			  const struct lp_detection *detection,
			  const struct lp_lamp_stage_work *work, int64_t t_capture_ns)
{
	const struct lp_lamp_finder *finder = detection->finder;
	struct lp_lamp_sighting sightings[LP_MAX_LAMPS];
	struct lp_imager_status status;
	const int64_t elapsed_ns = stage->t_ns ? t_capture_ns - stage->t_ns : 0;

	lp_imager_status(imager, &status);
	for (int k = 0; k < finder->count; k++)
		look_closer(&stage->memory, imager, detection, work, k, &sightings[k]);
	const struct lp_memory_times times = {.elapsed_s = elapsed_ns > 0 ? (float)elapsed_ns / 1e9F
									  : 0.0F,
					      .rotation_sigma_rad =
						      status.rotation_sigma_deg / DEG};

	lp_lamp_memory_update(&stage->memory, sightings, finder->count, &times);
	stage->t_ns = t_capture_ns;
}

/* Whether a lamp is there: detection may miss one that is on its threshold. */
static bool shines(const struct lp_grid *grid, const struct lp_panorama *panorama,
		   const struct lp_remembered_lamp *m)
{
	const int cell = lp_grid_cell(grid, m->on_grid.direction);

	return m->seen || (m->absent_s < LONGEST_MISS_S &&
			   panorama->cells[cell][LP_LUMINANCE] > STILL_THERE * m->on_grid.peak);
}

/* Remembered lamps that shine, strongest first; returns how many. */
static int strongest(const struct lp_lamp_stage *stage, const struct lp_grid *grid,
		     const struct lp_panorama *panorama,
		     const struct lp_remembered_lamp *list[LP_MAX_LAMPS])
{
	int count = 0;

	for (int k = 0; k < LP_MAX_LAMPS; k++) {
		const struct lp_remembered_lamp *m = &stage->memory.list[k];
		int at = count;

		if (!m->id || !shines(grid, panorama, m))
			continue;
		for (; at > 0 && list[at - 1]->lamp.irradiance[LP_LUMINANCE] <
					 m->lamp.irradiance[LP_LUMINANCE];
		     at--)
			list[at] = list[at - 1];
		list[at] = m;
		count++;
	}
	return count;
}

static float confidence_of(const struct lp_lamp *lamp)
{
	const float surround = fmaxf(lamp->background[LP_LUMINANCE], 0.0F);

	return lamp->peak > 0.0F ? fminf(fmaxf(1.0F - surround / lamp->peak, 0.0F), 1.0F) : 0.0F;
}

static void list_light(const struct lp_remembered_lamp *m, struct lp_light *light)
{
	const struct lp_lamp *lamp = &m->lamp;

	memcpy(light->direction, lamp->direction, sizeof(light->direction));
	memcpy(light->irradiance, lamp->irradiance, sizeof(light->irradiance));
	light->id = m->id;
	light->angular_radius_deg = radius_rad(lamp) * DEG;
	light->direction_sigma_deg = lamp->direction_sigma_deg;
	light->irradiance_sigma =
		lamp->flags & LP_LIGHT_CLIPPED
			? NAN /* a lower bound has no sigma */
			: fmaxf(sqrtf(m->strength_variance), LEAST_IRRADIANCE_SIGMA);
	light->confidence = confidence_of(lamp);
	light->distance_m = NAN;
	light->flags = lamp->flags | (m->seen ? 0 : LP_LIGHT_HELD);
}

int lp_lamp_stage_list(const struct lp_lamp_stage *stage, const struct lp_grid *grid,
		       const struct lp_panorama *panorama, int most,
		       struct lp_light lights[LP_MAX_LIGHTS])
{
	const struct lp_remembered_lamp *lamps[LP_MAX_LAMPS];
	const int count = strongest(stage, grid, panorama, lamps);

	for (int k = 0; k < count && k < most; k++)
		list_light(lamps[k], &lights[k]);
	return count;
}
