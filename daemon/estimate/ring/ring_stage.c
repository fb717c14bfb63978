/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/ring/ring_stage.h"

#include <math.h>
#include <string.h>

#include "estimate/ring/ring_only.h"
#include "include/light_estimate.h"
#include "include/luminance.h"
#include "include/panorama.h"
#include "light/clipped/ring_explain.h"
#include "light/lamps/lamp_memory.h"
#include "light/math/rotation.h"
#include "light/math/sh.h"
#include "vision/imager.h"

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "With the ring of light sensors". */

/* What a camera's response, vignetting and the panorama's grid do to what one sensor should see. */
#define SEEN_SIGMA 0.01F
/* A scale less certain is not told to clients. */
#define MOST_SCALE_SIGMA 0.2F
/* Below this mean code of the longest exposure a picture may be that of a covered lens: where it
 * holds no lamp, nothing in it clips, and the ring reads so many times the light that it shows. */
#define BLACK_CODE 4.0F
#define BLIND_RATIO 10.0F
/* Less light than this, in lux, is darkness for the ring, too. */
#define LEAST_LUX 1.0F
/* Of the light that clips, at most, where the scale is learned. */
#define MOST_CLIPPED_SHARE 0.02F

void lp_ring_stage_init(struct lp_ring_stage *stage, const struct lp_ring_scale *given)
{
	*stage = (struct lp_ring_stage){.given = *given, .learned = {NAN, NAN}};
	lp_ring_colour_init(&stage->colour);
}

int lp_ring_stage_resize(struct lp_ring_stage *stage, const struct lp_grid *grid)
{
	struct lp_clipped_parts *parts;
	const int ret = lp_clipped_parts_create(grid, &parts);

	if (ret < 0)
		return ret;
	lp_clipped_parts_destroy(stage->parts);
	stage->parts = parts;
	stage->fused = false;
	return 0;
}

void lp_ring_stage_finish(struct lp_ring_stage *stage)
{
	lp_clipped_parts_destroy(stage->parts);
	stage->parts = NULL;
}

void lp_ring_stage_sample(struct lp_ring_stage *stage, const struct lp_ring_sample *sample)
{
	stage->has_sample = sample;
	if (sample)
		stage->sample = *sample;
}

static void find_parts(struct lp_clipped_parts *parts, const struct lp_panorama *panorama,
		       const int32_t *finder_cells, const struct lp_lamp_memory *memory)
{
	lp_clipped_parts_of_lamps(parts, panorama, finder_cells, memory);
	lp_clipped_parts_find(parts, panorama);
	lp_clipped_parts_give_glow(parts, memory);
	for (int j = 0; j < parts->count; j++)
		if (parts->list[j].owner >= 0)
			lp_lamp_rim_apply(&memory->list[parts->list[j].owner].lamp.rim,
					  parts->list[j].tint);
}

static float facing(const float a[3], const float b[3])
{
	return fmaxf(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], 0.0F);
}

/* Lamps are known better than the panorama shows them. */
static void see_lamps(struct lp_ring_view *view, const struct lp_lamp_memory *memory,
		      const struct lp_rotation *to_panorama, const struct lp_ring_sample *sample,
		      int channel)
{
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		float normal[3];

		lp_ring_looks_along(sample, k, normal);
		lp_rotate_direction(to_panorama, normal);
		for (int p = 0; p < LP_MAX_LAMPS; p++) {
			const struct lp_remembered_lamp *m = &memory->list[p];

			if (!m->id || !m->seen)
				continue;
			view->seen[k] +=
				facing(normal, m->lamp.centroid) * m->lamp.irradiance[channel] -
				facing(normal, m->on_grid.centroid) *
					m->on_grid.irradiance[channel];
		}
		view->seen[k] = fmaxf(view->seen[k], 0.0F);
	}
}

static void look(struct lp_ring_view *view, const struct lp_ring_stage *stage,
		 const struct lp_imager *imager, const struct lp_panorama *panorama,
		 const struct lp_lamp_memory *memory, const struct lp_ring_pose *pose,
		 float seen_sigma)
{
	lp_ring_view_init(view, lp_imager_grid(imager), panorama, stage->parts, &pose->to_panorama,
			  &pose->sample, LP_LUMINANCE);
	see_lamps(view, memory, &pose->to_panorama, &pose->sample, LP_LUMINANCE);
	view->seen_sigma = seen_sigma;
}

/* What the ring read before, of the light as it is known now. */
static void look_back(struct lp_ring_stage *stage, const struct lp_imager *imager,
		      const struct lp_panorama *panorama, const struct lp_lamp_memory *memory,
		      float seen_sigma)
{
	struct lp_ring_past *past = &stage->past;

	past->count = 0;
	for (int p = 0; p < stage->poses.count; p++) {
		const struct lp_ring_pose *pose = &stage->poses.list[p];
		struct lp_ring_look *before = &past->list[past->count];

		if (!lp_ring_pose_counts(pose, lp_imager_rotation(imager), stage->sample.t_ns))
			continue;
		before->sample = pose->sample;
		before->age_s = lp_ring_pose_age_s(pose, stage->sample.t_ns);
		look(&before->view, stage, imager, panorama, memory, pose, seen_sigma);
		past->count++;
	}
}

/* Readings that did not count in the newest fusion are forgotten. */
static void keep_reading(struct lp_ring_stage *stage, const struct lp_rotation *to_panorama)
{
	if (stage->fusion.changed || stage->fusion.verdict != LP_RING_AGREES) {
		lp_ring_poses_forget(&stage->poses);
		stage->past.count = 0;
	}
	if (stage->fusion.verdict == LP_RING_AGREES)
		lp_ring_poses_keep(&stage->poses, to_panorama, &stage->sample);
}

static void colour(const struct lp_ring_stage *stage, int part, float rgb[3])
{
	for (int c = 0; c < 3; c++)
		rgb[c] = stage->fusion.excess[part] * stage->colour.tint[part][c];
}

/* Whether the part is a lamp's, and was seen. No sensor looks down: of what lies straight below the
 * ring knows nothing. */
static bool is_found(const struct lp_ring_stage *stage, int part)
{
	return stage->parts->list[part].owner >= 0 &&
	       lp_ring_sees(&stage->view, &stage->past, part, ~stage->fusion.wrong);
}

/* Of what is found of a lamp, in all its parts together. */
static float sigma_of(const struct lp_ring_stage *stage, int lamp)
{
	double variance = 0.0;

	for (int i = 0; i < stage->parts->count; i++)
		for (int j = 0; j < stage->parts->count; j++)
			if (stage->parts->list[i].owner == lamp &&
			    stage->parts->list[j].owner == lamp && is_found(stage, i) &&
			    is_found(stage, j))
				variance += stage->fusion.covariance[i][j];
	return (float)sqrt(fmax(variance, 0.0));
}

static void give_to_lamps(const struct lp_ring_stage *stage, struct lp_lamp_memory *memory)
{
	for (int j = 0; j < stage->parts->count; j++) {
		const struct lp_clipped_part *part = &stage->parts->list[j];
		const float sigma = stage->fusion.sigma[j];
		float rgb[3];

		if (!is_found(stage, j))
			continue;
		struct lp_remembered_lamp *m = &memory->list[part->owner];

		colour(stage, j, rgb);
		for (int c = 0; c < 3; c++)
			m->recovered[c] += rgb[c];
		m->recovered[LP_LUMINANCE] += stage->fusion.excess[j];
		/* what was not found, and may be there, has no known colour either */
		m->recovered_colour_sigma +=
			stage->colour.tint_sigma[j] * hypotf(stage->fusion.excess[j], sigma);
	}
	for (int k = 0; k < LP_MAX_LAMPS; k++)
		memory->list[k].recovered_sigma = sigma_of(stage, k);
}

/* What is known before the newest reading: the less, the more the scale of the radiance may have
 * changed since then. */
static struct lp_ring_scale prior_scale(const struct lp_ring_stage *stage, float scale_variance)
{
	const struct lp_ring_scale nothing = {NAN, NAN};
	/* Where all nine are off together it looks like another scale; one that was learned from
	 * these readings has that in it. */
	const struct lp_ring_scale given = {stage->given.lux_per_unit,
					    hypotf(stage->given.sigma, stage->sample.common_sigma)};
	struct lp_ring_scale prior = stage->learned;
	const float more = fmaxf(scale_variance - stage->scale_variance, 0.0F);

	if (isnan(prior.lux_per_unit))
		return stage->is_relative ? nothing : given;
	prior.sigma = sqrtf(prior.sigma * prior.sigma + more);
	return prior;
}

static void learn_scale(struct lp_ring_stage *stage, const struct lp_ring_scale *prior,
			float clipped_share, float scale_variance)
{
	const struct lp_ring_scale *now = &stage->fusion.scale;
	struct lp_ring_scale *held = &stage->learned;

	if (clipped_share > MOST_CLIPPED_SHARE || isnan(now->lux_per_unit))
		return;
	stage->scale_variance = scale_variance;
	if (isnan(held->lux_per_unit) || now->sigma < prior->sigma / 2.0F) {
		*held = *now;
		return;
	}
	held->lux_per_unit += LP_RING_LEARNED_SHARE * (now->lux_per_unit - held->lux_per_unit);
	held->sigma += LP_RING_LEARNED_SHARE * (now->sigma - held->sigma);
}

/* What is found has the colour that the ring sees, or else that of what was seen of it. */
static void find_colours(struct lp_ring_stage *stage, const struct lp_imager *imager,
			 const struct lp_panorama *panorama, const struct lp_lamp_memory *memory,
			 float clipped_share)
{
	const struct lp_rotation *to_panorama = lp_imager_rotation(imager);
	struct lp_ring_view views[3];

	if (!(stage->sample.colour_sigma > 0.0F) || stage->fusion.verdict != LP_RING_AGREES) {
		lp_ring_colour_as_seen(&stage->colour, stage->parts, &stage->fusion);
		return;
	}
	for (int c = 0; c < 3; c++) {
		lp_ring_view_init(&views[c], lp_imager_grid(imager), panorama, stage->parts,
				  to_panorama, &stage->sample, c);
		see_lamps(&views[c], memory, to_panorama, &stage->sample, c);
		views[c].seen_sigma = stage->view.seen_sigma;
	}
	lp_ring_colour_update(&stage->colour, views, &stage->sample, &stage->fusion, stage->parts,
			      clipped_share <= MOST_CLIPPED_SHARE);
}

static float mean_lux(const struct lp_ring_sample *sample)
{
	float sum = 0.0F;
	int count = 0;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		if (isfinite(sample->illuminance_lux[k])) {
			sum += sample->illuminance_lux[k];
			count++;
		}
	return count ? sum / (float)count : 0.0F;
}

static bool shows_a_lamp(const struct lp_lamp_memory *memory)
{
	for (int k = 0; k < LP_MAX_LAMPS; k++)
		if (memory->list[k].id && memory->list[k].seen)
			return true;
	return false;
}

/* Without a scale, any light counts. */
static bool is_blind(const struct lp_ring_stage *stage, const struct lp_imager_status *status,
		     const struct lp_lamp_memory *memory, const struct lp_ring_scale *scale)
{
	const float read = mean_lux(&stage->sample);
	float seen = 0.0F;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		seen += stage->view.seen[k] / LP_RING_SENSORS;
	if (!isnan(scale->lux_per_unit) && read < BLIND_RATIO * scale->lux_per_unit * seen)
		return false;
	return status->mean_code < BLACK_CODE && read > LEAST_LUX && stage->view.count == 0 &&
	       !shows_a_lamp(memory);
}

void lp_ring_stage_update(struct lp_ring_stage *stage, const struct lp_imager *imager,
			  const struct lp_panorama *panorama, const int32_t *finder_cells,
			  struct lp_lamp_memory *memory, bool is_relative)
{
	const struct lp_ring_scale nothing = {NAN, NAN};
	const struct lp_rotation *to_panorama = lp_imager_rotation(imager);
	struct lp_imager_status status;

	for (int k = 0; k < LP_MAX_LAMPS; k++) {
		memset(memory->list[k].recovered, 0, sizeof(memory->list[k].recovered));
		memory->list[k].recovered_sigma = 0.0F;
		memory->list[k].recovered_colour_sigma = 0.0F;
	}
	stage->fused = stage->has_sample;
	stage->camera_is_blind = false;
	if (!stage->has_sample)
		return;
	if (is_relative != stage->is_relative)
		stage->learned = nothing;
	stage->is_relative = is_relative;
	lp_imager_status(imager, &status);
	const float scale_variance = is_relative ? status.scale_sigma * status.scale_sigma : 0.0F;
	const struct lp_ring_scale prior = prior_scale(stage, scale_variance);

	find_parts(stage->parts, panorama, finder_cells, memory);
	const struct lp_ring_pose now = {*to_panorama, stage->sample};
	const float seen_sigma = hypotf(SEEN_SIGMA, status.irradiance_sigma);

	look(&stage->view, stage, imager, panorama, memory, &now, seen_sigma);
	stage->camera_is_blind = is_blind(stage, &status, memory, &prior);
	if (stage->camera_is_blind) {
		stage->fused = false;
		return;
	}
	look_back(stage, imager, panorama, memory, seen_sigma);
	lp_ring_fuse(&stage->view, &stage->sample, &stage->past, &prior, &stage->fusion);
	keep_reading(stage, to_panorama);
	if (!lp_ring_counts(stage->fusion.verdict))
		return;
	find_colours(stage, imager, panorama, memory, status.clipped_share);
	give_to_lamps(stage, memory);
	learn_scale(stage, &prior, status.clipped_share, scale_variance);
}

bool lp_ring_stage_stand_in(const struct lp_ring_stage *stage, const struct lp_imager *imager,
			    double total[LP_SH_MAX_COUNT][3], struct lp_light_estimate *estimate)
{
	struct lp_ring_scale scale = lp_ring_stage_scale(stage, stage->is_relative);

	if (!stage->camera_is_blind)
		return false;
	if (isnan(scale.lux_per_unit))
		scale = (struct lp_ring_scale){1.0F, 0.0F};
	lp_ring_only_light(&stage->sample, &scale, lp_imager_rotation(imager), total, estimate);
	estimate->flags |= LP_ESTIMATE_COVERED;
	return true;
}

void lp_ring_stage_project(const struct lp_ring_stage *stage, double (*total)[3])
{
	for (int j = 0; stage->fused && j < stage->parts->count; j++) {
		const struct lp_clipped_part *part = &stage->parts->list[j];
		float rgb[3];

		if (part->owner >= 0 || !(stage->fusion.excess[j] > 0.0F))
			continue;
		colour(stage, j, rgb);
		/* of Omega = 2 pi (1 - cos r) */
		lp_sh_add_lamp(LP_SH_MAX_ORDER, part->direction, rgb,
			       acos(fmax(1.0 - part->solid_angle_sr / (2.0 * M_PI), -1.0)), 1.0,
			       total);
	}
}

int lp_ring_stage_parts(const struct lp_ring_stage *stage,
			struct lp_light parts[LP_MAX_CLIPPED_PARTS])
{
	int count = 0;

	for (int j = 0; stage->fused && j < stage->parts->count; j++) {
		const struct lp_clipped_part *part = &stage->parts->list[j];
		struct lp_light *light = &parts[count];

		if (part->owner >= 0)
			continue;
		*light = (struct lp_light){.irradiance_sigma = NAN};
		memcpy(light->direction, part->direction, sizeof(light->direction));
		colour(stage, j, light->irradiance);
		for (int c = 0; c < 3; c++)
			light->irradiance[c] += part->bound[c];
		count++;
	}
	return count;
}

bool lp_ring_stage_knows(const struct lp_ring_stage *stage, float *variance)
{
	if (!stage->fused || !lp_ring_counts(stage->fusion.verdict))
		return false;
	*variance = lp_ring_variance(&stage->fusion, stage->parts);
	return true;
}

struct lp_ring_scale lp_ring_stage_scale(const struct lp_ring_stage *stage, bool is_relative)
{
	const struct lp_ring_scale nothing = {NAN, NAN};

	if (stage->fused && lp_ring_counts(stage->fusion.verdict) &&
	    stage->fusion.scale.sigma < MOST_SCALE_SIGMA)
		return stage->fusion.scale;
	return stage->given.sigma < MOST_SCALE_SIGMA && !is_relative ? stage->given : nothing;
}

struct lp_ring_status lp_ring_stage_status(const struct lp_ring_stage *stage)
{
	return (struct lp_ring_status){.camera_is_blind = stage->camera_is_blind,
				       .mean_lux = mean_lux(&stage->sample),
				       .fused = stage->fused,
				       .verdict = stage->fusion.verdict,
				       .wrong = stage->fusion.wrong,
				       .scale_is_wrong = stage->fusion.scale_is_wrong,
				       .turned_deg = stage->fusion.turned_deg,
				       .scale = stage->fusion.scale};
}
