/* SPDX-License-Identifier: Apache-2.0 */
/* What the imager does only because there may be several cameras. */
#include <math.h>

#include "base/log.h"
#include "include/frame.h"
#include "light/math/grid.h"
#include "vision/imager_internal.h"

/* A longest exposure and a transfer: so much later than another's may a camera's frame come that
 * was exposed before it. */
#define MOST_LATE_S 0.15

bool lp_imager_others_know(const struct lp_imager *imager, const struct lp_eye *eye)
{
	for (int k = 0; k < imager->eye_count; k++)
		if (&imager->eyes[k] != eye && imager->eyes[k].serial)
			return true;
	return false;
}

void lp_imager_forget_view(struct lp_imager *imager)
{
	const struct lp_residual residual = lp_imager_residual(imager);

	for (int i = 0; i < imager->grid->width * imager->grid->height; i++)
		if (lp_eye_sees(imager->eye, lp_residual_seen(&residual, i)))
			lp_radiance_map_forget_cell(imager->map, i);
}

void lp_imager_begin(struct lp_imager *imager, int camera)
{
	imager->eye = &imager->eyes[camera];
	imager->eye->lost = false;
	lp_eye_forget(imager->eye);
	if (!lp_imager_others_know(imager, imager->eye))
		lp_imager_forget_all(imager);
	lp_imager_forget_scale(imager);
}

void lp_imager_lose(struct lp_imager *imager, int camera)
{
	imager->eyes[camera].lost = true;
	imager->eyes[camera].t_seen_ns = 0;
	if (!imager->lost.since_ns)
		imager->lost.since_ns = imager->t_capture_ns;
}

int lp_imager_current_exposures(const struct lp_imager *imager, int camera)
{
	return lp_eye_exposures(&imager->eyes[camera]).current;
}

void lp_imager_view(const struct lp_imager *imager, uint8_t *cells)
{
	const struct lp_residual residual = lp_imager_residual(imager);

	for (int i = 0; i < imager->grid->width * imager->grid->height; i++)
		cells[i] = lp_eye_sees(imager->eye, lp_residual_seen(&residual, i));
}

bool lp_imager_place_still(struct lp_imager *imager, const struct lp_frame *frame)
{
	const double late_s = (double)(imager->t_map_ns - imager->t_capture_ns) / 1e9;

	imager->late_s = 0.0F;
	if (!(frame->flags & LP_FRAME_STILL) || !imager->t_map_ns || late_s <= 0.0)
		return true;
	if (imager->t_moved_ns >= lp_frame_start_ns(frame)) {
		lp_info("still", "place",
			"left out: the box turned, or the light changed, in the %.1f s since it "
			"was taken",
			late_s);
		return false;
	}
	imager->late_s = (float)late_s;
	imager->t_capture_ns = imager->t_map_ns;
	return true;
}

bool lp_imager_is_late(const struct lp_imager *imager, double elapsed_s)
{
	return imager->eye_count > 1 && elapsed_s < 0.0 && elapsed_s > -MOST_LATE_S;
}

/* Two frames show the same when the box turned so little between them: half a cell. */
static bool same_time(const struct lp_imager *imager, const struct lp_eye *other)
{
	const double apart_s = fabs((double)(imager->t_capture_ns - other->t_seen_ns)) / 1e9;
	const double *r = imager->turn.motion.rate;
	const double rate = sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);

	return other->accepted && apart_s < MOST_LATE_S &&
	       apart_s * rate < 0.5 * M_PI / imager->grid->height;
}

void lp_imager_compare_cameras(struct lp_imager *imager)
{
	struct lp_eye *eye = imager->eye;

	if (eye != imager->eyes) /* the first one's scale is that of the map */
		lp_overlap_pass(&eye->overlap, (float)lp_imager_eye_elapsed_s(imager));
	for (int k = 0; k < imager->eye_count; k++) {
		struct lp_eye *other = &imager->eyes[k];

		if (other == eye || !same_time(imager, other))
			continue;
		if (other < eye)
			lp_eye_compare(eye, other, imager->compared);
		else
			lp_eye_compare(other, eye, imager->compared);
	}
}
