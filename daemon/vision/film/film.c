/* SPDX-License-Identifier: Apache-2.0 */
/* A polarizing film in front of the lens: what its angles tell, and frames without it. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "include/luminance.h"
#include "include/polarization_grid.h"
#include "light/find/lamps.h"
#include "light/math/grid.h"
#include "vision/film/stokes_map.h"
#include "vision/imager_internal.h"

void lp_imager_place_film(struct lp_imager *imager)
{
	if (imager->film.stokes)
		imager->film.view = lp_film_seen(&imager->options.film, imager->film.wheel_deg,
						 &imager->turn.motion.rotation);
}

int lp_imager_create_film(struct lp_imager *imager)
{
	const struct lp_film *film = &imager->options.film;
	const size_t cells = (size_t)imager->grid->width * (size_t)imager->grid->height;

	if (!(film->gain > 0.0F))
		return 0;
	if (film->index > 1.0F || film->is_stack) {
		imager->film.over = calloc(cells, sizeof(*imager->film.over));
		imager->film.over_deg = INFINITY;
		if (!imager->film.over)
			return -ENOMEM;
	}
	const int ret = lp_stokes_map_create(imager->grid, &imager->film.stokes);

	imager->film.wheel_deg = NAN;
	lp_imager_place_film(imager);
	return ret;
}

/* In the camera's frame, in which the film stays when the camera turns. */
static struct lp_film_view own_view(const struct lp_imager *imager)
{
	const struct lp_rotation none = lp_rotation_identity();

	return lp_film_seen(&imager->options.film, imager->film.wheel_deg, &none);
}

void lp_imager_leave_out(struct lp_imager *imager, const struct lp_rotation *to_map,
			 struct lp_observation *seen)
{
	const struct lp_film_view view = own_view(imager);

	lp_stokes_map_leave_out(imager->film.stokes, &view, to_map, seen);
}

const float *lp_imager_over_film(struct lp_imager *imager)
{
	const float deg = imager->film.wheel_deg, done_deg = imager->film.over_deg;

	if (!imager->film.over || deg == done_deg || (isnan(deg) && isnan(done_deg)))
		return imager->film.over;
	const struct lp_film_view view = own_view(imager);

	for (int i = 0; i < imager->grid->width * imager->grid->height; i++) {
		float direction[3];

		lp_grid_direction(imager->grid, i, direction);
		imager->film.over[i] = 1.0F / lp_film_pass(&view, direction).gain;
	}
	imager->film.over_deg = deg;
	return imager->film.over;
}

float lp_imager_film_gain(const struct lp_imager *imager, const float direction[3])
{
	if (!imager->film.over)
		return 1.0F;
	const struct lp_film_view view = own_view(imager);

	return lp_film_pass(&view, direction).gain;
}

const struct lp_film_view *lp_imager_film(const struct lp_imager *imager)
{
	return imager->film.stokes ? &imager->film.view : NULL;
}

struct lp_polarization lp_imager_polarization(const struct lp_imager *imager,
					      const struct lp_lamp_finder *finder,
					      const struct lp_lamp *lamp)
{
	if (!imager->film.stokes)
		return lp_stokes_polarization(&(struct lp_stokes){0});
	return lp_stokes_map_of(imager->film.stokes, (const float(*)[4])imager->map->radiance,
				lamp->background[LP_LUMINANCE], finder->cells + lamp->first,
				lamp->count);
}

bool lp_imager_film_seems_turned(const struct lp_imager *imager)
{
	return imager->film.stokes && (lp_stokes_map_surfaces_seem_turned(imager->film.stokes) ||
				       lp_stokes_map_floor_is_upright(imager->film.stokes));
}

bool lp_imager_polarization_grid(const struct lp_imager *imager, struct lp_polarization_grid *grid)
{
	if (!imager->film.stokes)
		return false;
	grid->t_capture_ns = imager->panorama.t_capture_ns;
	lp_stokes_map_picture(imager->film.stokes, lp_imager_rotation(imager), grid);
	return true;
}

void lp_imager_see_through(struct lp_imager *imager, struct lp_observation *seen)
{
	static const float forward[3] = {0.0F, 0.0F, -1.0F};
	struct lp_stokes_reading unpolarized = {.intensity = 1.0F, .sigma = 0.02F, .misfit = 1.0F};
	float ahead[3];

	if (!imager->film.stokes)
		return;
	lp_imager_place_film(imager);
	memcpy(ahead, forward, sizeof(ahead));
	lp_rotate_direction(&imager->turn.motion.rotation, ahead);
	const struct lp_film_pass pass = lp_film_pass(&imager->film.view, ahead);

	unpolarized.rest_s = imager->options.film.rest_s;
	memcpy(unpolarized.axis, pass.axis, sizeof(unpolarized.axis));
	if (pass.polarizes)
		(void)lp_stokes_correct(&imager->film.angles, &unpolarized, seen->elapsed_s);
	if (imager->film.view.angle_known)
		lp_stokes_map_learn(imager->film.stokes, &imager->film.view, seen);
	lp_stokes_map_see_through(imager->film.stokes, &imager->film.view, seen);
}
