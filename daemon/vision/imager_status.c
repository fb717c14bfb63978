/* SPDX-License-Identifier: Apache-2.0 */
/* What the rest of the pipeline is told of the panorama. */
#include <math.h>

#include "vision/camera/remap.h"
#include "vision/film/stokes_map.h"
#include "vision/imager_internal.h"

/* What one of the cameras adds; the brightest picture tells whether all is too dark. */
static void add_eye(const struct lp_eye *eye, struct lp_imager_status *status)
{
	const struct lp_eye_exposures exposures = lp_eye_exposures(eye);

	status->invalid_samples |= exposures.invalid;
	status->exposure_unknown |= exposures.unknown;
	status->mean_code = fmaxf(status->mean_code, exposures.mean_code);
	if (eye->gain.count)
		status->scale_sigma = fmaxf(status->scale_sigma, lp_gain_sigma(&eye->gain));
	if (eye->banding.found)
		status->banding = fmaxf(status->banding, eye->banding.amplitude);
	status->response_sigma = fmaxf(status->response_sigma, lp_linearity_sigma(&eye->linearity));
	status->response_sigma = fmaxf(status->response_sigma, lp_tear_sigma(&eye->tear));
	status->response_fails |= eye->linearity.disagrees || eye->tear.found;
	status->veil_sigma = fmaxf(status->veil_sigma, lp_eye_veil_sigma(eye));
	status->covered |= eye->cover.found;
	status->hidden_s = fmaxf(status->hidden_s, eye->covered_s);
	status->hidden_share += eye->covered_share;
	if (eye->remap)
		status->cameras_sigma =
			fmaxf(status->cameras_sigma,
			      lp_overlap_sigma(&eye->overlap) * eye->remap->seen_fraction);
}

void lp_imager_status(const struct lp_imager *imager, struct lp_imager_status *status)
{
	*status = (struct lp_imager_status){
		.mean_code = NAN,
		.irradiance_sigma = imager->update.irradiance_sigma,
		.clipped_share = imager->update.clipped_share,
		.changed = imager->update.changed,
		.rotation_sigma_deg = lp_imager_turn(imager).sigma_deg,
		.rotation_is_unknown = imager->turn.agreement < LP_LEAST_AGREEMENT,
		.lost_view = imager->lost.view,
		.hidden_s = imager->lost.view
				    ? (float)(imager->t_capture_ns - imager->lost.since_ns) / 1e9F
				    : 0.0F,
		.hidden_share = imager->lost.share,
		.angles_missing =
			imager->film.stokes && !lp_stokes_polarization(&imager->film.angles).known};
	const struct lp_eye_exposures newest = lp_eye_exposures(imager->eye);

	status->exposure_count = newest.count;
	status->longest_exposure_us = newest.longest_us;
	status->newest_clips = newest.clipped_fraction;
	status->fills_view = imager->update.filled_fraction > 0.0F;
	for (int k = 0; k < imager->eye_count; k++) {
		status->places_left_out += imager->eyes[k].stuck.count;
		if (!imager->eyes[k].lost)
			add_eye(&imager->eyes[k], status);
	}
}
