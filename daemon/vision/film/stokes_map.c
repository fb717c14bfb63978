/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/film/stokes_map.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "include/luminance.h"
#include "include/panorama.h"
#include "light/math/grid.h"
#include "vision/map/radiance_map.h"

/* Chosen by hand. */
/* A cell's own noise, relative. */
#define CELL_SIGMA 0.02F
/* A cell of a turned camera lies anyhow over those of the map: variance of where, in cells^2. */
#define BETWEEN_CELLS2 (1.0F / 12.0F)
/* Of S1/S0 of light whose polarization is not known: most of it has less. With more the map would
 * not follow the lamps of a camera that turns. */
#define UNKNOWN_SIGMA 0.15F
/* A cell that the map knows to be brighter or darker than its S0 by this factor was read clipped,
 * or mixed with its neighbours: its S1 and S2 are of other light. Chosen by hand. */
#define MOST_APART 1.5F
/* Light that is more polarized than this is not compared with the map, nor what the film makes
 * brighter and darker by more, at an angle that is not known: what is not known of it would turn
 * the picture, as all of a floor errs alike. Looked at in blocks of so many cells along
 * and across. Chosen by hand. */
#define MOST_COMPARED 0.05F
#define LOOK 2
/* Of a lamp's light, in cells whose polarization is known. */
#define LEAST_KNOWN_SHARE 0.8F

static size_t cell_count(const struct lp_grid *grid)
{
	return (size_t)grid->width * (size_t)grid->height;
}

int lp_stokes_map_create(const struct lp_grid *grid, struct lp_stokes_map **map)
{
	const size_t cells = cell_count(grid) + 16; /* vector loads reach beyond the last */
	struct lp_stokes_map *m = calloc(1, sizeof(*m));

	if (!m)
		return -ENOMEM;
	m->grid = grid;
	m->cells = calloc(cells, sizeof(*m->cells));
	m->turned = calloc(cells, sizeof(*m->turned));
	m->axis = calloc(cells, sizeof(*m->axis));
	m->gain_sigma = calloc(cells, sizeof(*m->gain_sigma));
	m->radiance = calloc(cells, sizeof(*m->radiance));
	m->variance = calloc(cells, sizeof(*m->variance));
	m->flags = calloc(cells, sizeof(*m->flags));
	if (!m->flags || !m->cells || !m->turned || !m->axis || !m->gain_sigma || !m->radiance ||
	    !m->variance) {
		lp_stokes_map_destroy(m);
		return -ENOMEM;
	}
	*map = m;
	return 0;
}

void lp_stokes_map_destroy(struct lp_stokes_map *map)
{
	if (!map)
		return;
	free(map->flags);
	free(map->variance);
	free(map->radiance);
	free(map->gain_sigma);
	free(map->axis);
	free(map->turned);
	free(map->cells);
	free(map);
}

void lp_stokes_map_forget(struct lp_stokes_map *map)
{
	memset(map->cells, 0, cell_count(map->grid) * sizeof(*map->cells));
}

static bool same_view(const struct lp_film_view *a, const struct lp_film_view *b)
{
	bool same = a->film == b->film && a->angle_known == b->angle_known;

	for (int k = 0; same && k < a->film->sheet_count; k++)
		for (int i = 0; i < 3; i++)
			same = same && a->normal[k][i] == b->normal[k][i] &&
			       a->across[k][i] == b->across[k][i];
	return same;
}

/* What the film does to every cell; one that has not moved costs one comparison. */
static void look(struct lp_stokes_map *map, const struct lp_film_view *view)
{
	if (same_view(&map->view, view))
		return;
	map->view = *view;
	for (size_t i = 0; i < cell_count(map->grid); i++) {
		float direction[3];

		lp_grid_direction(map->grid, (int)i, direction);
		const struct lp_film_pass pass = lp_film_pass(view, direction);

		map->axis[i][0] = pass.polarizes ? pass.axis[0] : NAN;
		map->axis[i][1] = pass.axis[1];
		map->gain_sigma[i] = pass.gain_sigma;
	}
}

static float sigma_of(const struct lp_observation *seen, float light, size_t i)
{
	float variance = CELL_SIGMA * CELL_SIGMA * light * light;

	if (seen->coded) /* a code in 255ths of the root of the linear value */
		variance += 4.0F * seen->code_variance / (255.0F * 255.0F) * fabsf(light) *
				    seen->scale +
			    powf(seen->scale / 65025.0F, 2.0F);
	if (seen->place_variance)
		variance += seen->place_variance[i];
	if (seen->step2)
		variance += seen->step2[i] * BETWEEN_CELLS2;
	return sqrtf(variance);
}

void lp_stokes_map_learn(struct lp_stokes_map *map, const struct lp_film_view *view,
			 const struct lp_observation *observation)
{
	look(map, view);
	for (size_t i = 0; i < cell_count(map->grid); i++) {
		const float light = observation->radiance[i][LP_LUMINANCE];
		const struct lp_stokes_reading reading = {.intensity = light,
							  .misfit = 1.0F,
							  .rest_s = view->film->rest_s,
							  .sigma = sigma_of(observation, light, i),
							  .axis = {map->axis[i][0],
								   map->axis[i][1]}};

		if (observation->flags[i] || isnan(reading.axis[0]))
			continue;
		(void)lp_stokes_correct(&map->cells[i], &reading, observation->elapsed_s);
	}
}

/* Whether what is known of a cell's polarization is of light that strong. */
static bool tells(const struct lp_polarization *p, float factor, float light)
{
	const float expected = p->s0 * factor;

	return p->known && expected < MOST_APART * light && light < MOST_APART * expected;
}

/* By how much the radiance of a cell of the map is divided, and the sigma of that. Axis NAN: it is
 * not known, or seen edge-on. `light`: as it is seen through the film. Where a lamp's rim comes
 * and goes as the camera turns, cells seem polarized: dividing other light by that would draw lamps
 * that are not there. */
static void factor_of(const struct lp_stokes_map *map, size_t cell, float light, float *factor,
		      float *sigma)
{
	const float *axis = map->axis[cell];
	struct lp_polarization p = lp_stokes_polarization(&map->cells[cell]);
	const float biased = hypotf(p.q, p.u), kept = biased > 0.0F ? p.dolp / biased : 0.0F;

	p.q *= kept; /* what is no more than noise does not change the light */
	p.u *= kept;
	*factor = 1.0F;
	*sigma = p.known ? p.dolp : UNKNOWN_SIGMA;
	if (!p.known || isnan(axis[0]))
		return;
	lp_film_factor(&p, axis, factor, sigma);
	if (tells(&p, *factor, light))
		return;
	*factor = 1.0F;
	*sigma = UNKNOWN_SIGMA;
}

/* One cell of the observation, as it would be without the film. */
static void divide(struct lp_stokes_map *map, const struct lp_observation *observation, size_t i,
		   float factor, float sigma)
{
	for (int c = 0; c < 4; c++)
		map->radiance[i][c] = observation->radiance[i][c] / factor;
	const float light = map->radiance[i][LP_LUMINANCE] * sigma / factor;

	map->variance[i] = light * light;
	if (observation->place_variance)
		map->variance[i] += observation->place_variance[i];
}

static void take(const struct lp_stokes_map *map, struct lp_observation *observation)
{
	observation->radiance = (const float(*)[4])map->radiance;
	observation->place_variance = map->variance;
}

void lp_stokes_map_see_through(struct lp_stokes_map *map, const struct lp_film_view *view,
			       struct lp_observation *observation)
{
	look(map, view);
	for (size_t i = 0; i < cell_count(map->grid); i++) {
		float factor, sigma;

		factor_of(map, i, observation->radiance[i][LP_LUMINANCE], &factor, &sigma);
		divide(map, observation, i, factor, hypotf(sigma, factor * map->gain_sigma[i]));
	}
	take(map, observation);
}

/* Unit vector towards the middle of a block of LOOK x LOOK cells, the first of which is given. */
static void middle(const struct lp_grid *grid, int first, float direction[3])
{
	float last[3], length2 = 0.0F;

	lp_grid_direction(grid, first, direction);
	lp_grid_direction(grid, first + (LOOK - 1) * (grid->width + 1), last);
	for (int a = 0; a < 3; a++) {
		direction[a] += last[a];
		length2 += direction[a] * direction[a];
	}
	for (int a = 0; a < 3; a++)
		direction[a] /= sqrtf(length2);
}

void lp_stokes_map_leave_out(struct lp_stokes_map *map, const struct lp_film_view *view,
			     const struct lp_rotation *to_map, struct lp_observation *observation)
{
	const int width = map->grid->width;

	memcpy(map->flags, observation->flags, cell_count(map->grid));
	for (int row = 0; row < map->grid->height; row += LOOK)
		for (int first = row * width; first < (row + 1) * width; first += LOOK) {
			float direction[3];

			middle(map->grid, first, direction);
			const float gain_sigma =
				view->angle_known ? 0.0F : lp_film_pass(view, direction).gain_sigma;

			lp_rotate_direction(to_map, direction);
			const struct lp_polarization p = lp_stokes_polarization(
				&map->cells[lp_grid_cell(map->grid, direction)]);
			const bool told =
				gain_sigma < MOST_COMPARED && !(p.known && p.dolp > MOST_COMPARED);

			for (int k = 0; !told && k < LOOK * LOOK; k++)
				map->flags[first + k / LOOK * width + k % LOOK] |= LP_CELL_UNSEEN;
		}
	observation->flags = map->flags;
}

struct lp_polarization lp_stokes_map_of(const struct lp_stokes_map *map, const float (*radiance)[4],
					float background, const int32_t *cells, int count)
{
	struct lp_polarization sum = {0};
	float all = 0.0F;

	for (int k = 0; k < count; k++) {
		const int cell = cells[k];
		const struct lp_polarization p = lp_stokes_polarization(&map->cells[cell]);
		const float light = fmaxf(radiance[cell][LP_LUMINANCE] - background, 0.0F) *
				    lp_grid_solid_angle_sr(map->grid, cell);

		all += light;
		if (!tells(&p, 1.0F, radiance[cell][LP_LUMINANCE]))
			continue;
		sum.s0 += light;
		sum.q += light * p.q;
		sum.u += light * p.u;
		sum.qq += light * p.qq;
		sum.qu += light * p.qu;
		sum.uu += light * p.uu;
	}
	if (!(sum.s0 > LEAST_KNOWN_SHARE * all))
		return lp_stokes_polarization(&(struct lp_stokes){0});
	sum.q /= sum.s0;
	sum.u /= sum.s0;
	sum.qq /= sum.s0;
	sum.qu /= sum.s0;
	sum.uu /= sum.s0;
	lp_polarization_complete(&sum);
	return sum;
}

void lp_stokes_map_turn(struct lp_stokes_map *map, const struct lp_rotation *rotation)
{
	const struct lp_rotation back = lp_rotation_inverse(rotation);

	for (size_t i = 0; i < cell_count(map->grid); i++) {
		float direction[3];

		lp_grid_direction(map->grid, (int)i, direction);
		lp_rotate_direction(rotation, direction);
		const struct lp_stokes *old = &map->cells[lp_grid_cell(map->grid, direction)];

		map->turned[i] = *old;
		if (old->normal[0] > 0.0F)
			lp_stokes_turn(&map->turned[i], lp_stokes_frame_turn(&back, direction));
	}
	memcpy(map->cells, map->turned, cell_count(map->grid) * sizeof(*map->cells));
}
