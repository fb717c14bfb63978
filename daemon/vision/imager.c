/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/imager_internal.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "include/frame.h"
#include "include/luminance.h"
#include "light/grid.h"
#include "vision/alignment.h"
#include "vision/lookup.h"
#include "vision/remap.h"
#include "vision/stokes_map.h"

/* Exposures within half a stop of each other are one setting: an automatic camera on its way, no
 * bracket. Chosen by hand (docs/maintainers/constants.md). */
#define SAME_EXPOSURE 1.4F
/* A camera needs several frames for one change of exposure: a bracket of n takes up to 8 n frames:
 * more than MOST_DELAY_FRAMES of app/bracket.c each. */
#define STALE_BRACKETS 8
/* When more than this share of the light is another, exposures from before count as missing. Chosen
 * by hand. */
#define CHANGED 0.02F
/* How much all cells may have changed then, 1 sigma: by so many times that share, and at most. */
#define STIR 4.0F
#define MOST_STIRRED 0.5F
/* Where a cell of a turned picture looks, in cells: what lies between samples. */
#define PLACE_SIGMA 0.15

int lp_imager_create(const struct lp_camera *camera, const struct lp_imager_options *options,
		     struct lp_imager **imager)
{
	const int width = options->panorama_width, height = width / 2;
	const size_t cells = (size_t)width * height + 16; /* vector loads reach beyond the last */
	struct lp_imager *m = calloc(1, sizeof(*m));
	int ret;

	if (!m)
		return -ENOMEM;
	m->camera = camera;
	m->options = *options;
	m->agreement = 1.0F;
	lp_gain_init(&m->gain, options->film.gain > 0.0F ? 1.0F / options->film.gain : 1.0F);
	lp_response_init(&m->response, camera);
	lp_motion_init(&m->motion);
	ret = lp_grid_create(width, height, &m->grid);
	if (ret == 0)
		ret = lp_radiance_map_create(m->grid, &m->map);
	if (ret == 0)
		ret = lp_lookup_create(m->grid, &m->lookup);
	if (ret == 0)
		ret = lp_alignment_create(m->grid, &m->alignment);
	if (ret == 0 && options->film.gain > 0.0F)
		ret = lp_stokes_map_create(m->grid, &m->stokes);
	if (ret < 0)
		goto err_destroy;
	ret = -ENOMEM;
	m->seen.width = m->panorama.width = width;
	m->seen.height = m->panorama.height = height;
	m->mapped = calloc(cells, sizeof(*m->mapped));
	m->mapped_flags = calloc(cells, 1);
	m->turned = calloc(cells, sizeof(*m->turned));
	m->turned_flags = calloc(cells, 1);
	m->step2 = calloc(cells, sizeof(*m->step2));
	m->behind = calloc(cells, sizeof(*m->behind));
	m->taken = calloc(cells, 1);
	m->pixels = calloc((size_t)LP_REFINE_MAX_CELLS * LP_CELL_MAX_PX, sizeof(*m->pixels));
	if (!m->mapped || !m->mapped_flags || !m->turned || !m->turned_flags || !m->step2 ||
	    !m->behind || !m->taken || !m->pixels)
		goto err_destroy;
	lp_imager_watch(m);
	*imager = m;
	return 0;

err_destroy:
	lp_imager_destroy(m);
	return ret;
}

void lp_imager_destroy(struct lp_imager *imager)
{
	if (!imager)
		return;
	lp_exposure_release(&imager->incoming);
	lp_remap_destroy(imager->remap);
	free(imager->row_weight);
	free(imager->place);
	free(imager->pixels);
	free(imager->taken);
	free(imager->behind);
	free(imager->step2);
	free(imager->turned_flags);
	free(imager->turned);
	free(imager->mapped_flags);
	free(imager->mapped);
	lp_stokes_map_destroy(imager->stokes);
	lp_alignment_destroy(imager->alignment);
	lp_lookup_destroy(imager->lookup);
	lp_radiance_map_destroy(imager->map);
	lp_grid_destroy(imager->grid);
	free(imager);
}

const struct lp_grid *lp_imager_grid(const struct lp_imager *imager)
{
	return imager->grid;
}

struct lp_panorama *lp_imager_panorama(struct lp_imager *imager)
{
	return &imager->panorama;
}

const struct lp_rotation *lp_imager_rotation(const struct lp_imager *imager)
{
	return &imager->motion.rotation;
}

void lp_imager_forget(struct lp_imager *imager)
{
	lp_radiance_map_forget(imager->map);
	imager->cover = (struct lp_cover){.found = false};
	if (imager->stokes)
		lp_stokes_map_forget(imager->stokes);
	memset(imager->recent, 0, sizeof(imager->recent));
	imager->t_map_ns = 0;
	lp_imager_forget_scale(imager);
}

/*
 * Cells as coarse as the panorama needs, a power of two up to a JPEG's block. Blocks are what
 * JPEG's block mode has; of a picture so small that its blocks are far coarser than the panorama,
 * every pixel is decoded instead.
 */
static struct lp_decode_options decode_options(const struct lp_imager *imager,
					       const struct lp_frame *frame)
{
	const struct lp_imager_options *o = &imager->options;
	struct lp_decode_options d = {.decode = o->decode,
				      .divisor = o->divisor,
				      .cell_px = 8,
				      .exact_blocks = o->exact_blocks};
	const bool blocks = frame->format != LP_FORMAT_RGB_F32 && o->decode == LP_DECODE_BLOCKS;

	if (blocks && (int)frame->width_px / 8 >= o->panorama_width / 2)
		return d;
	d.decode = LP_DECODE_PIXELS;
	if (blocks || d.divisor < 1)
		d.divisor = 1;
	while (d.cell_px > 1 && (int)frame->width_px / d.cell_px < o->panorama_width)
		d.cell_px /= 2;
	if (frame->format == LP_FORMAT_MJPEG && d.cell_px < d.divisor)
		d.cell_px = d.divisor;
	return d;
}

static bool same_geometry(const struct lp_imager *imager, const struct lp_frame *frame, int cell_px)
{
	return imager->remap && imager->remap->width_px == (int)frame->width_px &&
	       imager->remap->height_px == (int)frame->height_px &&
	       imager->remap->cell_px == cell_px;
}

static int set_rows(struct lp_imager *imager, int width_px, int height_px)
{
	const int rows = (height_px + 7) / 8 * 8; /* the last block may reach beyond the picture */
	float *weight = realloc(imager->row_weight, 2 * rows * sizeof(*weight));

	if (!weight)
		return -ENOMEM;
	imager->row_weight = weight;
	imager->row_solid_angle_sr = weight + rows;
	memset(weight, 0, 2 * rows * sizeof(*weight));
	for (int y = 0; y < height_px; y++) {
		weight[y] = imager->camera->projection == LP_EQUIRECT
				    ? (float)sin(M_PI * (y + 0.5) / height_px)
				    : 1.0F;
		imager->row_solid_angle_sr[y] =
			(float)lp_camera_pixel_solid_angle_sr(imager->camera, width_px, height_px,
							      0.5, y + 0.5);
	}
	return 0;
}

/* A new picture size: exposures of the old size are forgotten. */
static int set_geometry(struct lp_imager *imager, const struct lp_frame *frame, int cell_px)
{
	const int width = frame->width_px, height = frame->height_px;
	const size_t cells = (size_t)((width + cell_px - 1) / cell_px) *
			     (size_t)((height + cell_px - 1) / cell_px);
	struct lp_remap *remap;
	int ret = set_rows(imager, width, height);

	if (ret < 0)
		return ret;
	free(imager->place);
	imager->place = calloc(cells, sizeof(*imager->place));
	if (!imager->place)
		return -ENOMEM;
	ret = lp_remap_create(imager->camera, width, height, cell_px, imager->panorama.width,
			      &remap);
	if (ret < 0)
		return ret;
	lp_remap_destroy(imager->remap);
	imager->remap = remap;
	lp_imager_forget(imager);
	return 0;
}

float lp_imager_scale(const struct lp_imager *imager)
{
	return imager->incoming.scale;
}

void lp_imager_expect_flicker(struct lp_imager *imager, float depth)
{
	imager->flicker = depth;
}

/* ---------------------------------------------------------------- frames */

static bool sane(const struct lp_frame *frame)
{
	return frame->width_px >= 2 && frame->height_px >= 2 && frame->width_px <= 16384 &&
	       frame->height_px <= 16384 && frame->size_bytes > 0 &&
	       (isnan(frame->exposure_us) || frame->exposure_us > 0.0F) &&
	       (isnan(frame->gain) || frame->gain > 0.0F);
}

/* Full scale to radiance; of an unknown exposure what the frame before had. Float frames are
 * radiance already: the exposure names the frame, it does not scale it. */
static float scale_of(const struct lp_imager *imager, bool coded, float exposure_us)
{
	const float film = imager->options.film.gain > 0.0F ? imager->options.film.gain : 1.0F;

	if (!coded)
		return 1.0F / film;
	return isnan(exposure_us) ? imager->gain.scale : 1e6F / exposure_us / film;
}

/* The newest frame's cells on the panorama's grid. */
static void map_cells(struct lp_imager *imager)
{
	const struct lp_cells *cells = &imager->incoming.cells;
	const bool identity = imager->remap->identity;

	imager->seen.cells = identity ? cells->radiance : imager->mapped;
	imager->seen.flags = identity ? cells->clipped : imager->mapped_flags;
	lp_remap_apply(imager->remap, cells, &imager->seen);
}

/* What the frame carries of its orientation, if that is wanted. */
static struct lp_testimony testimony_of(const struct lp_imager *imager,
					const struct lp_frame *frame)
{
	struct lp_testimony testimony = {0};
	double quaternion[4];

	if (!imager->options.heed_orientation || isnan(frame->orientation[0]) ||
	    isnan(frame->orientation_sigma_deg))
		return testimony;
	for (int i = 0; i < 4; i++)
		quaternion[i] = frame->orientation[i];
	testimony.known = true;
	testimony.rotation = lp_rotation_of_quaternion(quaternion);
	testimony.sigma_rad = frame->orientation_sigma_deg * M_PI / 180.0;
	return testimony;
}

int lp_imager_load(struct lp_imager *imager, struct lp_frame *frame, float expected_us)
{
	const int64_t duration_ns =
		isnan(frame->exposure_us) ? 0 : (int64_t)((double)frame->exposure_us * 1e3);
	struct lp_exposure *incoming = &imager->incoming;
	int ret = 0;

	imager->loaded = false;
	if (!sane(frame)) {
		lp_warning("frame", "check", "no picture of %ux%u in %zu bytes; frame left out",
			   frame->width_px, frame->height_px, frame->size_bytes);
		lp_frame_release(frame);
		return -EBADMSG;
	}
	const struct lp_decode_options options = decode_options(imager, frame);
	if (!same_geometry(imager, frame, options.cell_px))
		ret = set_geometry(imager, frame, options.cell_px);
	if (ret < 0) {
		lp_frame_release(frame);
		return ret;
	}
	imager->t_capture_ns = frame->t_start_ns + duration_ns / 2;
	imager->testimony = testimony_of(imager, frame);
	incoming->exposure_us = expected_us;
	incoming->scale = scale_of(imager, frame->format != LP_FORMAT_RGB_F32, expected_us);
	imager->wheel_deg = frame->wheel_deg;
	imager->row_time_us = frame->row_time_us;
	ret = lp_exposure_load(incoming, frame, &options, imager->row_weight, &imager->response);
	if (ret < 0)
		return ret;
	map_cells(imager);
	if (imager->cover.found) /* most likely still */
		lp_cover_mark(&imager->cover, imager->grid, imager->seen.flags);
	lp_imager_place_film(imager);
	lp_imager_expect_scale(imager);
	lp_imager_follow(imager);
	lp_imager_find_scale(imager);
	imager->loaded = true;
	return 0;
}

static bool same_exposure(float a, float b)
{
	return (isnan(a) && isnan(b)) || (a <= SAME_EXPOSURE * b && b <= SAME_EXPOSURE * a);
}

/* The place of this exposure setting; else an empty one; else that seen longest ago. */
static struct lp_recent_exposure *place_for(struct lp_imager *imager, float exposure_us)
{
	struct lp_recent_exposure *oldest = &imager->recent[0];

	for (int k = 0; k < LP_MAX_BRACKET; k++) {
		struct lp_recent_exposure *e = &imager->recent[k];

		if (e->serial && same_exposure(e->exposure_us, exposure_us))
			return e;
		if (e->serial < oldest->serial)
			oldest = e;
	}
	return oldest;
}

/* A setting that has not come for the time of several brackets is no longer part of the bracket. */
static void note_exposure(struct lp_imager *imager, float exposure_us)
{
	const struct lp_cells *cells = &imager->incoming.cells;
	int live = 0;

	imager->serial++;
	*place_for(imager, exposure_us) =
		(struct lp_recent_exposure){.exposure_us = exposure_us,
					    .mean_code = (float)cells->mean_code,
					    .serial = imager->serial,
					    .invalid = cells->invalid_count > 0};
	for (int k = 0; k < LP_MAX_BRACKET; k++)
		live += imager->recent[k].serial != 0;
	for (int k = 0; k < LP_MAX_BRACKET; k++) {
		struct lp_recent_exposure *e = &imager->recent[k];

		if (imager->serial - e->serial > STALE_BRACKETS * (uint64_t)live ||
		    isnan(e->exposure_us) != isnan(exposure_us))
			e->serial = 0;
	}
}

/* A map that began with unknown exposures has a scale of its own, and says nothing to frames of a
 * known one. The other way round it tells what is unknown. */
static void heed_scale(struct lp_imager *imager, float exposure_us)
{
	const bool coded = !isnan(imager->incoming.cells.mean_code);

	if (imager->is_relative && !isnan(exposure_us))
		lp_imager_forget(imager);
	if (!imager->t_map_ns)
		imager->is_relative = coded && isnan(exposure_us);
	if (isnan(exposure_us))
		return;
	lp_gain_init(&imager->gain, imager->incoming.scale);
}

static void observe(struct lp_imager *imager)
{
	struct lp_observation seen = lp_imager_observation(imager);
	const double elapsed_s = (double)(imager->t_capture_ns - imager->t_map_ns) / 1e9;

	seen.elapsed_s = imager->t_map_ns && elapsed_s > 0.0 ? (float)elapsed_s : 0.0F;
	if (!lp_rotation_is_identity(&imager->motion.rotation)) {
		const double sigma =
			lp_motion_sigma_rad(&imager->motion) * imager->grid->height / M_PI;

		lp_lookup_radiance(imager->lookup, seen.radiance, imager->turned, imager->step2);
		lp_lookup_marks(imager->lookup, seen.flags, imager->turned_flags);
		seen.radiance = (const float(*)[4])imager->turned;
		seen.flags = imager->turned_flags;
		seen.step2 = imager->step2;
		seen.place_variance = (float)(PLACE_SIGMA * PLACE_SIGMA + sigma * sigma);
	}
	lp_imager_see_through(imager, &seen);
	imager->update = lp_radiance_map_observe(imager->map, &seen);
	if (imager->update.changed > CHANGED) {
		/* a lamp that is switched lights all of the room, little of it beyond doubt */
		const float changed = imager->update.changed;

		seen.elapsed_s = 0.0F;
		seen.stirred = fminf(STIR * changed, MOST_STIRRED);
		imager->update = lp_radiance_map_observe(imager->map, &seen);
		imager->update.changed = changed;
	}
	imager->t_map_ns = imager->t_capture_ns;
}

struct lp_cover_view lp_imager_cover_view(const struct lp_imager *imager, float exposure_us)
{
	const bool turned = !lp_rotation_is_identity(&imager->motion.rotation);
	const float scale = imager->incoming.scale;

	return (struct lp_cover_view){
		.grid = imager->grid,
		.map = imager->map,
		.lookup = turned ? imager->lookup : NULL,
		.radiance = (const float(*)[4])imager->seen.cells,
		.flags = imager->seen.flags,
		.frame_scale = scale,
		.map_scale = isnan(exposure_us) ? scale : 1e6F / exposure_us,
	};
}

/* What the map held before a hand came is true still. */
static void restore_covered(struct lp_imager *imager)
{
	const struct lp_cover_view view = lp_imager_cover_view(imager, NAN);
	const int width = imager->grid->width;

	for (int i = 0; i < width * imager->grid->height; i++) {
		const int seen = lp_cover_seen_cell(&view, i);

		if (imager->cover.near[lp_cover_block(width, seen)])
			lp_radiance_map_restore(imager->map, i, LP_COVER_COMES_S);
	}
}

/* Is the lens covered in the newest frame? Where it is, the frame tells nothing of the light. */
static void look_for_cover(struct lp_imager *imager)
{
	const double elapsed_s = (double)(imager->t_capture_ns - imager->t_map_ns) / 1e9;
	const struct lp_cover before = imager->cover;

	if (isnan(imager->incoming.cells.mean_code) || !imager->t_map_ns)
		return;
	const struct lp_cover_view view = lp_imager_cover_view(imager, NAN);

	imager->cover = lp_cover_look(&before, &view);
	imager->covered_s = before.found && imager->cover.found
				    ? imager->covered_s + (float)fmax(elapsed_s, 0.0)
				    : 0.0F;
	if (before.found || imager->cover.found)
		lp_cover_mark(&imager->cover, imager->grid, imager->seen.flags);
	if (imager->cover.found && !before.found)
		restore_covered(imager);
}

/* Share of the light that is known where the lens is covered. */
static float covered_light(const struct lp_imager *imager)
{
	const struct lp_cover_view view = lp_imager_cover_view(imager, NAN);
	const struct lp_grid *grid = imager->grid;
	double covered = 0.0, all = 0.0;

	for (int i = 0; i < grid->width * grid->height; i++) {
		const double light = (double)imager->map->radiance[i][LP_LUMINANCE] *
				     lp_grid_solid_angle_sr(grid, i);

		all += light;
		if (imager->cover.near[lp_cover_block(grid->width, lp_cover_seen_cell(&view, i))])
			covered += light;
	}
	return all > 0.0 ? (float)(covered / all) : 0.0F;
}

/* The map, as the rest of the pipeline sees it. */
static void show(struct lp_imager *imager)
{
	imager->panorama.cells = imager->map->radiance;
	imager->panorama.flags = imager->map->flags;
	imager->panorama.t_capture_ns = imager->t_capture_ns;
	imager->panorama.clipped_fraction = imager->update.clipped_fraction;
	imager->panorama.seen_fraction = imager->update.unseen_fraction > 0.0F
						 ? 1.0F - imager->update.unseen_fraction
						 : 1.0F;
}

void lp_imager_rescale(struct lp_imager *imager, float scale)
{
	if (imager->incoming.scale == scale)
		return;
	lp_exposure_rescale(&imager->incoming, scale);
	map_cells(imager);
	if (imager->cover.found)
		lp_cover_mark(&imager->cover, imager->grid, imager->seen.flags);
}

void lp_imager_settle(struct lp_imager *imager, float exposure_us)
{
	struct lp_exposure *incoming = &imager->incoming;
	const float scale = scale_of(imager, !isnan(incoming->cells.mean_code), exposure_us);

	incoming->exposure_us = exposure_us;
	lp_imager_rescale(imager, scale);
}

int lp_imager_accept(struct lp_imager *imager, float exposure_us)
{
	if (!imager->loaded)
		return -EINVAL;
	imager->loaded = false;
	lp_imager_settle(imager, exposure_us);
	heed_scale(imager, exposure_us);
	lp_imager_followed(imager);
	look_for_cover(imager);
	lp_imager_look_for_bands(imager);
	observe(imager);
	imager->covered_share = imager->cover.found ? covered_light(imager) : 0.0F;
	note_exposure(imager, exposure_us);
	if (imager->update.changed > CHANGED) {
		imager->changed_serial = imager->serial;
		lp_gain_disturb(&imager->gain, imager->update.changed);
	}
	show(imager);
	return 0;
}

struct lp_rotation lp_imager_rotation_at(const struct lp_imager *imager, int64_t t_ns)
{
	struct lp_motion motion = imager->motion;
	const double later_s = (double)(t_ns - imager->t_capture_ns) / 1e9;

	if (motion.turning && later_s > 0.0)
		lp_motion_predict(&motion, later_s);
	return motion.rotation;
}

int lp_imager_add(struct lp_imager *imager, struct lp_frame *frame)
{
	const float exposure_us = lp_frame_exposure_us(frame);
	int ret = lp_imager_load(imager, frame, exposure_us);

	return ret < 0 ? ret : lp_imager_accept(imager, exposure_us);
}

void lp_imager_status(const struct lp_imager *imager, struct lp_imager_status *status)
{
	const double *rate = imager->motion.rate;
	const double degrees = 180.0 / M_PI;

	*status = (struct lp_imager_status){
		.longest_exposure_us = NAN,
		.mean_code = NAN,
		.irradiance_sigma = imager->update.irradiance_sigma,
		.clipped_share = imager->update.clipped_share,
		.changed = imager->update.changed,
		.rotation_sigma_deg = (float)(lp_motion_sigma_rad(&imager->motion) * degrees),
		.rate_deg_per_s =
			(float)(sqrt(rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2]) *
				degrees),
		.rotation_is_unknown = imager->agreement < LP_LEAST_AGREEMENT,
		.orientation_told = imager->testimony.known,
		.orientation_left_out = imager->witness.left_out,
		.scale_sigma = imager->gain.count ? lp_gain_sigma(&imager->gain) : 0.0F,
		.banding = imager->banding.found ? imager->banding.amplitude : 0.0F,
		.covered = imager->cover.found,
		.covered_s = imager->covered_s,
		.covered_share = imager->covered_share,
		.angles_missing = imager->stokes && !lp_stokes_polarization(&imager->angles).known};
	for (int k = 0; k < LP_MAX_BRACKET; k++) {
		const struct lp_recent_exposure *e = &imager->recent[k];

		if (!e->serial)
			continue;
		status->exposure_count++;
		status->current_count +=
			e->serial == imager->serial || e->serial > imager->changed_serial;
		status->invalid_samples |= e->invalid;
		/* float frames are radiance, whatever their exposure */
		status->exposure_unknown |= isnan(e->exposure_us) && !isnan(e->mean_code);
		if (isnan(status->longest_exposure_us) ||
		    e->exposure_us > status->longest_exposure_us) {
			status->longest_exposure_us = e->exposure_us;
			status->mean_code = e->mean_code;
		}
	}
}
