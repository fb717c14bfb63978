/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/pipeline_state.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "include/luminance.h"
#include "light/math/sh.h"
#include "light/send/model.h"
#include "vision/camera/camera.h"

#define DEG (180.0F / (float)M_PI)
/* What the grid, the blocks of a JPEG and its rounding bring at best: docs/users/accuracy.md. */
#define LEAST_RELIGHTING_SIGMA 0.004
/* Thresholds of flags: chosen by hand (docs/maintainers/constants.md). */
/* Below this mean code of the longest exposure most of an 8-bit picture is noise. */
#define DARK_CODE 4.0F
/* 1 sigma, relative, of light whose exposure was commanded, but not seen to take effect. */
#define UNPROVED_SIGMA 1.0F
/* 1 sigma of the drift of the anchor frame in a second of turning, in sigmas of its frames. */
#define DRIFT_SIGMAS 4.0
/* 1 sigma of an angle that may be any: 360 / sqrt(12). */
#define MOST_DRIFT_DEG 104.0
/* 1 sigma of light that is not seen, relative, after its first second; grows with its root. */
#define COVERED_WALK 0.1

/* Less than this share of the sphere is a gap between lenses, or what a stand hides... */
#define LEAST_UNSEEN 0.02
/* ...and of more, the contrast is at least this: of a wall nobody knows what is behind the camera.
 */
#define USUAL_CONTRAST 0.75

/* The panorama's light, with each lamp's share moved from where the grid saw it to where it is:
 * shape from the grid, place and strength from the pixels. */
static void project(struct lp_pipeline *p, const struct lp_panorama *panorama, double (*total)[3])
{
	lp_sh_project(p->projector, panorama, LP_SH_MAX_ORDER, total);
	for (int k = 0; k < LP_MAX_LAMPS; k++) {
		const struct lp_remembered_lamp *m = &p->lamps.memory.list[k];

		if (!m->id || (!m->seen && !lp_lamp_may_be_hidden(m)))
			continue;
		if (m->seen)
			lp_sh_add_lamp(LP_SH_MAX_ORDER, m->on_grid.centroid, m->on_grid.irradiance,
				       0.0, -1.0, total);
		lp_sh_add_lamp(LP_SH_MAX_ORDER, m->lamp.centroid, m->lamp.irradiance, 0.0, 1.0,
			       total);
		lp_sh_add_lamp(LP_SH_MAX_ORDER, m->lamp.centroid, m->recovered, 0.0, 1.0, total);
	}
	lp_ring_stage_project(&p->ring, total);
}

/* A lower bound of which the panorama's cells do not tell: too few pixels clip, or the lamp is
 * missed in this frame alone. */
static bool clips_unseen(const struct lp_remembered_lamp *m)
{
	return lp_lamp_may_be_hidden(m) || (m->id && m->seen && !m->measured &&
					    (m->lamp.flags & ~m->on_grid.flags & LP_LIGHT_CLIPPED));
}

/* Luminance of the irradiance of such lamps. */
static float hidden_lamps(const struct lp_pipeline *p)
{
	float sum = 0.0F;

	for (int k = 0; k < LP_MAX_LAMPS; k++) {
		const struct lp_remembered_lamp *m = &p->lamps.memory.list[k];

		if (clips_unseen(m))
			sum += m->lamp.irradiance[LP_LUMINANCE];
	}
	return sum;
}

/* Whether exposures are what was commanded, for all that frames have told: nothing yet. */
static bool is_unproved(const struct lp_pipeline *p)
{
	bool is_unproved = false;

	for (int k = 0; k < p->camera_count; k++)
		is_unproved |= p->cameras[k].bracketing &&
			       p->cameras[k].bracket.state == LP_BRACKET_RUNNING &&
			       !lp_bracket_is_proved(&p->cameras[k].bracket);
	return is_unproved;
}

static uint32_t bracket_flags(const struct lp_pipeline *p)
{
	uint32_t flags = 0;

	for (int k = 0; k < p->camera_count; k++) {
		const struct lp_pipeline_camera *camera = &p->cameras[k];

		if (!camera->bracketing)
			continue;
		if (camera->bracket.state == LP_BRACKET_IGNORED)
			flags |= LP_ESTIMATE_EXPOSURE_IGNORED;
		else if (lp_imager_current_exposures(p->imager, k) < camera->bracket.plan.count)
			flags |= LP_ESTIMATE_BRACKET_INCOMPLETE;
	}
	return flags;
}

static uint32_t flags_of(const struct lp_pipeline *p, const struct lp_panorama *panorama,
			 const struct lp_imager_status *status, float mean, int lamps)
{
	uint32_t flags = 0;

	if (status->exposure_unknown)
		flags |= LP_ESTIMATE_EXPOSURE_UNKNOWN;
	if (panorama->clipped_fraction > LP_LEAST_CLIPPED_FRACTION ||
	    (p->camera_count == 1 && status->newest_clips > LP_LEAST_CLIPPED_FRACTION) ||
	    hidden_lamps(p) > 0.0F || lp_lamp_memory_flicker_clips(&p->lamps.memory))
		flags |= LP_ESTIMATE_CLIPPED;
	if (status->mean_code < DARK_CODE) /* false for NAN: float frames have no codes */
		flags |= LP_ESTIMATE_UNDEREXPOSED;
	if (panorama->seen_fraction < 1.0F || status->lost_view || status->fills_view)
		flags |= LP_ESTIMATE_PARTIAL_VIEW;
	if (status->invalid_samples)
		flags |= LP_ESTIMATE_INVALID_INPUT;
	if (lamps > p->wanted_lights)
		flags |= LP_ESTIMATE_MORE_LIGHTS;
	if (status->rotation_is_unknown)
		flags |= LP_ESTIMATE_MOTION;
	if (status->response_fails) /* then light seems to change with each exposure */
		flags |= LP_ESTIMATE_RESPONSE;
	else if (lp_lamp_memory_flicker(&p->lamps.memory) > 0.0F || status->banding > 0.0F)
		flags |= LP_ESTIMATE_FLICKER;
	if (status->covered)
		flags |= LP_ESTIMATE_COVERED;
	if (status->angles_missing)
		flags |= LP_ESTIMATE_POLARIZATION_UNKNOWN;
	if (p->lamps.film_is_turned)
		flags |= LP_ESTIMATE_FILM_TURNED;
	if (!(mean > 0.0F))
		flags |= LP_ESTIMATE_NO_LIGHT;
	if (p->in_force < p->options.preset)
		flags |= LP_ESTIMATE_DEGRADED;
	return flags | bracket_flags(p);
}

/* Variance of the irradiance, mean over all normals, that a lamp's own uncertainty brings: of its
 * strength (the mean of max(0, cos)^2 is 1/6), and of its direction (likewise of max(0, sin)^2,
 * over the lit half: 1/6). */
static double lamp_variance(const struct lp_light *light)
{
	const double own = lp_luminance(light->irradiance);
	const bool by_ring = light->flags & LP_LIGHT_RING; /* lp_ring_stage_knows() */
	const double strength =
		isnan(light->irradiance_sigma) || by_ring ? 0.0 : light->irradiance_sigma;
	const double direction = light->direction_sigma_deg / DEG;

	return own * own * (strength * strength + direction * direction) / 6.0;
}

/*
 * 1 sigma of what clipping takes, relative to the mean irradiance, where clipped cells hold at
 * least this share of the light. How much it is nobody knows: a lamp that clips in few cells may be
 * a sun. The law is a fit, that of the truth within 1 sigma in two of three scenes and within 3 in
 * 98 %: `lightprobe evaluate --brackets 1,2,3,4` prints how often it holds.
 */
static double clipped_sigma(float share)
{
	return sqrt(sqrt((double)share));
}

/* Root mean square of how much the radiance of a part of the sphere differs from the mean, relative
 * to it, as smooth as SH show it (Parseval). */
static double contrast(const struct lp_light_estimate *e)
{
	const double mean = lp_luminance(e->sh_total[0]);
	double sum = 0.0;

	for (int i = 1; i < LP_MAX_SH_COUNT; i++)
		sum += pow(lp_luminance(e->sh_total[i]), 2.0);
	return mean > 0.0 ? sqrt(sum) / mean : 0.0;
}

/*
 * What nobody has seen is filled with the mean of the rest, and may differ from it as much as other
 * parts of the sphere do. Root mean square over all normals of the irradiance of one cone that
 * holds so much more or less, relative to the mean irradiance: the mean of max(0, cos)^2 is 1/6.
 * Gaps of several places are taken for one, which is the worst.
 */
static double unseen_sigma(const struct lp_pipeline *p, const struct lp_light_estimate *e)
{
	const double unseen = 1.0 - (double)lp_imager_panorama(p->imager)->seen_fraction;
	const bool is_ball = p->camera_count == 1 && p->cameras[0].geometry->projection == LP_BALL;

	if (is_ball)
		return 4.0 * unseen * contrast(e) / sqrt(6.0);
	/* a lamp may hang there: of the light of a room that is seen in part, lamps make most */
	return unseen < LEAST_UNSEEN ? 0.0
				     : 4.0 * unseen * fmax(contrast(e), USUAL_CONTRAST) / sqrt(6.0);
}

/* e->lights and e->sh_total are set. */
static float relighting_sigma(const struct lp_pipeline *p, const struct lp_imager_status *status,
			      const struct lp_light_estimate *e)
{
	const double mean = lp_model_mean_irradiance(e);
	/* of a lamp's light, a fourth is its mean over all normals */
	const float missed_share = hidden_lamps(p) / (4.0F * (float)fmax(mean, DBL_MIN));
	double clipped = clipped_sigma(status->clipped_share + missed_share);
	/* what a hand hides, or a camera that is away saw, may have changed meanwhile, all of it
	 * alike */
	const double hidden = 4.0 * status->hidden_share * COVERED_WALK *
			      sqrt(1.0 + status->hidden_s) / sqrt(6.0);
	const double unseen = unseen_sigma(p, e);
	double lamps = 0.0;
	float variance;

	if (!(mean > 0.0))
		return 0.0F;
	if (lp_ring_stage_knows(&p->ring, &variance))
		clipped = sqrt(variance) / mean;
	for (int k = 0; k < e->light_count; k++)
		lamps += lamp_variance(&e->lights[k]) / (mean * mean);
	return (float)sqrt(LEAST_RELIGHTING_SIGMA * LEAST_RELIGHTING_SIGMA + lamps +
			   clipped * clipped + hidden * hidden + unseen * unseen +
			   (double)status->irradiance_sigma * status->irradiance_sigma +
			   (double)status->cameras_sigma * status->cameras_sigma +
			   (double)status->veil_sigma * status->veil_sigma +
			   (double)status->response_sigma * status->response_sigma +
			   (double)status->changed * status->changed +
			   (double)status->banding * status->banding);
}

void lp_pipeline_fill(struct lp_pipeline *p, const struct lp_panorama *panorama, float mean,
		      double total[LP_SH_MAX_COUNT][3], struct lp_light_estimate *e)
{
	/* more than are wanted: each list chooses for itself, with memory */
	const int most = p->wanted_lights ? p->options.max_lights : 0;
	const int lamps =
		lp_lamp_stage_list(&p->lamps, lp_imager_grid(p->imager), panorama, most, e);
	struct lp_imager_status status;

	project(p, panorama, total);
	lp_imager_status(p->imager, &status);
	if (is_unproved(p)) {
		status.exposure_unknown = true;
		status.scale_sigma = hypotf(status.scale_sigma, UNPROVED_SIGMA);
	}
	const struct lp_ring_scale scale = lp_ring_stage_scale(&p->ring, status.exposure_unknown);

	e->t_capture_ns = panorama->t_capture_ns;
	e->suspended_ns = lp_clock_suspended_ns();
	e->sequence = ++p->sequence;
	e->flags = flags_of(p, panorama, &status, mean, lamps);
	e->exposure_us = status.longest_exposure_us;
	e->exposure_count = status.exposure_count;
	e->scale_sigma = status.exposure_unknown ? status.scale_sigma : NAN;
	e->cd_m2_per_unit = scale.lux_per_unit;
	e->cd_m2_per_unit_sigma = scale.sigma;
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			e->sh_total[i][c] = (float)total[i][c];
	for (int k = 0; k < e->light_count; k++) {
		struct lp_light *const light = &e->lights[k];

		/* its phase is not known */
		light->irradiance_sigma = hypotf(light->irradiance_sigma, status.banding);
		light->direction_sigma_deg =
			hypotf(light->direction_sigma_deg, p->options.rig_sigma_deg);
		if (p->camera_count == 1)
			light->direction_sigma_deg =
				hypotf(light->direction_sigma_deg,
				       (float)lp_camera_pointing_sigma_deg(p->cameras[0].geometry,
									   light->direction));
	}
	e->relighting_sigma = relighting_sigma(p, &status, e);
	lp_model_predict((const double(*)[3])total, e);
	(void)lp_ring_stage_stand_in(&p->ring, p->imager, total, e);
}

/* While the camera turns, the anchor frame drifts by more than the sigma of each frame says; and
 * while it turns unseen, by all of that. */
static void note_drift(struct lp_pipeline *p, const struct lp_imager_turn *turn, int64_t t_ns)
{
	const double sigma_deg = DRIFT_SIGMAS * (double)turn->sigma_deg;
	const double elapsed_s =
		p->t_drift_ns && t_ns > p->t_drift_ns ? (double)(t_ns - p->t_drift_ns) / 1e9 : 0.0;
	const double unseen_deg = (double)turn->unseen_rate_deg_per_s * elapsed_s;
	const double drift_deg = fmin(sqrt(p->drift_deg2) + unseen_deg, MOST_DRIFT_DEG);

	p->drift_deg2 = drift_deg * drift_deg + sigma_deg * sigma_deg * elapsed_s;
	p->t_drift_ns = t_ns;
}

static void set_xyzw(struct lp_estimate_orientation *o, const struct lp_rotation *rotation)
{
	double quaternion[4];

	lp_rotation_quaternion(rotation, quaternion);
	for (int i = 0; i < 4; i++)
		o->xyzw[i] = (float)quaternion[i];
}

/* A gyroscope tells turns, but no world. */
struct lp_estimate_orientation lp_pipeline_orientation(struct lp_pipeline *p, int64_t t_ns)
{
	struct lp_estimate_orientation o = {0};
	const struct lp_imager_turn turn = lp_imager_turn(p->imager);
	const struct lp_imager_told told = lp_imager_told(p->imager);

	note_drift(p, &turn, t_ns);
	o.left_out = told.left_out;
	if (p->options.orientation == LP_ORIENTATION_FRAMES ||
	    p->options.orientation == LP_ORIENTATION_CLIENT) {
		o.known = o.world = told.known && !o.left_out;
		o.places_left_out = lp_lamp_memory_doubts_places(&p->lamps.memory);
		o.has_position = o.world && told.position_sigma_m > 0.0 && !o.places_left_out;
		for (int a = 0; a < 3; a++)
			o.position_m[a] = (float)told.position_m[a];
		if (told.known)
			set_xyzw(&o, &told.rotation);
		o.sigma_deg = told.sigma_deg;
	} else if (p->options.orientation != LP_ORIENTATION_NONE) {
		const struct lp_rotation turned =
			lp_rotation_product(&p->origin, lp_imager_rotation(p->imager));

		set_xyzw(&o, &turned);
		o.known = true;
		o.sigma_deg = hypotf(turn.sigma_deg, sqrtf((float)p->drift_deg2));
	}
	return o;
}
