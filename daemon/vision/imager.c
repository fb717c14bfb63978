/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/imager_internal.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "include/frame.h"
#include "include/luminance.h"
#include "light/find/lamps.h"
#include "light/math/grid.h"
#include "vision/camera/remap.h"
#include "vision/film/stokes_map.h"
#include "vision/map/lookup.h"
#include "vision/turn/alignment.h"

/* Where a cell of a turned picture looks, in cells: what lies between samples. */
#define PLACE_SIGMA 0.15F

int lp_imager_create(const struct lp_camera *camera, const struct lp_imager_options *options,
		     struct lp_imager **imager)
{
	const int width = options->panorama_width, height = width / 2;
	const size_t cells = (size_t)width * height + 16; /* vector loads reach beyond the last */
	struct lp_imager *m = calloc(1, sizeof(*m));
	int ret;

	if (!m)
		return -ENOMEM;
	m->options = *options;
	m->turn.agreement = 1.0F;
	m->eye = m->eyes;
	lp_motion_init(&m->turn.motion);
	ret = lp_grid_create(width, height, &m->grid);
	if (ret == 0)
		ret = lp_radiance_map_create(m->grid, &m->map);
	if (ret == 0)
		ret = lp_lookup_create(m->grid, &m->lookup);
	if (ret == 0)
		ret = lp_alignment_create(m->grid, &m->alignment);
	if (ret == 0)
		ret = lp_imager_create_film(m);
	if (ret < 0)
		goto err_destroy;
	m->panorama.width = width;
	m->panorama.height = height;
	ret = lp_imager_add_camera(m, camera);
	if (ret < 0)
		goto err_destroy;
	ret = -ENOMEM;
	m->turned = calloc(cells, sizeof(*m->turned));
	m->turned_flags = calloc(cells, 1);
	m->step2 = calloc(cells, sizeof(*m->step2));
	m->place_variance = calloc(cells, sizeof(*m->place_variance));
	m->lamp.behind = calloc(cells, sizeof(*m->lamp.behind));
	m->lamp.taken = calloc(cells, 1);
	m->lamp.pixels =
		calloc((size_t)LP_MOST_REFINE_CELLS * LP_CELL_MAX_PX, sizeof(*m->lamp.pixels));
	if (!m->turned || !m->turned_flags || !m->step2 || !m->place_variance || !m->lamp.behind ||
	    !m->lamp.taken || !m->lamp.pixels)
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
	for (int k = 0; k < imager->eye_count; k++)
		lp_eye_release(&imager->eyes[k]);
	free(imager->compared);
	free(imager->lamp.pixels);
	free(imager->lamp.taken);
	free(imager->lamp.behind);
	free(imager->film.over);
	free(imager->place_variance);
	free(imager->step2);
	free(imager->turned_flags);
	free(imager->turned);
	lp_stokes_map_destroy(imager->film.stokes);
	lp_alignment_destroy(imager->alignment);
	lp_lookup_destroy(imager->lookup);
	lp_radiance_map_destroy(imager->map);
	lp_grid_destroy(imager->grid);
	free(imager);
}

int lp_imager_add_camera(struct lp_imager *imager, const struct lp_camera *camera)
{
	const float film = imager->options.film.gain;

	if (imager->eye_count == LP_MAX_CAMERAS)
		return -EINVAL;
	if (imager->eye_count && !imager->compared)
		imager->compared = calloc(1, sizeof(*imager->compared));
	if (imager->eye_count && !imager->compared)
		return -ENOMEM;
	struct lp_eye *eye = &imager->eyes[imager->eye_count++]; /* also to be released */
	const int ret =
		lp_eye_init(eye, camera, imager->panorama.width, film > 0.0F ? 1.0F / film : 1.0F);

	lp_overlap_init(&eye->overlap, eye == imager->eyes);
	return ret;
}

const struct lp_grid *lp_imager_grid(const struct lp_imager *imager)
{
	return imager->grid;
}

const struct lp_panorama *lp_imager_panorama(const struct lp_imager *imager)
{
	return &imager->panorama;
}

const struct lp_rotation *lp_imager_rotation(const struct lp_imager *imager)
{
	return &imager->turn.motion.rotation;
}

void lp_imager_forget_all(struct lp_imager *imager)
{
	lp_radiance_map_forget(imager->map);
	if (imager->film.stokes)
		lp_stokes_map_forget(imager->film.stokes);
	imager->t_map_ns = 0;
}

void lp_imager_forget(struct lp_imager *imager)
{
	lp_eye_forget(imager->eye);
	if (lp_imager_others_know(imager, imager->eye))
		lp_imager_forget_view(imager);
	else
		lp_imager_forget_all(imager);
	lp_imager_forget_scale(imager);
}

float lp_imager_scale(const struct lp_imager *imager)
{
	return imager->eye->incoming.scale;
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

/* Float frames are radiance already: the exposure names the frame, it does not scale it. */
float lp_imager_scale_of(const struct lp_imager *imager, float exposure_us)
{
	const float film = imager->options.film.gain > 0.0F ? imager->options.film.gain : 1.0F;

	if (imager->about.format == LP_FORMAT_RGB_F32)
		return 1.0F / film;
	return isnan(exposure_us) ? imager->eye->gain.scale : 1e6F / exposure_us / film;
}

/* By how much the camera turned, in its own frame, in so long. */
static struct lp_rotation turn_within(const struct lp_motion *motion, double elapsed_s)
{
	const double turn[3] = {motion->rate[0] * elapsed_s, motion->rate[1] * elapsed_s,
				motion->rate[2] * elapsed_s};

	return lp_rotation_of_vector(turn);
}

/* What the newest frame carries of its orientation, if that is wanted, at the frame's middle. */
static struct lp_imu_sample imu_sample_of(const struct lp_imager *imager)
{
	const struct lp_frame *frame = &imager->about;
	struct lp_imu_sample sample = {0};
	double quaternion[4];

	if (!imager->options.use_orientation || isnan(frame->orientation[0]) ||
	    isnan(frame->orientation_sigma_deg))
		return sample;
	for (int i = 0; i < 4; i++)
		quaternion[i] = frame->orientation[i];
	sample.known = true;
	sample.by = frame->orientation_by;
	sample.rotation = lp_rotation_of_quaternion(quaternion);
	if (frame->t_orientation_ns) {
		const int64_t later_ns = imager->time.middle_ns - frame->t_orientation_ns;
		const struct lp_rotation turn =
			turn_within(&imager->turn.motion, (double)later_ns / 1e9);

		sample.rotation = lp_rotation_product(&sample.rotation, &turn);
	}
	sample.sigma_rad = frame->orientation_sigma_deg * M_PI / 180.0;
	return sample;
}

/* When the newest frame was taken, if it does not say itself that it was exposed for exposure_us.
 */
static void place_in_time(struct lp_imager *imager, float exposure_us)
{
	const float own_us = imager->about.exposure_us;

	imager->time = lp_frame_time(&imager->about, isnan(own_us) ? exposure_us : own_us);
	imager->turn.told = imu_sample_of(imager);
}

/* -EBADMSG, and a line in the log: nobody can tell what the frame shows. */
static int check(const struct lp_imager *imager, const struct lp_frame *frame)
{
	if (!sane(frame) || frame->camera >= imager->eye_count) {
		lp_warning("frame", "check", "no picture of %ux%u in %zu bytes; frame left out",
			   frame->width_px, frame->height_px, frame->size_bytes);
		return -EBADMSG;
	}
	if (!lp_eye_can_look(&imager->eyes[frame->camera], &frame->crop)) {
		lp_warning("frame", "check",
			   "its GPano metadata name a projection or a part of the sphere that "
			   "cannot be used; frame left out: remove them, or name a camera file "
			   "with a [crop]");
		return -EBADMSG;
	}
	const struct lp_camera *camera = imager->eyes[frame->camera].given;

	if (!lp_camera_has_shape(camera, (int)frame->width_px, (int)frame->height_px)) {
		lp_warning("frame", "check",
			   "a picture of %ux%u, but the camera file is for %dx%d, another shape: "
			   "which part of the lens it shows is not known; frame left out: set the "
			   "source's size, or calibrate the camera at this one",
			   frame->width_px, frame->height_px, camera->width_px, camera->height_px);
		return -EBADMSG;
	}
	return 0;
}

void lp_imager_map(struct lp_imager *imager)
{
	lp_eye_map(imager->eye);
	if (imager->eye->cover.found) /* most likely still */
		lp_cover_mark(&imager->eye->cover, imager->grid, imager->eye->seen.flags);
}

int lp_imager_load(struct lp_imager *imager, struct lp_frame *frame, float expected_us)
{
	struct lp_exposure *incoming;
	int ret;

	imager->loaded = false;
	ret = check(imager, frame);
	if (ret < 0) {
		lp_frame_release(frame);
		return ret;
	}
	const int64_t before_ns = imager->t_capture_ns;

	imager->about = *frame;
	imager->about.data = NULL;
	place_in_time(imager, expected_us);
	imager->t_capture_ns = imager->time.middle_ns;
	if (!lp_imager_place_still(imager, frame)) {
		imager->t_capture_ns = before_ns;
		lp_frame_release(frame);
		return -EAGAIN;
	}
	imager->eye = &imager->eyes[frame->camera];
	imager->eye->accepted = false;
	lp_eye_bend_response(imager->eye);
	(void)lp_overlap_apply(&imager->eye->overlap, &imager->eye->response);
	incoming = &imager->eye->incoming;
	lp_eye_look(imager->eye, &frame->crop);
	const struct lp_decode_options options = lp_imager_decode_options(imager, frame);
	ret = lp_eye_fit(imager->eye, (int)frame->width_px, (int)frame->height_px, options.cell_px);
	if (ret < 0) {
		lp_frame_release(frame);
		return ret;
	}
	if (ret > 0 && imager->eye->serial) /* exposures of the old size are forgotten */
		lp_imager_forget(imager);
	incoming->exposure_us = expected_us;
	incoming->scale = lp_imager_scale_of(imager, expected_us);
	imager->film.wheel_deg = frame->wheel_deg;
	imager->eye->over_film = lp_imager_over_film(imager);
	imager->eye->row_time_us = frame->row_time_us;
	ret = lp_exposure_load(incoming, frame, &options, imager->eye->row_weight,
			       imager->eye->remap->seen, &imager->eye->response);
	if (ret < 0)
		return ret;
	lp_stuck_fill(&imager->eye->stuck, &incoming->cells);
	lp_imager_map(imager);
	lp_imager_place_film(imager);
	lp_imager_expect_scale(imager);
	lp_imager_follow(imager);
	lp_imager_find_scale(imager);
	imager->loaded = true;
	return 0;
}

/* A map that began with unknown exposures has a scale of its own, and says nothing to frames of a
 * known one. The other way round it tells what is unknown. */
static void follow_scale(struct lp_imager *imager, float exposure_us)
{
	const bool coded = !isnan(imager->eye->incoming.cells.mean_code);

	if (imager->is_relative && !isnan(exposure_us)) {
		lp_imager_forget_all(imager);
		for (int k = 0; k < imager->eye_count; k++) {
			lp_eye_forget(&imager->eyes[k]);
			lp_gain_init(&imager->eyes[k].gain, imager->eyes[k].gain.scale);
		}
	}
	if (!imager->t_map_ns)
		imager->is_relative = coded && isnan(exposure_us);
	if (isnan(exposure_us))
		return;
	lp_gain_init(&imager->eye->gain, imager->eye->incoming.scale);
}

/* What each cell's luminance is off by, as the camera may be turned otherwise than it seems. */
static void weigh_place(struct lp_imager *imager)
{
	const double cells_per_rad = imager->grid->height / M_PI;
	double covariance[3][3], across[3][3]; /* d' across d: variance of where d lies, per axis */

	lp_motion_covariance(&imager->turn.motion, covariance);
	const double all = covariance[0][0] + covariance[1][1] + covariance[2][2];

	for (int a = 0; a < 3; a++)
		for (int b = 0; b < 3; b++)
			across[a][b] = ((a == b ? all : 0.0) - covariance[a][b]) / 2.0 *
				       cells_per_rad * cells_per_rad;
	lp_lookup_place_variance(imager->lookup, imager->step2, PLACE_SIGMA * PLACE_SIGMA,
				 (const double(*)[3])across, imager->place_variance);
}

static void observe(struct lp_imager *imager)
{
	struct lp_observation seen = lp_imager_residual(imager).seen;
	const double elapsed_s = (double)(imager->t_capture_ns - imager->t_map_ns) / 1e9;

	seen.late_s = imager->late_s;
	seen.longer = imager->eye->incoming.exposure_us >
		      LP_SAME_EXPOSURE * lp_eye_exposures(imager->eye).shortest_us;
	seen.elapsed_s = imager->t_map_ns && elapsed_s > 0.0 ? (float)elapsed_s : 0.0F;
	if (!lp_rotation_is_identity(&imager->turn.motion.rotation)) {
		lp_lookup_radiance(imager->lookup, seen.radiance, imager->turned, imager->step2);
		lp_lookup_marks(imager->lookup, seen.flags, imager->turned_flags);
		seen.radiance = (const float(*)[4])imager->turned;
		seen.flags = imager->turned_flags;
		seen.step2 = imager->step2;
		weigh_place(imager);
		seen.place_variance = imager->place_variance;
	}
	lp_imager_weigh_veil(imager, &seen);
	lp_imager_see_through(imager, &seen);
	imager->update = lp_radiance_map_observe(imager->map, &seen);
	if (!lp_imager_is_late(imager, elapsed_s))
		imager->t_map_ns = imager->t_capture_ns;
}

double lp_imager_eye_elapsed_s(const struct lp_imager *imager)
{
	const int64_t then_ns = imager->eye->t_seen_ns;

	return then_ns ? fmax((double)(imager->t_capture_ns - then_ns) / 1e9, 0.0) : 0.0;
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
	if (imager->eye->incoming.scale == scale)
		return;
	lp_exposure_rescale(&imager->eye->incoming, scale);
	lp_imager_map(imager);
}

void lp_imager_settle(struct lp_imager *imager, float exposure_us)
{
	struct lp_exposure *incoming = &imager->eye->incoming;

	incoming->exposure_us = exposure_us;
	lp_imager_rescale(imager, lp_imager_scale_of(imager, exposure_us));
	place_in_time(imager, exposure_us);
	const int64_t later_ns = imager->time.middle_ns - imager->t_capture_ns;

	if (imager->late_s > 0.0F || later_ns == 0)
		return;
	imager->t_capture_ns = imager->time.middle_ns;
	if (imager->turn.motion.turning)
		lp_imager_follow_again(imager);
	else
		imager->turn.t_ns = imager->t_capture_ns;
}

int lp_imager_accept(struct lp_imager *imager, float exposure_us)
{
	if (!imager->loaded)
		return -EINVAL;
	imager->loaded = false;
	lp_imager_settle(imager, exposure_us);
	follow_scale(imager, exposure_us);
	lp_imager_followed(imager);
	lp_imager_look_through_veil(imager);
	lp_imager_look_for_cover(imager);
	lp_imager_look_for_bands(imager);
	lp_imager_learn_response(imager);
	lp_imager_learn_stuck(imager);
	observe(imager);
	lp_eye_note_exposure(imager->eye, exposure_us);
	lp_imager_compare_cameras(imager);
	imager->eye->t_seen_ns = imager->t_capture_ns;
	imager->eye->accepted = true;
	for (int k = 0; k < imager->eye_count && imager->update.unsettled; k++) {
		imager->eyes[k].changed_serial = imager->eyes[k].serial;
		lp_gain_disturb(&imager->eyes[k].gain, imager->update.changed);
	}
	if (imager->turn.motion.turning || imager->turn.agreement < LP_LEAST_AGREEMENT ||
	    imager->update.changed > LP_MUCH_CHANGED)
		imager->t_moved_ns = imager->t_capture_ns;
	lp_imager_weigh_hidden(imager);
	show(imager);
	return 0;
}

float lp_imager_cells_sigma(const struct lp_imager *imager, const struct lp_lamp_finder *finder,
			    const struct lp_lamp *lamp)
{
	const struct lp_radiance_map *map = imager->map;
	double sigma = 0.0, light = 0.0;

	for (int k = lamp->first; k < lamp->first + lamp->count; k++) {
		const int cell = finder->cells[k];
		const double solid_angle_sr = lp_grid_solid_angle_sr(imager->grid, cell);

		if (map->flags[cell] || !(map->variance[cell] < LP_VARIANCE_UNKNOWN))
			continue;
		sigma += sqrt((double)map->variance[cell]) * solid_angle_sr;
		light += (double)map->radiance[cell][LP_LUMINANCE] * solid_angle_sr;
	}
	return light > 0.0 ? (float)(sigma / light) : 0.0F;
}

struct lp_rotation lp_imager_rotation_at(const struct lp_imager *imager, int64_t t_ns)
{
	struct lp_motion motion = imager->turn.motion;
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
