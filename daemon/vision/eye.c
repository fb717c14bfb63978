/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/eye.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "vision/camera/remap.h"
#include "vision/glare/glare.h"
#include "vision/map/residual.h"

/* Of a cell's mean, in codes, besides the rounding of its own (vision/camera/code_noise.h). */
#define CODE_SIGMA 0.5F
/* What a cell of this code tells of its light may be rounding alone. */
#define DARK_CODE 2
/* A response that nobody has measured is light to another power than sRGB's: 1 sigma; and what is
 * left of that once it is measured. */
#define UNMEASURED_SIGMA 0.05F
#define MEASURED_SIGMA 0.01F
/* So many cells are compared between two cameras: enough for a mean. */
#define COMPARED 800
/* Exposures within half a stop of each other are one setting: an automatic camera on its way, no
 * bracket. Chosen by hand (docs/maintainers/constants.md). */
#define SAME_EXPOSURE 1.4F
/* A camera needs several frames for one change of exposure: a bracket of n takes up to 8 n frames:
 * more than MOST_DELAY_FRAMES of estimate/exposures/bracket.c each. */
#define BRACKETS_REMEMBERED 8

int lp_eye_init(struct lp_eye *eye, const struct lp_camera *camera, int panorama_width, float scale)
{
	const int height = panorama_width / 2;
	const size_t cells =
		(size_t)panorama_width * height + 16; /* vector loads reach beyond the last */

	*eye = (struct lp_eye){.camera = camera, .given = camera};
	lp_gain_init(&eye->gain, scale);
	lp_response_init(&eye->response, camera);
	lp_tear_init(&eye->tear);
	lp_linearity_init(&eye->linearity,
			  camera->response_given ? MEASURED_SIGMA : UNMEASURED_SIGMA);
	eye->seen.width = panorama_width;
	eye->seen.height = height;
	eye->mapped = calloc(cells, sizeof(*eye->mapped));
	eye->mapped_flags = calloc(cells, 1);
	return eye->mapped && eye->mapped_flags ? 0 : -ENOMEM;
}

void lp_eye_release(struct lp_eye *eye)
{
	lp_exposure_release(&eye->incoming);
	lp_stuck_release(&eye->stuck);
	lp_remap_destroy(eye->remap);
	lp_glare_destroy(eye->glare);
	free(eye->row_weight);
	free(eye->place);
	free(eye->mapped_flags);
	free(eye->mapped);
}

/* ---------------------------------------------------------------- geometry */

static int set_rows(struct lp_eye *eye, int height_px)
{
	const int rows = (height_px + 7) / 8 * 8; /* the last block may reach beyond the picture */
	float *weight = realloc(eye->row_weight, (size_t)rows * sizeof(*weight));

	if (!weight)
		return -ENOMEM;
	eye->row_weight = weight;
	memset(weight, 0, (size_t)rows * sizeof(*weight));
	for (int y = 0; y < height_px; y++)
		weight[y] = (float)lp_camera_row_sine(eye->camera, height_px, y + 0.5);
	return 0;
}

bool lp_eye_can_look(const struct lp_eye *eye, const struct lp_crop *stated)
{
	return eye->given->crop_given || !lp_crop_is_unusable(stated);
}

void lp_eye_look(struct lp_eye *eye, const struct lp_crop *stated)
{
	const struct lp_camera *given = eye->given;
	const bool is_stated = !given->crop_given && lp_crop_is_stated(stated);
	const struct lp_crop crop = is_stated ? *stated : given->crop;

	if (lp_crop_same(&crop, &eye->camera->crop))
		return;
	eye->cropped = *given;
	eye->cropped.crop = crop;
	eye->camera = &eye->cropped;
	lp_remap_destroy(eye->remap);
	eye->remap = NULL;
	lp_glare_destroy(eye->glare);
	eye->glare = NULL;
}

/* If the camera file states glare. */
static int set_glare(struct lp_eye *eye)
{
	const struct lp_glare_shares *shares = &eye->camera->glare;

	if (eye->glare || !(shares->even + shares->around > 0.0F))
		return 0;
	return lp_glare_create(eye->camera, eye->seen.width, &eye->glare);
}

int lp_eye_fit(struct lp_eye *eye, int width_px, int height_px, int cell_px)
{
	const size_t cells = (size_t)((width_px + cell_px - 1) / cell_px) *
			     (size_t)((height_px + cell_px - 1) / cell_px);
	struct lp_remap *remap = eye->remap;
	int ret;

	if (remap && remap->width_px == width_px && remap->height_px == height_px &&
	    remap->cell_px == cell_px)
		return 0;
	ret = set_rows(eye, height_px);
	if (ret < 0)
		return ret;
	free(eye->place);
	eye->place = calloc(cells, sizeof(*eye->place));
	if (!eye->place)
		return -ENOMEM;
	ret = lp_remap_create(eye->camera, width_px, height_px, cell_px, eye->seen.width, &remap);
	if (ret < 0)
		return ret;
	lp_remap_destroy(eye->remap);
	eye->remap = remap;
	ret = set_glare(eye);
	if (ret < 0)
		return ret;
	ret = lp_stuck_fit(&eye->stuck, eye->camera, width_px, height_px, cell_px);
	return ret < 0 ? ret : 1;
}

static void see_through_film(struct lp_eye *eye)
{
	for (int i = 0; i < eye->seen.width * eye->seen.height; i++)
		for (int c = 0; c < 4; c++)
			eye->mapped[i][c] = eye->seen.cells[i][c] * eye->over_film[i];
	eye->seen.cells = eye->mapped;
}

static void see_through_veil(struct lp_eye *eye)
{
	const struct lp_exposure *e = &eye->incoming;
	const bool coded = !isnan(e->cells.mean_code);

	lp_glare_take_off(eye->glare, (const float(*)[4])eye->seen.cells, eye->seen.flags,
			  coded ? e->scale * eye->response.pixel[1][DARK_CODE] : 0.0F, eye->mapped);
	eye->seen.cells = eye->mapped;
}

/* All that takes from a cell that is left out. */
static void mark_filled(struct lp_eye *eye)
{
	const struct lp_remap *remap = eye->remap;

	for (int n = 0; n < eye->stuck.count; n++) {
		const int source = eye->stuck.list[n];

		for (int k = remap->target_first[source]; k < remap->target_first[source + 1]; k++)
			eye->seen.flags[remap->target[k]] |= LP_CELL_FILLED;
	}
}

void lp_eye_map(struct lp_eye *eye)
{
	const struct lp_cells *cells = &eye->incoming.cells;
	const bool identity = eye->remap->identity;

	eye->seen.cells = identity ? cells->radiance : eye->mapped;
	eye->seen.flags = identity ? cells->clipped : eye->mapped_flags;
	lp_remap_apply(eye->remap, cells, &eye->seen);
	mark_filled(eye);
	if (eye->glare)
		see_through_veil(eye);
	if (eye->over_film)
		see_through_film(eye);
}

bool lp_eye_sees(const struct lp_eye *eye, int cell)
{
	return eye->remap && !eye->remap->unseen[cell];
}

/* ---------------------------------------------------------------- exposures */

static bool same_exposure(float a, float b)
{
	return (isnan(a) && isnan(b)) || (a <= SAME_EXPOSURE * b && b <= SAME_EXPOSURE * a);
}

/* The place of this exposure setting; else an empty one; else that seen longest ago. */
static struct lp_recent_exposure *place_for(struct lp_eye *eye, float exposure_us)
{
	struct lp_recent_exposure *oldest = &eye->recent[0];

	for (int k = 0; k < LP_MAX_BRACKET; k++) {
		struct lp_recent_exposure *e = &eye->recent[k];

		if (e->serial && same_exposure(e->exposure_us, exposure_us))
			return e;
		if (e->serial < oldest->serial)
			oldest = e;
	}
	return oldest;
}

/* A setting that has not come for the time of several brackets is no longer part of the bracket. */
void lp_eye_note_exposure(struct lp_eye *eye, float exposure_us)
{
	const struct lp_cells *cells = &eye->incoming.cells;
	int live = 0;

	eye->serial++;
	*place_for(eye, exposure_us) =
		(struct lp_recent_exposure){.exposure_us = exposure_us,
					    .mean_code = (float)cells->mean_code,
					    .clipped_fraction = eye->seen.clipped_fraction,
					    .serial = eye->serial,
					    .invalid = cells->invalid_count > 0};
	for (int k = 0; k < LP_MAX_BRACKET; k++)
		live += eye->recent[k].serial != 0;
	for (int k = 0; k < LP_MAX_BRACKET; k++) {
		struct lp_recent_exposure *e = &eye->recent[k];

		if (eye->serial - e->serial > BRACKETS_REMEMBERED * (uint64_t)live ||
		    isnan(e->exposure_us) != isnan(exposure_us))
			e->serial = 0;
	}
}

struct lp_eye_exposures lp_eye_exposures(const struct lp_eye *eye)
{
	struct lp_eye_exposures found = {.longest_us = NAN,
					 .mean_code = NAN,
					 .shortest_us = INFINITY};

	for (int k = 0; k < LP_MAX_BRACKET; k++) {
		const struct lp_recent_exposure *e = &eye->recent[k];

		if (!e->serial)
			continue;
		found.count++;
		found.current += e->serial == eye->serial || e->serial > eye->changed_serial;
		found.invalid |= e->invalid;
		/* float frames are radiance, whatever their exposure */
		found.unknown |= isnan(e->exposure_us) && !isnan(e->mean_code);
		if (isnan(found.longest_us) || e->exposure_us > found.longest_us) {
			found.longest_us = e->exposure_us;
			found.mean_code = e->mean_code;
		}
		if (e->exposure_us < found.shortest_us) { /* false for NAN */
			found.shortest_us = e->exposure_us;
			found.clipped_fraction = e->clipped_fraction;
		}
	}
	return found;
}

/* ---------------------------------------------------------------- overlap */

struct lp_observation lp_eye_observation(const struct lp_eye *eye, float flicker_sigma)
{
	const struct lp_exposure *e = &eye->incoming;
	const float common = e->noise.common;
	const struct lp_glare *glare = eye->glare;

	return (struct lp_observation){.radiance = (const float(*)[4])eye->seen.cells,
				       .flags = eye->seen.flags,
				       .response = &eye->response,
				       .scale = e->scale,
				       .coded = !isnan(e->cells.mean_code),
				       .code_variance = CODE_SIGMA * CODE_SIGMA + common * common,
				       .flicker_sigma = flicker_sigma,
				       .veil = glare ? glare->cells : NULL};
}

static bool both_see(const struct lp_eye *a, const struct lp_eye *b, int cell)
{
	return lp_eye_sees(a, cell) && lp_eye_sees(b, cell);
}

/* Every so many cells that both see are compared. */
static int stride_of(const struct lp_eye *a, const struct lp_eye *b)
{
	int count = 0;

	for (int i = 0; i < a->seen.width * a->seen.height; i++)
		count += both_see(a, b, i);
	return 1 + count / COMPARED;
}

static void compare_channel(const struct lp_eye *eye, const struct lp_eye *other, int channel,
			    int stride, struct lp_gain *cells)
{
	const struct lp_observation own = lp_eye_observation(eye, 0.0F);
	const struct lp_observation others = lp_eye_observation(other, 0.0F);
	int in_both = 0;

	cells->count = 0;
	for (int i = 0; i < eye->seen.width * eye->seen.height; i++) {
		if (!both_see(eye, other, i) || in_both++ % stride)
			continue;
		const struct lp_log_light a = lp_log_light(&own, i, channel);
		const struct lp_log_light b = lp_log_light(&others, i, channel);

		cells->cells[cells->count++] =
			(struct lp_gain_cell){.seen = a.log,
					      .reference = b.log,
					      .sigma = sqrtf(a.variance + b.variance)};
	}
}

void lp_eye_compare(struct lp_eye *eye, const struct lp_eye *other, struct lp_gain *cells)
{
	const int stride = stride_of(eye, other);

	for (int c = 0; c < 3; c++) {
		compare_channel(eye, other, c, stride, cells);
		lp_overlap_correct(&eye->overlap, c, cells, other->overlap.variance[c]);
	}
}

void lp_eye_forget(struct lp_eye *eye)
{
	eye->cover = (struct lp_cover){.found = false};
	memset(eye->recent, 0, sizeof(eye->recent));
}
