/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/ring/ring_only.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "light/math/rotation.h"
#include "light/ring/ring_alone.h"
#include "light/send/model.h"

#define PERIOD_NS (LP_NS_PER_S / 30)
/* The lamps of a camera count from 1 up. */
#define LAMP_ID UINT32_MAX
/* A lamp weaker than this many sigma is none. */
#define LEAST_SIGMAS 2.0F
/* No sensor tells colours: relative 1 sigma of a channel. Chosen by hand. */
#define COLOUR_SIGMA 0.2

void lp_ring_only_init(struct lp_ring_only *self, const struct lp_ring_scale *given,
		       float smoothing_ms, float ttl_ms, int64_t now_ns)
{
	*self = (struct lp_ring_only){.smoothing_ms = smoothing_ms,
				      .patience_ns = (int64_t)((double)ttl_ms * 1e6),
				      .t_camera_ns = now_ns,
				      .scale = *given};
	if (isnan(given->lux_per_unit))
		self->scale = (struct lp_ring_scale){1.0F, 0.0F};
}

void lp_ring_only_camera(struct lp_ring_only *self, const struct lp_light_estimate *estimate,
			 int64_t now_ns)
{
	self->t_camera_ns = now_ns;
	self->t_last_ns = 0;
	if (!isnan(estimate->cd_m2_per_unit))
		self->scale = (struct lp_ring_scale){estimate->cd_m2_per_unit,
						     estimate->cd_m2_per_unit_sigma};
}

/* The same low-pass as that of the tracker; a sensor that was missing begins anew. */
static void smooth(struct lp_ring_only *self, const struct lp_ring_sample *sample)
{
	const double elapsed_ms = (double)(sample->t_ns - self->smoothed.t_ns) / 1e6;
	const double share =
		self->smoothing_ms > 0.0F
			? 1.0 - exp(-fmax(elapsed_ms, 0.0) / (double)self->smoothing_ms)
			: 1.0;
	const struct lp_ring_sample before = self->smoothed;

	self->smoothed = *sample;
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const float held = before.illuminance_lux[k], now = sample->illuminance_lux[k];

		if (before.t_ns && isfinite(held) && isfinite(now))
			self->smoothed.illuminance_lux[k] = held + (float)share * (now - held);
	}
}

static void list_lamp(const struct lp_ring_alone *light, double unit, float common_sigma,
		      const struct lp_rotation *turn, struct lp_light_estimate *e)
{
	struct lp_light *lamp = &e->lights[0];

	e->light_count = 1;
	*lamp = (struct lp_light){.id = LAMP_ID,
				  .direction_sigma_deg = light->direction_sigma_deg,
				  .irradiance_sigma =
					  hypotf(light->lamp_sigma / light->lamp, common_sigma),
				  .colour_sigma = COLOUR_SIGMA,
				  .distance_m = NAN,
				  .flags = LP_LIGHT_RING};
	memcpy(lamp->direction, light->direction, sizeof(lamp->direction));
	lp_rotate_direction(turn, lamp->direction);
	for (int c = 0; c < 3; c++)
		lamp->irradiance[c] = (float)(light->lamp / unit);
}

/* Root mean square over normals, relative to the mean irradiance: of both parts, of what one lamp
 * does not explain, and of the colour. */
static float relighting_sigma(const struct lp_ring_alone *light)
{
	const double mean = M_PI * light->ambient + light->lamp / 4.0;
	const double direction = light->direction_sigma_deg * M_PI / 180.0 * light->lamp;
	const double lamp = (light->lamp_sigma * light->lamp_sigma + direction * direction) / 6.0;
	const double ambient = M_PI * light->ambient_sigma;
	const double parts = (lamp + ambient * ambient) * fmax(light->misfit, 1.0);

	return mean > 0.0 ? (float)sqrt(parts / (mean * mean) + COLOUR_SIGMA * COLOUR_SIGMA) : 0.0F;
}

void lp_ring_only_light(const struct lp_ring_sample *sample, const struct lp_ring_scale *scale,
			const struct lp_rotation *turn, double total[LP_SH_MAX_COUNT][3],
			struct lp_light_estimate *e)
{
	const double unit = scale->lux_per_unit;
	struct lp_ring_alone light;

	memset(total, 0, LP_SH_MAX_COUNT * sizeof(*total));
	e->light_count = e->area_count = 0;
	e->cd_m2_per_unit = (float)unit;
	e->cd_m2_per_unit_sigma = scale->sigma;
	e->relighting_sigma = 0.0F;
	e->flags = (e->flags & ~LP_ESTIMATE_NO_LIGHT) | LP_ESTIMATE_RING_ONLY;
	if (lp_ring_alone(sample, &light)) {
		for (int c = 0; c < 3; c++)
			total[0][c] = light.ambient / unit * sqrt(4.0 * M_PI);
		if (light.lamp > LEAST_SIGMAS * light.lamp_sigma) {
			list_lamp(&light, unit, sample->common_sigma, turn, e);
			lp_sh_add_lamp(LP_SH_MAX_ORDER, e->lights[0].direction,
				       e->lights[0].irradiance, 0.0, 1.0, total);
		} else { /* its light comes from all around */
			for (int c = 0; c < 3; c++)
				total[0][c] += light.lamp / unit / sqrt(4.0 * M_PI);
		}
		e->relighting_sigma = hypotf(relighting_sigma(&light), sample->common_sigma);
	} else {
		e->flags |= LP_ESTIMATE_NO_LIGHT;
	}
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			e->sh_total[i][c] = (float)total[i][c];
	lp_model_predict((const double(*)[3])total, e);
}

static void fill(const struct lp_ring_only *self, const struct lp_ring_sample *sample,
		 int64_t now_ns, struct lp_light_estimate *e)
{
	const struct lp_rotation none = lp_rotation_identity();
	double total[LP_SH_MAX_COUNT][3];

	*e = (struct lp_light_estimate){.t_capture_ns = sample->t_ns,
					.t_arrival_ns = now_ns,
					.suspended_ns = lp_clock_suspended_ns(),
					.exposure_us = NAN,
					.scale_sigma = NAN,
					.wheel_deg = NAN,
					.wheel_sigma_deg = NAN};
	lp_ring_only_light(sample, &self->scale, &none, total, e);
}

bool lp_ring_only_sample(struct lp_ring_only *self, const struct lp_ring_sample *sample,
			 int64_t now_ns, struct lp_estimates *estimates)
{
	smooth(self, sample);
	if (now_ns - self->t_camera_ns < self->patience_ns ||
	    (self->t_last_ns && now_ns - self->t_last_ns < PERIOD_NS))
		return false;
	self->t_last_ns = now_ns;
	*estimates = (struct lp_estimates){0};
	fill(self, sample, now_ns, &estimates->raw);
	fill(self, &self->smoothed, now_ns, &estimates->smoothed);
	return true;
}
