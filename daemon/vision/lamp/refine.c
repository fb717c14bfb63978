/* SPDX-License-Identifier: Apache-2.0 */
/* Full-resolution look at a lamp: lp_imager_refine(). */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "include/light_estimate.h"
#include "include/luminance.h"
#include "light/find/lamps.h"
#include "light/math/grid.h"
#include "light/math/rotation.h"
#include "vision/camera/camera.h"
#include "vision/camera/code_noise.h"
#include "vision/camera/remap.h"
#include "vision/glare/glare.h"
#include "vision/imager_internal.h"
#include "vision/lamp/cell_geometry.h"
#include "vision/lamp/rim.h"
#include "vision/map/lookup.h"

/* Chosen by hand; docs/maintainers/constants.md says what half and double of each does. */

/* Response, roll-off and white balance of a camera: what a lamp's strength is uncertain by at best.
 * No real camera has been measured; docs/users/accuracy.md shows the figures without it, too. */
#define CAMERA_SIGMA 0.02F
/* Pixels fainter than this share of the lamp's peak, or lost in the surround's noise, add to its
 * irradiance but say nothing of where and how large it is. */
#define CORE_SHARE 0.05F
/* Cells whose mean holds less than this share of the lamp's peak are not decoded: of such a cell
 * the mean is right enough. One bright pixel of 64 holds more. */
#define DECODED_SHARE 0.01F
#define FLICKER_SHARE 0.05F /* the same while lamps flicker */
/* A direction is never better known than this part of a pixel: registration of lens and sensor. */
#define LEAST_SIGMA_PX 0.05
/* A lamp that has left the cells where the map has it, as the probe goes, is cut off: its core is
 * in cells of which the map's hold less than this share. What is cut off moves its middle: a cut
 * through the middle, by half of the radius, leaves a fifth of the core at the border. */
#define WHOLE_SHARE 0.95F
#define CUT_SHARE 2.5
/* Of camera cells near a pole, in cells at the horizon; and how many one may stand for. */
#define MOST_SPACING 0.5
#define MOST_THINNED 16

/* The camera cells behind a lamp, and how much of each belongs to it: a cell at the lamp's border
 * also serves panorama cells outside of it. */
struct patch {
	int count;
	int cells[LP_MOST_REFINE_CELLS];
	float share[LP_MOST_REFINE_CELLS];
	float brightest[LP_MOST_REFINE_CELLS]; /* luminance of a pixel; -FLT_MAX: not decoded */
	bool clipped;			       /* a decoded pixel is at the top of the scale */
};

/*
 * Near the poles of an equirectangular picture neighbours in a row look almost the same way: where
 * there are too many of them, of those that are not bright every n-th stands for n. A power of two,
 * at most `most`, as long as they stay within MOST_SPACING.
 */
static int polar_stride(const struct lp_imager *imager, int row, int most)
{
	const struct lp_remap *remap = imager->eye->remap;
	const int columns = remap->width_px / remap->cell_px;
	const double sine = lp_camera_row_sine(imager->eye->camera, remap->height_px,
					       (row + 0.5) * remap->cell_px);
	int stride = 1;

	while (stride < most && columns % (2 * stride) == 0 && 2.0 * stride * sine < MOST_SPACING)
		stride *= 2;
	return stride;
}

/* Does this camera cell hold so much of the lamp's light, and not just its surround's? */
static bool holds(const struct lp_cells *cells, const struct lp_lamp *lamp, int source, float share)
{
	const float surround = lamp->background[LP_LUMINANCE];

	return cells->radiance[source][LP_LUMINANCE] - surround > share * (lamp->peak - surround);
}

/* Cells of a panorama in the camera's frame. */
struct behind {
	const int32_t *cells;
	int count;
};

/*
 * Cells of a row from the left one to the right one, which is its neighbour. Near a pole, where
 * cells are narrow, also those within half a cell of the horizon beside them: the cells of a lamp
 * are further apart there than those of the row.
 */
static void take_behind(struct lp_imager *imager, int32_t left, int32_t right, int *count)
{
	const int width = imager->grid->width, row = left / width;
	const int wider = (int)fminf(ceilf(0.5F / imager->grid->row_sin[row]), 0.5F * (float)width);

	for (int k = 1 - wider; k <= 0; k++) {
		const int32_t pair[2] = {(left % width + k + width) % width,
					 (right % width - k) % width};

		for (int side = 0; side < 2; side++) {
			const int32_t cell = row * width + pair[side];

			if (imager->lamp.taken[cell])
				continue;
			imager->lamp.taken[cell] = 1;
			imager->lamp.behind[(*count)++] = cell;
		}
	}
}

/* Where the lamp's cells lie in the camera's frame; of a turned camera, all that surround them. */
static struct behind cells_behind(struct lp_imager *imager, const struct lp_lamp_finder *finder,
				  const struct lp_lamp *lamp)
{
	const struct lp_lookup *lookup = imager->lookup;
	const int32_t *cells = finder->cells + lamp->first;
	const int width = imager->grid->width;
	int count = 0;

	if (lp_rotation_is_identity(&imager->turn.motion.rotation))
		return (struct behind){cells, lamp->count};
	for (int i = 0; i < lamp->count; i++) {
		const int32_t left = lookup->left[cells[i]], right = lookup->right[cells[i]];

		take_behind(imager, left, right, &count);
		take_behind(imager, left + width, right + width, &count);
	}
	for (int i = 0; i < count; i++)
		imager->lamp.taken[imager->lamp.behind[i]] = 0;
	return (struct behind){imager->lamp.behind, count};
}

/* Camera cells behind the lamp's panorama cells, thinned where polar_stride() allows it; the bright
 * ones, which each count by themselves, only if `all`. False: too many. */
static bool collect_thinned(struct lp_imager *imager, const struct behind *behind,
			    const struct lp_lamp *lamp, int thin, bool all, struct patch *patch)
{
	const struct lp_remap *remap = imager->eye->remap;
	const int columns = (remap->width_px + remap->cell_px - 1) / remap->cell_px;

	patch->count = 0;
	for (int i = 0; i < behind->count; i++) {
		const int32_t cell = behind->cells[i];
		const float omega = lp_grid_solid_angle_sr(imager->grid, cell);
		int k, end;

		for (lp_remap_entries(remap, cell, &k, &end); k < end; k++) {
			const int source = remap->source[k];
			const int stride = thin == 1 || (!all && holds(&imager->eye->incoming.cells,
								       lamp, source, CORE_SHARE))
						   ? 1
						   : polar_stride(imager, source / columns, thin);
			int *place = &imager->eye->place[source];

			if (source % columns % stride)
				continue;
			/* place: where the patch holds this cell; only valid if it really does */
			if (*place >= patch->count || patch->cells[*place] != source) {
				if (patch->count == LP_MOST_REFINE_CELLS)
					return false;
				*place = patch->count;
				patch->cells[patch->count] = source;
				patch->share[patch->count++] = 0.0F;
			}
			patch->share[*place] +=
				(float)stride * remap->weight[k] * omega / remap->given_sr[source];
		}
	}
	return patch->count > 0;
}

/* Cells tell it, and pixels: a few clipped ones do not show in the mean and the detail of a cell.
 */
static bool clips(const struct lp_exposure *exposure, const struct patch *patch)
{
	if (patch->clipped)
		return true;
	for (int i = 0; i < patch->count; i++)
		if (exposure->cells.clipped[patch->cells[i]])
			return true;
	return false;
}

/* Which cells of the patch are to be decoded; returns how many. */
static int choose_decoded(const struct lp_imager *imager, const struct lp_lamp *lamp,
			  struct patch *patch)
{
	const struct lp_exposure *exposure = &imager->eye->incoming;
	/* what a lamp that flickers lights is brighter than known at times: that is no lamp */
	const float share = imager->flicker > 0.0F ? FLICKER_SHARE : DECODED_SHARE;
	int count = 0;

	for (int i = 0; i < patch->count; i++) {
		const bool decode = holds(&exposure->cells, lamp, patch->cells[i], share);

		patch->brightest[i] = decode ? 0.0F : -FLT_MAX;
		count += decode;
	}
	return count;
}

/* Some of it shows what its neighbours do, and not the lamp. */
static bool is_filled(const struct lp_eye *eye, const struct patch *patch)
{
	for (int i = 0; i < patch->count && eye->stuck.count; i++)
		if (lp_stuck_leaves_out(&eye->stuck, patch->cells[i]))
			return true;
	return false;
}

static bool sees_all(const struct lp_eye *eye, const struct behind *behind)
{
	for (int i = 0; i < behind->count; i++)
		if (!lp_eye_sees(eye, behind->cells[i]))
			return false;
	return true;
}

/* The patch, of which at most `most` cells are to be decoded. False: there is none so small. */
static bool collect(struct lp_imager *imager, const struct lp_lamp_finder *finder,
		    const struct lp_lamp *lamp, int most, struct patch *patch)
{
	const struct behind behind = cells_behind(imager, finder, lamp);

	if (imager->eye_count > 1 && !sees_all(imager->eye, &behind))
		return false; /* another camera sees the rest of it */

	for (int all = 0; all <= 1; all++) /* bright cells so many are alike, too */
		for (int thin = 1; thin <= MOST_THINNED; thin *= 2)
			if (collect_thinned(imager, &behind, lamp, thin, all, patch) &&
			    choose_decoded(imager, lamp, patch) <= most)
				return true;
	return false;
}

struct sums {
	double flux[4];	 /* R, G, B, luminance above the background: all pixels */
	double all[3];	 /* sum excess Omega d, luminance: all pixels */
	double core;	 /* luminance flux of the core pixels */
	double squared;	 /* of the core: sum excess^2 Omega */
	double first[3]; /* of the core: sum excess Omega d */
	double noise;	 /* of the core: sum (Omega * distance)^2, for the centroid's sigma */
	double border;	 /* of the core: what lies in cells at the border of the lamp's place */
};

/* One row of a cell's pixels, u = 0..1 across the cell. */
struct row_sums {
	float flux[4]; /* excess over the background: R, G, B, luminance */
	float moment;  /* luminance excess * u */
	float core, core_moment;
	float core_squared;  /* in units of the threshold, so that no radiance overflows */
	float pixels, u, uu; /* of the core: how many, sum u, sum u^2 */
};

/* Without a branch per pixel: what is core is anything but predictable. */
static struct row_sums sum_row(const float (*rgb)[3], int count, float step,
			       const float *background, float threshold)
{
	const float inverse = 1.0F / fmaxf(threshold, FLT_MIN);
	struct row_sums s = {.pixels = 0.0F};

	for (int x = 0; x < count; x++) {
		const float u = ((float)x + 0.5F) * step;
		const float light = lp_luminance(rgb[x]) - background[LP_LUMINANCE];
		const float one = light > threshold ? 1.0F : 0.0F, core = one * light;

		for (int c = 0; c < 3; c++)
			s.flux[c] += rgb[x][c] - background[c];
		s.flux[LP_LUMINANCE] += light;
		s.moment += light * u;
		s.core += core;
		s.core_moment += core * u;
		s.core_squared += core * (light * inverse);
		s.pixels += one;
		s.u += one * u;
		s.uu += one * u * u;
	}
	return s;
}

static void add_row(struct sums *s, const struct row_sums *row, const struct lp_row_geometry *g,
		    const struct lp_lamp *lamp, double omega, float threshold)
{
	double apart[3] = {0.0}; /* of the core: sum of (d - direction)^2 */

	for (int c = 0; c < 4; c++)
		s->flux[c] += row->flux[c] * omega;
	s->core += row->core * omega;
	s->squared += (double)row->core_squared * fmaxf(threshold, FLT_MIN) * omega;
	for (int a = 0; a < 3; a++) {
		const double from = g->first[a] - lamp->direction[a];

		s->all[a] +=
			omega * (row->flux[LP_LUMINANCE] * g->first[a] + row->moment * g->along[a]);
		s->first[a] += omega * (row->core * g->first[a] + row->core_moment * g->along[a]);
		apart[a] = row->pixels * from * from + 2.0 * row->u * from * g->along[a] +
			   row->uu * g->along[a] * g->along[a];
	}
	s->noise += omega * omega * (apart[0] + apart[1] + apart[2]);
}

static float brightest(const float (*rgb)[3], int count)
{
	float most = 0.0F;

	for (int p = 0; p < count; p++)
		most = fmaxf(most, lp_luminance(rgb[p]));
	return most;
}

/* Whether one of the pixels is at the top of the scale; never in a float frame, which has none. */
static bool at_top(const struct lp_imager *imager, const struct lp_exposure *exposure,
		   const float (*rgb)[3], int count)
{
	bool found = false;

	if (isnan(exposure->cells.mean_code))
		return false;
	for (int c = 0; c < 3; c++) {
		const float top = exposure->scale * imager->eye->response.pixel[c][LP_TOP_CODE];

		for (int p = 0; p < count; p++)
			found |= rgb[p][c] >= top;
	}
	return found;
}

/* The same of a row of pixels that are all alike and not of the core. */
static struct row_sums flat_row(const float *radiance, int count, float step,
				const float *background)
{
	struct row_sums s = {.pixels = 0.0F};

	for (int c = 0; c < 4; c++)
		s.flux[c] = (float)count * (radiance[c] - background[c]);
	s.moment = s.flux[LP_LUMINANCE] * 0.5F * (float)count * step;
	return s;
}

/* Pixels of the patch, camera cell after camera cell; returns the highest luminance. */
static float load_pixels(struct lp_imager *imager, const struct lp_exposure *exposure,
			 struct patch *patch)
{
	const int side = exposure->cells.cell_px, per_cell = side * side;
	float peak = 0.0F;

	patch->clipped = false;
	for (int i = 0; i < patch->count; i++) {
		float(*rgb)[3] = imager->lamp.pixels + (size_t)i * per_cell;

		if (patch->brightest[i] < 0.0F)
			continue;
		lp_exposure_cell_pixels(exposure, patch->cells[i] % exposure->cells.width,
					patch->cells[i] / exposure->cells.width,
					&imager->eye->response, rgb);
		patch->brightest[i] = brightest((const float(*)[3])rgb, per_cell);
		patch->clipped |= at_top(imager, exposure, (const float(*)[3])rgb, per_cell);
		peak = fmaxf(peak, patch->brightest[i]);
	}
	return peak;
}

/*
 * Pixels of a dark JPEG are cut off at black and so too bright on average, its block means are not:
 * where nothing of the core is, the cell's mean stands for its pixels, as it does in the
 * background.
 */
static struct sums sum_patch(struct lp_imager *imager, const struct lp_exposure *exposure,
			     const struct patch *patch, const struct lp_lamp *lamp, float threshold)
{
	const int side = exposure->cells.cell_px;
	const int width = imager->eye->remap->width_px, height = imager->eye->remap->height_px;
	struct sums s = {0};

	for (int i = 0; i < patch->count; i++) {
		const int column = patch->cells[i] % exposure->cells.width;
		const int row = patch->cells[i] / exposure->cells.width;
		const int columns = width - column * side < side ? width - column * side : side;
		const struct lp_cell_geometry g = lp_cell_geometry(imager, column, row);
		const float(*rgb)[3] =
			(const float(*)[3])(imager->lamp.pixels + (size_t)i * side * side);
		const bool flat = patch->brightest[i] - lamp->background[LP_LUMINANCE] <= threshold;

		for (int y = 0; g.seen && y < side && row * side + y < height; y++) {
			const float step = 1.0F / (float)side;
			const struct row_sums sums =
				flat ? flat_row(exposure->cells.radiance[patch->cells[i]], columns,
						step, lamp->background)
				     : sum_row(rgb + y * side, columns, step, lamp->background,
					       threshold);
			const struct lp_row_geometry geometry =
				lp_row_geometry(&g, (y + 0.5) / side);

			const double omega =
				g.share * lp_camera_pixel_solid_angle_sr(imager->eye->camera, width,
									 height,
									 (column + 0.5) * side,
									 row * side + y + 0.5);

			add_row(&s, &sums, &geometry, lamp, omega * patch->share[i], threshold);
			if (patch->share[i] < WHOLE_SHARE)
				s.border += (double)sums.core * omega * patch->share[i];
		}
	}
	return s;
}

/* Of a lamp that clips; load_pixels() has been called. */
static struct lp_lamp_rim rim_of(const struct lp_imager *imager, const struct lp_exposure *exposure,
				 const struct patch *patch, const struct lp_lamp *lamp)
{
	const int per_cell = exposure->cells.cell_px * exposure->cells.cell_px;
	struct lp_rim_sums sums = {0};
	const bool coded = !isnan(exposure->cells.mean_code);
	float full[3];

	for (int c = 0; c < 3; c++)
		full[c] = exposure->scale * (coded ? imager->eye->response.pixel[c][255]
						   : lp_frame_saturation(exposure->frame));
	for (int i = 0; i < patch->count; i++)
		if (patch->brightest[i] >= 0.0F)
			lp_rim_add(&sums,
				   (const float(*)[3])(imager->lamp.pixels + (size_t)i * per_cell),
				   per_cell, lamp->background, full);
	return lp_rim_of(&sums);
}

static void normalise(const double vector[3], float unit[3])
{
	const double length =
		sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);

	for (int a = 0; length > 0.0 && a < 3; a++)
		unit[a] = (float)(vector[a] / length);
}

/* Of one pixel of the lamp's tone, from the rounding of a JPEG's detail. */
static double pixel_noise(const struct lp_imager *imager, const struct lp_exposure *exposure,
			  const struct lp_lamp *lamp)
{
	const float tone = (float)lamp->irradiance[LP_LUMINANCE] / lamp->solid_angle_sr;

	return (double)tone * exposure->noise.pixel *
	       lp_relative_slope(&imager->eye->response, tone / exposure->scale);
}

/*
 * A clipped lamp is a plateau whose rim is known to whole pixels: each of the 2 pi r along it errs
 * by up to half of itself (uniform: 1 / sqrt(12)), at the distance r from a centre that pi r^2 hold
 * together. Root mean square of the centroid's angle, in pixels.
 */
static double plateau_sigma_px(double radius_px)
{
	return sqrt(1.0 / (6.0 * M_PI * fmax(radius_px, 0.5)));
}

static void apply(const struct lp_imager *imager, const struct lp_exposure *exposure,
		  const struct sums *s, bool clipped, struct lp_lamp *lamp)
{
	/* pixels across the horizon: the scale of one pixel */
	const double pixel_rad =
		lp_camera_pixel_rad(imager->eye->camera, imager->eye->remap->width_px,
				    imager->eye->remap->height_px);

	normalise(s->first, lamp->direction);
	normalise(s->all, lamp->centroid);
	for (int c = 0; c < 4; c++)
		lamp->irradiance[c] = (float)fmax(s->flux[c], 0.0);
	lamp->solid_angle_sr = (float)(s->core * s->core / s->squared);

	const double noise = hypot(lamp->background_noise, pixel_noise(imager, exposure, lamp));
	const double radius_px = sqrt(lamp->solid_angle_sr / M_PI) / pixel_rad;
	const double sigma_px = hypot(LEAST_SIGMA_PX, clipped ? plateau_sigma_px(radius_px) : 0.0);

	/* while nobody says that the probe goes, lamps are where the map has them */
	const bool may_have_left = imager->turn.parallax_rad > 0.0;

	lamp->cut = may_have_left ? (float)fmin(CUT_SHARE * s->border / s->core, 1.0) : 0.0F;
	const double cut_rad = (double)lamp->cut * radius_px * pixel_rad;
	const double sigma_rad =
		hypot(hypot(sigma_px * pixel_rad, cut_rad), noise * sqrt(s->noise) / s->core);

	lamp->direction_sigma_deg = (float)(sigma_rad * 180.0 / M_PI);
	lamp->flags =
		(lamp->flags & ~(uint32_t)LP_LIGHT_CLIPPED) | (clipped ? LP_LIGHT_CLIPPED : 0);
}

/* From the anchor frame to where it is in the camera's picture. */
static void place_lamp(const struct lp_imager *imager, struct lp_lamp *lamp)
{
	const struct lp_rotation back = lp_rotation_inverse(&imager->turn.motion.rotation);
	const struct lp_shear shear = lp_imager_shear(imager);

	for (int k = 0; k < 2; k++) {
		float *direction = k ? lamp->centroid : lamp->direction;

		lp_rotate_direction(&back, direction);
		lp_shear_from_middle(&shear, direction);
	}
}

/* And back. */
static void turn_lamp(const struct lp_imager *imager, struct lp_lamp *lamp)
{
	const struct lp_shear shear = lp_imager_shear(imager);

	for (int k = 0; k < 2; k++) {
		float *direction = k ? lamp->centroid : lamp->direction;

		lp_shear_to_middle(&shear, direction);
		lp_rotate_direction(&imager->turn.motion.rotation, direction);
	}
}

/* Something before the lens hides the lamp; `direction`: in the camera's picture. */
static bool covers(const struct lp_imager *imager, const float direction[3])
{
	if (!imager->eye->cover.found)
		return false;
	return imager->eye->cover
		.near[lp_cover_block(imager->grid->width, lp_grid_cell(imager->grid, direction))];
}

/* As it is when only this share of all light is seen. */
static void dim(struct lp_lamp *lamp, float share)
{
	for (int c = 0; c < 4; c++) {
		lamp->irradiance[c] *= share;
		lamp->background[c] *= share;
	}
	lamp->background_noise *= share;
	lamp->peak *= share;
}

/* As the newest frame shows it behind the lens' veil. */
static void veil(const struct lp_imager *imager, struct lp_lamp *lamp)
{
	float added[4];

	if (!imager->eye->glare)
		return;
	dim(lamp, lp_glare_kept(imager->eye->glare));
	lp_glare_at(imager->eye->glare, lamp->direction, added);
	for (int c = 0; c < 4; c++)
		lamp->background[c] += added[c];
	lamp->peak += added[LP_LUMINANCE];
}

/* And back. */
static void unveil(const struct lp_imager *imager, const struct lp_lamp *before,
		   struct lp_lamp *lamp)
{
	if (!imager->eye->glare)
		return;
	dim(lamp, 1.0F / lp_glare_kept(imager->eye->glare));
	memcpy(lamp->background, before->background, sizeof(lamp->background));
	lamp->background_noise = before->background_noise;
	lamp->peak = before->peak;
}

bool lp_imager_refine(struct lp_imager *imager, const struct lp_lamp_finder *finder,
		      struct lp_lamp *lamp, int most_cells)
{
	const struct lp_exposure *exposure = &imager->eye->incoming;
	struct lp_lamp seen = *lamp;
	struct patch patch;
	float gain;

	if (most_cells > LP_MOST_REFINE_CELLS)
		most_cells = LP_MOST_REFINE_CELLS;
	place_lamp(imager, &seen);
	gain = lp_imager_film_gain(imager, seen.direction);
	dim(&seen, gain);
	veil(imager, &seen);
	if (!imager->eye->remap || covers(imager, seen.direction) ||
	    !collect(imager, finder, &seen, most_cells, &patch) || is_filled(imager->eye, &patch))
		return false;
	const float peak = load_pixels(imager, exposure, &patch) - seen.background[LP_LUMINANCE];
	const float threshold = fmaxf(CORE_SHARE * peak, 3.0F * seen.background_noise);
	const struct sums s = sum_patch(imager, exposure, &patch, &seen, threshold);

	if (!(s.core > 0.0) || !(s.flux[LP_LUMINANCE] > 0.0))
		return false;
	apply(imager, exposure, &s, clips(exposure, &patch), &seen);
	seen.rim = seen.flags & LP_LIGHT_CLIPPED ? rim_of(imager, exposure, &patch, &seen)
						 : (struct lp_lamp_rim){0};
	dim(&seen, 1.0F / gain);
	unveil(imager, lamp, &seen);
	turn_lamp(imager, &seen);
	*lamp = seen;
	return true;
}

float lp_imager_strength_sigma(const struct lp_imager *imager, const struct lp_lamp *lamp)
{
	const float tone = lamp->irradiance[LP_LUMINANCE] / lamp->solid_angle_sr;
	const struct lp_exposure *e = &imager->eye->incoming;

	if (!imager->eye->remap || !(e->noise.common > 0.0F) || !(tone > 0.0F))
		return 0.0F;
	const float pixel_sr =
		4.0F * (float)M_PI /
		((float)imager->eye->remap->width_px * (float)imager->eye->remap->height_px);
	const float pixels = fmaxf(lamp->solid_angle_sr / pixel_sr, 1.0F);
	const float codes = hypotf(e->noise.common, e->noise.pixel / sqrtf(pixels));

	return hypotf(CAMERA_SIGMA,
		      codes * lp_relative_slope(&imager->eye->response, tone / e->scale));
}
