/* SPDX-License-Identifier: Apache-2.0 */
#include "light/send/model.h"

#include <math.h>
#include <string.h>

#include "include/luminance.h"
#include "light/film/polarization.h"

_Static_assert(LP_FINE_SH_COUNT == LP_SH_MAX_COUNT, "all bands of the projection");

static double luminance(const double rgb[3])
{
	return LP_LUMINANCE_R * rgb[0] + LP_LUMINANCE_G * rgb[1] + LP_LUMINANCE_B * rgb[2];
}

float lp_light_rank(const struct lp_light *light)
{
	return lp_luminance(light->irradiance) * (1.0F + light->hidden);
}

float lp_facing_share(const struct lp_light_estimate *estimate, int index)
{
	const struct lp_light *light = &estimate->lights[index];
	const float own = lp_luminance(light->irradiance);
	float facing[3];

	lp_sh_irradiance(2, estimate->sh_total, light->direction, facing);
	/* order 2 carries 15/16 of a lamp's own irradiance towards a surface facing it (17/16 in
	 * all) */
	const float all = lp_luminance(facing);
	const float rest = fmaxf(all - own * 17.0F / 16.0F, 0.0F);

	return own > 0.0F ? own / (own + rest) : 0.0F;
}

static float upward_irradiance_of(const struct lp_light *light)
{
	return lp_luminance(light->irradiance) * fmaxf(light->direction[1], 0.0F);
}

float lp_upward_irradiance(const struct lp_light_estimate *estimate)
{
	static const float up[3] = {0.0F, 1.0F, 0.0F};
	float ambient[LP_MAX_SH_COUNT][3], rest[3];

	lp_model_ambient(estimate, LP_MAX_SH_ORDER, estimate->light_count, ambient);
	lp_sh_irradiance(LP_MAX_SH_ORDER, (const float(*)[3])ambient, up, rest);
	float sum = lp_luminance(rest);

	if (sum < 0.0F)
		sum = 0.0F;
	for (int k = 0; k < estimate->light_count; k++)
		sum += upward_irradiance_of(&estimate->lights[k]);
	return sum;
}

float lp_shadow_strength(const struct lp_light *light, float upward)
{
	return upward > 0.0F ? fminf(upward_irradiance_of(light) / upward, 1.0F) : NAN;
}

/* Root mean square over normals of the irradiance in the bands above each order, luminance. */
static void residual_rms(const double (*sh)[3], double rms[LP_MAX_SH_ORDER + 1])
{
	double sum = 0.0;

	for (int l = LP_SH_MAX_ORDER; l > 0; l--) {
		const double a = lp_sh_cosine(l);

		for (int i = l * l; i < (l + 1) * (l + 1); i++)
			sum += a * a * luminance(sh[i]) * luminance(sh[i]);
		if (l - 1 <= LP_MAX_SH_ORDER)
			rms[l - 1] = sqrt(sum / (4.0 * M_PI));
	}
}

double lp_model_mean_irradiance(const struct lp_light_estimate *estimate)
{
	/* integral of radiance / 4 = sqrt(4 pi) L00 / 4 */
	return lp_luminance(estimate->sh_total[0]) * sqrt(4.0 * M_PI) / 4.0;
}

float lp_model_distance(const struct lp_light_estimate *estimate,
			const struct lp_light_estimate *other)
{
	const double mean = lp_model_mean_irradiance(estimate);
	double sum = 0.0;

	for (int l = 0; l <= LP_MAX_SH_ORDER; l++)
		for (int i = l * l; i < (l + 1) * (l + 1); i++) {
			const double apart =
				lp_sh_cosine(l) * ((double)lp_luminance(estimate->sh_total[i]) -
						   (double)lp_luminance(other->sh_total[i]));

			sum += apart * apart;
		}
	return mean > 0.0 ? (float)(sqrt(sum / (4.0 * M_PI)) / mean) : 0.0F;
}

void lp_model_predict(const double (*total)[3], struct lp_light_estimate *estimate)
{
	/* mean irradiance over normals = integral of radiance / 4 = sqrt(4 pi) L00 / 4 */
	const double mean = luminance(total[0]) * sqrt(4.0 * M_PI) / 4.0;
	double residual[LP_SH_MAX_COUNT][3];
	float shadow[LP_MAX_LIGHTS + 1] = {0.0F}; /* contrast lost with lights k and beyond */

	memcpy(residual, total, sizeof(residual));
	for (int i = 0; i < LP_FINE_SH_COUNT; i++)
		estimate->fine_sh[i] = (float)luminance(total[i]);
	for (int k = estimate->light_count - 1; k >= 0; k--)
		shadow[k] = shadow[k + 1] + lp_facing_share(estimate, k);
	for (int k = 0; k <= LP_MAX_LIGHTS; k++) {
		double rms[LP_MAX_SH_ORDER + 1];

		residual_rms(residual, rms);
		for (int l = 0; l <= LP_MAX_SH_ORDER; l++)
			estimate->predicted_error[l][k] =
				mean > 0.0 ? (float)(rms[l] / mean) + LP_SHADOW_SHARE * shadow[k]
					   : 0.0F;
		if (k < estimate->light_count)
			lp_sh_add_lamp(LP_SH_MAX_ORDER, estimate->lights[k].direction,
				       estimate->lights[k].irradiance, 0.0, -1.0, residual);
	}
}

void lp_model_choose(const struct lp_light_estimate *estimate, int max_order, int max_lights,
		     float tolerance, int *order, int *lights)
{
	const int most = max_lights < estimate->light_count ? max_lights : estimate->light_count;
	int least_bytes = -1;

	*order = max_order;
	*lights = most;
	if (!(tolerance > 0.0F))
		return;
	for (int l = 0; l <= max_order; l++)
		for (int k = 0; k <= most; k++) {
			const int bytes =
				LP_COEFFICIENT_BYTES * LP_SH_COUNT(l) + LP_LIGHT_BYTES * k;

			if (estimate->predicted_error[l][k] > tolerance ||
			    (least_bytes >= 0 && bytes >= least_bytes))
				continue;
			least_bytes = bytes;
			*order = l;
			*lights = k;
		}
}

void lp_model_ambient(const struct lp_light_estimate *estimate, int order, int lights,
		      float (*ambient)[3])
{
	double sh[LP_MAX_SH_COUNT][3];
	const int count = LP_SH_COUNT(order);

	for (int i = 0; i < count; i++)
		for (int c = 0; c < 3; c++)
			sh[i][c] = estimate->sh_total[i][c];
	for (int k = 0; k < lights; k++)
		lp_sh_add_lamp(order, estimate->lights[k].direction, estimate->lights[k].irradiance,
			       0.0, -1.0, sh);
	for (int i = 0; i < count; i++)
		for (int c = 0; c < 3; c++)
			ambient[i][c] = (float)sh[i][c];
}

void lp_model_turn_light(struct lp_light *light, const struct lp_rotation *rotation)
{
	const float turn_deg =
		lp_stokes_frame_turn(rotation, light->direction) * 180.0F / (float)M_PI;

	light->polarization.aolp_deg =
		fmodf(light->polarization.aolp_deg - turn_deg + 360.0F, 180.0F);
	lp_rotate_direction(rotation, light->direction);
	lp_rotate_direction(rotation, light->axis);
}

static void turn_room(struct lp_estimate_room *room, const struct lp_rotation *rotation)
{
	double xyzw[4] = {room->xyzw[0], room->xyzw[1], room->xyzw[2], room->xyzw[3]};
	const struct lp_rotation box = lp_rotation_of_quaternion(xyzw);
	const struct lp_rotation turned = lp_rotation_product(rotation, &box);

	lp_rotation_quaternion(&turned, xyzw);
	for (int i = 0; i < 4; i++)
		room->xyzw[i] = (float)xyzw[i];
}

void lp_model_turn(struct lp_light_estimate *estimate, const struct lp_rotation *rotation,
		   float sigma_deg)
{
	lp_sh_rotate(rotation, LP_MAX_SH_ORDER, estimate->sh_total);
	for (int k = 0; k < estimate->light_count; k++) {
		struct lp_light *const light = &estimate->lights[k];

		lp_model_turn_light(light, rotation);
		light->direction_sigma_deg = hypotf(light->direction_sigma_deg, sigma_deg);
	}
	if (estimate->room.known && !lp_rotation_is_identity(rotation))
		turn_room(&estimate->room, rotation);
}
