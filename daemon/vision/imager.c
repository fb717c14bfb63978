/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/imager_internal.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "include/frame.h"
#include "light/grid.h"
#include "vision/change.h"
#include "vision/merge.h"
#include "vision/remap.h"

/* Exposures within half a stop of each other are one setting: an automatic camera on its way, no
 * bracket. Chosen by hand (docs/maintainers/constants.md). */
#define SAME_EXPOSURE 1.4F
/* A camera needs several frames for one change of exposure: a bracket of n takes up to 8 n frames:
 * more than MOST_DELAY_FRAMES of app/bracket.c each. */
#define STALE_BRACKETS 8
/* When more than this share of the light is another, exposures from before and after do not belong
 * together. Measured (docs/users/accuracy.md, "While the camera turns"): with 0.05 up to 5 % of the
 * packets of a turning camera are wrong without a flag, with 0.02 none. */
#define CHANGED 0.02F

int lp_imager_create(const struct lp_camera *camera, const struct lp_imager_options *options,
		     struct lp_imager **imager)
{
	const int width = options->panorama_width, height = width / 2;
	struct lp_imager *m = calloc(1, sizeof(*m));
	int ret;

	if (!m)
		return -ENOMEM;
	m->camera = camera;
	m->options = *options;
	lp_response_init(&m->response, camera);
	ret = lp_grid_create(width, height, &m->grid);
	if (ret < 0)
		goto err_destroy;
	ret = -ENOMEM;
	m->panorama.width = width;
	m->panorama.height = height;
	m->mapped = calloc((size_t)width * height, sizeof(*m->mapped));
	m->panorama.cells = m->mapped;
	m->flags = calloc((size_t)width * height, 1);
	m->panorama.flags = m->flags;
	m->pixels = calloc((size_t)LP_REFINE_MAX_CELLS * LP_CELL_MAX_PX, sizeof(*m->pixels));
	if (!m->mapped || !m->flags || !m->pixels)
		goto err_destroy;
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
	for (int k = 0; k < LP_MAX_BRACKET; k++)
		lp_exposure_release(&imager->exposure[k]);
	lp_cells_release(&imager->merged);
	lp_remap_destroy(imager->remap);
	lp_grid_destroy(imager->grid);
	free(imager->row_weight);
	free(imager->pixels);
	free(imager->place);
	free(imager->flags);
	free(imager->mapped);
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

static void empty_slot(struct lp_exposure *exposure)
{
	exposure->serial = 0;
	lp_frame_release(exposure->frame);
	exposure->frame = NULL;
}

void lp_imager_forget(struct lp_imager *imager)
{
	for (int k = 0; k < LP_MAX_BRACKET; k++)
		empty_slot(&imager->exposure[k]);
	imager->shown = NULL;
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

static bool same_exposure(float a, float b)
{
	return (isnan(a) && isnan(b)) || (a <= SAME_EXPOSURE * b && b <= SAME_EXPOSURE * a);
}

void lp_imager_keep(struct lp_imager *imager, const float *exposures_us, int count)
{
	for (int k = 0; k < LP_MAX_BRACKET; k++) {
		struct lp_exposure *e = &imager->exposure[k];
		bool wanted = false;

		for (int i = 0; i < count; i++)
			wanted |= same_exposure(e->exposure_us, exposures_us[i]);
		if (e->serial && !wanted)
			empty_slot(e);
	}
}

/* The slot of this exposure setting; else an empty one; else that refreshed longest ago. */
static struct lp_exposure *slot_for(struct lp_imager *imager, float exposure_us)
{
	struct lp_exposure *oldest = &imager->exposure[0];

	for (int k = 0; k < LP_MAX_BRACKET; k++) {
		struct lp_exposure *e = &imager->exposure[k];

		if (e->serial && same_exposure(e->exposure_us, exposure_us))
			return e;
		if (e->serial < oldest->serial)
			oldest = e;
	}
	return oldest;
}

/*
 * A setting that several whole brackets have passed by is no longer part of the bracket. Frames of
 * unknown exposure do not mix with known ones: the newest kind rules.
 */
static void forget_stale(struct lp_imager *imager, const struct lp_exposure *newest)
{
	int live = 0;

	for (int k = 0; k < LP_MAX_BRACKET; k++)
		live += imager->exposure[k].serial != 0;
	for (int k = 0; k < LP_MAX_BRACKET; k++) {
		struct lp_exposure *e = &imager->exposure[k];

		if (!e->serial || e == newest)
			continue;
		if (newest->serial - e->serial > STALE_BRACKETS * (uint64_t)live ||
		    isnan(e->exposure_us) != isnan(newest->exposure_us))
			empty_slot(e);
	}
}

_Static_assert(LP_MAX_BRACKET <= LP_MERGE_MAX, "all exposures are merged at once");

static int refresh(struct lp_imager *imager)
{
	const struct lp_cells *cells[LP_MAX_BRACKET];
	int count = 0;

	for (int k = 0; k < LP_MAX_BRACKET; k++)
		if (imager->exposure[k].serial)
			cells[count++] = &imager->exposure[k].cells;
	if (count > 1) {
		int ret = lp_merge(cells, count, &imager->response, &imager->merged);

		if (ret < 0)
			return ret;
		cells[0] = &imager->merged;
	}
	imager->shown = cells[0];
	imager->panorama.cells = imager->remap->identity ? cells[0]->radiance : imager->mapped;
	imager->panorama.flags = imager->remap->identity ? cells[0]->clipped : imager->flags;
	lp_remap_apply(imager->remap, cells[0], &imager->panorama);
	return 0;
}

static bool sane(const struct lp_frame *frame)
{
	return frame->width_px >= 2 && frame->height_px >= 2 && frame->width_px <= 16384 &&
	       frame->height_px <= 16384 && frame->size_bytes > 0 &&
	       (isnan(frame->exposure_us) || frame->exposure_us > 0.0F) &&
	       (isnan(frame->gain) || frame->gain > 0.0F);
}

/* float frames are radiance already: the exposure names the frame, it does not scale it */
static float scale_of(const struct lp_exposure *exposure, float exposure_us)
{
	const bool coded = !isnan(exposure->cells.mean_code);

	return coded && !isnan(exposure_us) ? 1e6F / exposure_us : 1.0F;
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
	imager->incoming_t_capture_ns = frame->t_start_ns + duration_ns / 2;
	incoming->exposure_us = expected_us;
	incoming->scale = isnan(expected_us) || frame->format == LP_FORMAT_RGB_F32
				  ? 1.0F
				  : 1e6F / expected_us;
	ret = lp_exposure_load(incoming, frame, &options, imager->row_weight, &imager->response);
	imager->loaded = ret == 0;
	return ret;
}

int lp_imager_accept(struct lp_imager *imager, float exposure_us)
{
	struct lp_exposure *slot = slot_for(imager, exposure_us);
	const struct lp_exposure recycled = *slot;

	if (!imager->loaded)
		return -EINVAL;
	imager->loaded = false;
	lp_exposure_rescale(&imager->incoming, scale_of(&imager->incoming, exposure_us));
	const struct lp_cells *before = slot->serial ? &slot->cells : imager->shown;
	const bool changed = before && imager->shown &&
			     lp_cells_change(&imager->incoming.cells, before, imager->shown,
					     imager->row_weight) > CHANGED;

	*slot = imager->incoming;
	imager->incoming = recycled;
	lp_frame_release(recycled.frame);
	imager->incoming.frame = NULL;
	slot->exposure_us = exposure_us;
	slot->serial = ++imager->serial;
	if (changed)
		imager->changed_serial = slot->serial;
	imager->panorama.t_capture_ns = imager->incoming_t_capture_ns;
	forget_stale(imager, slot);
	return refresh(imager);
}

int lp_imager_add(struct lp_imager *imager, struct lp_frame *frame)
{
	const float exposure_us = lp_frame_exposure_us(frame);
	int ret = lp_imager_load(imager, frame, exposure_us);

	return ret < 0 ? ret : lp_imager_accept(imager, exposure_us);
}

void lp_imager_status(const struct lp_imager *imager, struct lp_imager_status *status)
{
	*status = (struct lp_imager_status){.longest_exposure_us = NAN, .mean_code = NAN};
	for (int k = 0; k < LP_MAX_BRACKET; k++) {
		const struct lp_exposure *e = &imager->exposure[k];

		if (!e->serial)
			continue;
		status->exposure_count++;
		status->current_count +=
			e->serial == imager->serial || e->serial > imager->changed_serial;
		status->invalid_samples |= e->cells.invalid_count > 0;
		/* float frames are radiance, whatever their exposure */
		status->exposure_unknown |= isnan(e->exposure_us) && !isnan(e->cells.mean_code);
		if (isnan(status->longest_exposure_us) ||
		    e->exposure_us > status->longest_exposure_us) {
			status->longest_exposure_us = e->exposure_us;
			status->mean_code = (float)e->cells.mean_code;
		}
	}
}
