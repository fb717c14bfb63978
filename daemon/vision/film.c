/* SPDX-License-Identifier: Apache-2.0 */
/* A polarizing film in front of the lens: what its angles tell, and frames without it. */
#include <math.h>
#include <string.h>

#include "include/luminance.h"
#include "include/polarization_grid.h"
#include "light/lamps.h"
#include "vision/imager_internal.h"
#include "vision/stokes_map.h"

void lp_imager_place_film(struct lp_imager *imager)
{
	const bool known = imager->stokes && !isnan(imager->wheel_deg);

	memset(&imager->film, 0, sizeof(imager->film));
	if (known)
		imager->film = lp_film_seen(&imager->options.film, imager->wheel_deg,
					    &imager->motion.rotation);
}

const struct lp_film_view *lp_imager_film(const struct lp_imager *imager)
{
	return imager->film.sheet_count ? &imager->film : NULL;
}

struct lp_polarization lp_imager_polarization(const struct lp_imager *imager,
					      const struct lp_lamp_finder *finder,
					      const struct lp_lamp *lamp)
{
	if (!imager->stokes)
		return lp_stokes_polarization(&(struct lp_stokes){0});
	return lp_stokes_map_of(imager->stokes, (const float(*)[4])imager->map->radiance,
				lamp->background[LP_LUMINANCE], finder->cells + lamp->first,
				lamp->count);
}

bool lp_imager_floor_is_upright(const struct lp_imager *imager)
{
	return imager->stokes && lp_stokes_map_floor_is_upright(imager->stokes);
}

bool lp_imager_polarization_grid(const struct lp_imager *imager, struct lp_polarization_grid *grid)
{
	if (!imager->stokes)
		return false;
	grid->t_capture_ns = imager->panorama.t_capture_ns;
	lp_stokes_map_picture(imager->stokes, lp_imager_rotation(imager), grid);
	return true;
}

void lp_imager_see_through(struct lp_imager *imager, struct lp_observation *seen)
{
	static const float forward[3] = {0.0F, 0.0F, -1.0F};
	struct lp_stokes_reading unpolarized = {.intensity = 1.0F, .sigma = 0.02F, .misfit = 1.0F};
	float ahead[3];

	lp_imager_place_film(imager);
	if (imager->stokes && !imager->film.sheet_count)
		lp_stokes_map_see_through(imager->stokes, NULL, seen);
	if (!imager->film.sheet_count)
		return;
	memcpy(ahead, forward, sizeof(ahead));
	lp_rotate_direction(&imager->motion.rotation, ahead);
	unpolarized.rest_s = imager->film.rest_s;
	if (lp_film_axis(&imager->film, ahead, unpolarized.axis))
		(void)lp_stokes_correct(&imager->angles, &unpolarized, seen->elapsed_s);
	lp_stokes_map_learn(imager->stokes, &imager->film, seen);
	lp_stokes_map_see_through(imager->stokes, &imager->film, seen);
}
