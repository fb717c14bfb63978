/* SPDX-License-Identifier: Apache-2.0 */
/* Frames that do not tell their exposure: their scale by what is known (vision/doubt/gain.h). */
#include <math.h>
#include <string.h>

#include "include/luminance.h"
#include "light/math/grid.h"
#include "vision/imager_internal.h"

/* Which cells are watched: rows of the panorama, and columns of its equator. */
#define ROWS 60
#define COLUMNS 80
/* Variance of where a cell of a turned picture looks, in cells^2: the nearest one is taken. */
#define PLACE_VARIANCE 0.15F
/* 1 sigma of the scale of what the map, once turned, holds of the watched cells. */
#define TURNED_SIGMA 0.003F
/* The same of a frame with nothing to compare it with: what automatic exposure does between two
 * frames. */
#define FORGOTTEN_SIGMA 0.1F
/* Beyond this a first look is worth its time, before the frame is aligned. */
#define WORTH_A_LOOK 0.02F

static bool is_unknown(const struct lp_imager *imager)
{
	return isnan(imager->eye->incoming.exposure_us) &&
	       !isnan(imager->eye->incoming.cells.mean_code);
}

/* Panorama cells of the watched ones, the same number for equal parts of the sphere. */
void lp_imager_watch(struct lp_imager *imager)
{
	const struct lp_grid *grid = imager->grid;
	const int rows = grid->height < ROWS ? grid->height : ROWS;
	int count = 0;

	for (int k = 0; k < rows; k++) {
		const int row = (2 * k + 1) * grid->height / (2 * rows);
		const int columns = (int)fmaxf(COLUMNS * grid->row_sin[row], 1.0F);

		for (int c = 0; c < columns && count < LP_GAIN_CELLS; c++)
			imager->watched[count++] =
				row * grid->width + (2 * c + 1) * grid->width / (2 * columns);
	}
	imager->watched_count = count;
}

float lp_imager_step2(const struct lp_imager *imager, int cell)
{
	const float(*radiance)[4] = (const float(*)[4])imager->map->radiance;
	const int width = imager->grid->width, last = width * imager->grid->height - 1;
	const int left = cell ? cell - 1 : cell, right = cell < last ? cell + 1 : cell;
	const int up = cell >= width ? cell - width : cell;
	const int down = cell + width <= last ? cell + width : cell;
	const float across = radiance[right][LP_LUMINANCE] - radiance[left][LP_LUMINANCE];
	const float along = radiance[down][LP_LUMINANCE] - radiance[up][LP_LUMINANCE];

	return 0.25F * (across * across + along * along);
}

/* `held`: logarithm of the scale held so far, over the frame's. */
static void see(struct lp_imager *imager, const struct lp_residual *residual, float held, int k)
{
	struct lp_gain_cell *cell = &imager->eye->gain.cells[k];
	const int seen = lp_residual_seen(residual, imager->watched[k]);
	const float light = residual->seen.radiance[seen][LP_LUMINANCE];
	const struct lp_log_light told = lp_log_light(&residual->seen, seen, LP_LUMINANCE);
	const float place2 =
		residual->lookup ? PLACE_VARIANCE * lp_imager_step2(imager, imager->watched[k]) /
					   (light * light)
				 : 0.0F;

	cell->seen = told.log + held;
	cell->sigma = sqrtf(told.variance + place2);
}

static struct lp_gain_look look(struct lp_imager *imager)
{
	const struct lp_residual residual = lp_imager_residual(imager);
	const float held = logf(imager->eye->gain.scale / residual.seen.scale);

	for (int k = 0; k < imager->eye->gain.count; k++)
		see(imager, &residual, held, k);
	return lp_gain_look(&imager->eye->gain);
}

/* What the map holds of the watched cells; what is only a bound is nothing. */
static void see_map(const struct lp_imager *imager, struct lp_gain *gain)
{
	const struct lp_radiance_map *map = imager->map;

	for (int k = 0; k < gain->count; k++) {
		const int i = imager->watched[k];
		const float light = map->radiance[i][LP_LUMINANCE];

		gain->cells[k].seen = map->flags[i] || !(light > 0.0F) ? NAN : logf(light);
		gain->cells[k].sigma = LP_CELL_SIGMA;
	}
}

void lp_imager_forget_scale(struct lp_imager *imager)
{
	if (imager->eye->gain.count)
		imager->eye->gain.variance += FORGOTTEN_SIGMA * FORGOTTEN_SIGMA;
}

void lp_imager_expect_exposure(struct lp_imager *imager, int camera)
{
	imager->eyes[camera].gain.unrest = 1.0F; /* it may take some frames to come */
}

void lp_imager_inherit(struct lp_imager *imager, const struct lp_imager *from)
{
	for (int k = 0; k < imager->eye_count; k++) {
		const struct lp_eye *before = &from->eyes[k];
		struct lp_eye *eye = &imager->eyes[k];
		const struct lp_overlap own = eye->overlap;

		eye->lost = before->lost;
		eye->gain = before->gain;
		lp_linearity_inherit(&eye->linearity, &before->linearity);
		eye->gain.count = 0; /* its cells are of another panorama */
		if (before->gain.count)
			eye->gain.variance += FORGOTTEN_SIGMA * FORGOTTEN_SIGMA;
		eye->overlap = before->overlap;
		memcpy(eye->overlap.applied, own.applied, sizeof(own.applied));
		(void)lp_stuck_inherit(&eye->stuck, &before->stuck); /* else it learns anew */
	}
}

void lp_imager_expect_scale(struct lp_imager *imager)
{
	if (!is_unknown(imager) || !imager->t_map_ns)
		return;
	if (!imager->eye->gain.count) { /* exposures were known until now: the map tells */
		imager->eye->gain.count = imager->watched_count;
		see_map(imager, &imager->eye->gain);
		lp_gain_anew(&imager->eye->gain, 0.0F, 0.0F);
	}
	const struct lp_gain_look first = look(imager);

	if (fabsf(first.log_gain) > WORTH_A_LOOK)
		lp_imager_rescale(imager, imager->eye->gain.scale * expf(-first.log_gain));
}

void lp_imager_find_scale(struct lp_imager *imager)
{
	if (!is_unknown(imager))
		return;
	if (!imager->t_map_ns)
		imager->eye->gain.count = imager->watched_count;
	const struct lp_gain_look found = look(imager);

	if (!imager->t_map_ns) {
		lp_gain_anew(&imager->eye->gain, 0.0F, 0.0F);
		return;
	}
	lp_gain_follow(&imager->eye->gain, &found, (float)lp_imager_eye_elapsed_s(imager));
	lp_imager_rescale(imager, imager->eye->gain.scale);
}

float lp_imager_scale_in_map(const struct lp_imager *imager, struct lp_gain *gain)
{
	if (!gain->count)
		return 0.0F;
	see_map(imager, gain);
	return lp_gain_look(gain).log_gain;
}

void lp_imager_turn_scale(const struct lp_imager *imager, struct lp_gain *gain, float in_map)
{
	if (!gain->count)
		return;
	see_map(imager, gain);
	lp_gain_anew(gain, -in_map, TURNED_SIGMA);
}
