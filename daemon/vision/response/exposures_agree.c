/* SPDX-License-Identifier: Apache-2.0 */
/* What the exposures of a camera say of its response (vision/response/linearity.h). */
#include <math.h>

#include "base/log.h"
#include "include/luminance.h"
#include "light/math/grid.h"
#include "vision/imager_internal.h"

/* Every so many of the watched cells are enough for a mean. */
#define STEP (LP_GAIN_CELLS / LP_LINEARITY_CELLS)
/* Of regions: 30 degrees high, 45 wide. */
#define ROWS 6
#define COLUMNS 8
/* Light that differs more from cell to cell, relative, tells of the lens and of where the camera
 * looks, too. */
#define MOST_STEP 0.05F
/* An angle of the film that differs by no more is the same: as well as a wheel's is read. */
#define SAME_FILM_DEG 2.0F
/* Light to a power that is farther from 1 is worth a line in the log, and so is another such
 * change. */
#define WORTH_A_LINE 0.01F

static int region_of(const struct lp_grid *grid, int cell)
{
	const int row = cell / grid->width, column = cell % grid->width;

	return row * ROWS / grid->height * COLUMNS + column * COLUMNS / grid->width;
}

static bool is_even(const struct lp_imager *imager, int cell)
{
	const float light = imager->map->radiance[cell][LP_LUMINANCE];

	return lp_imager_step2(imager, cell) < MOST_STEP * MOST_STEP * light * light;
}

static struct lp_linearity_look look_at(const struct lp_imager *imager,
					const struct lp_residual *residual, int cell)
{
	const int seen = lp_residual_seen(residual, cell);
	const float even = imager->eye->incoming.noise.even;

	if (!is_even(imager, cell))
		return (struct lp_linearity_look){.log_light = NAN};
	const struct lp_log_light light =
		lp_log_light_expected(&residual->seen, seen, LP_LUMINANCE,
				      imager->map->radiance[cell][LP_LUMINANCE]);

	return (struct lp_linearity_look){.region = region_of(imager->grid, cell),
					  .log_light = light.log,
					  .log_linear = light.log - logf(residual->seen.scale),
					  .variance = light.variance,
					  .rounding = even * even * light.code2};
}

static void tell(struct lp_eye *eye, int camera, bool disagreed)
{
	struct lp_linearity *l = &eye->linearity;

	if (l->disagrees && !disagreed)
		lp_warning("camera", "response",
			   "camera %d: its exposures contradict each other, and no response "
			   "explains it: the camera alters parts of its pictures (local tone "
			   "mapping); light is uncertain by %.0f %%: switch that off, or see "
			   "`lightprobe check-camera`",
			   camera, 100.0 * (double)lp_linearity_sigma(l));
	if (fabsf(l->applied - eye->told_power) <= WORTH_A_LINE)
		return;
	eye->told_power = l->applied;
	lp_info("camera", "response",
		"camera %d: by its exposures, light is what its response says to the power %.3f; "
		"that is corrected: `lightprobe calibrate response` measures it",
		camera, exp((double)l->applied));
}

static void tell_tear(const struct lp_tear *tear, int camera, bool found)
{
	if (tear->found && !found)
		lp_warning("camera", "response",
			   "camera %d: the first %.0f %% of its rows have the exposure of the "
			   "frame before: light is uncertain by %.0f %%: let it take one exposure "
			   "only (--exposure-us)",
			   camera, 100.0 * (double)tear->share,
			   100.0 * (double)lp_tear_sigma(tear));
}

void lp_eye_bend_response(struct lp_eye *eye)
{
	lp_response_bend(&eye->response, lp_linearity_apply(&eye->linearity));
}

/* A film that turns passes more of some regions' light and less of others'. No frame that is
 * exposed meanwhile tells of the response, and frames at one angle none with those at another. */
static bool is_film_turning(struct lp_imager *imager)
{
	const float film_deg = imager->film.wheel_deg, before_deg = imager->eye->learned_film_deg;

	if (!imager->film.stokes)
		return false;
	imager->eye->learned_film_deg = film_deg;
	if (!(fabsf(film_deg - before_deg) < SAME_FILM_DEG))
		lp_linearity_forget_looks(&imager->eye->linearity);
	return isnan(film_deg);
}

void lp_imager_learn_response(struct lp_imager *imager)
{
	struct lp_eye *eye = imager->eye;
	struct lp_linearity_look looks[LP_LINEARITY_CELLS];
	const float exposure_us = lp_frame_exposure_us(&imager->about);
	const int count = imager->watched_count / STEP;
	const bool disagreed = eye->linearity.disagrees;

	/* only what the frame itself tells: an exposure that is found by what the frame shows has
	 * taken the response for granted */
	if (!imager->t_map_ns || imager->late_s > 0.0F || isnan(eye->incoming.cells.mean_code) ||
	    isnan(exposure_us) || is_film_turning(imager))
		return;
	const bool was_torn = eye->tear.found;

	lp_tear_learn(&eye->tear, &eye->incoming.cells, logf(exposure_us));
	tell_tear(&eye->tear, (int)(eye - imager->eyes) + 1, was_torn);
	if (eye->tear.found)
		return; /* what exposures contradict is that */
	/* exposures shorter than the mains' period contradict longer ones then, whatever the
	 * response */
	if (imager->flicker > 0.0F || eye->banding.found) {
		eye->linearity.disagrees = false;
		return;
	}
	const struct lp_residual residual = lp_imager_residual(imager);

	for (int k = 0; k < count; k++)
		looks[k] = look_at(imager, &residual, imager->watched[STEP * k]);
	lp_linearity_learn(&eye->linearity, looks, count, logf(exposure_us),
			   (float)lp_imager_eye_elapsed_s(imager));
	tell(eye, (int)(eye - imager->eyes) + 1, disagreed);
}
