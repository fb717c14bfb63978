/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/drawn/drawn.h"

#include <math.h>

#include "base/clock.h"
#include "light/send/cube.h"

/* A smaller map takes the place of a larger one when its error has been below this share of the
 * tolerance for so long. */
#define CERTAINLY_FITS 0.85F
#define PATIENCE_NS (2 * LP_NS_PER_S)
/* Errors that are stated hold in 19 of 20 rooms: 2 sigma of the light. */
#define SIGMAS 2.0F
/* Where the light is not known as exactly as was asked, no model suffices. Then it is enough that
 * what is left out makes the error larger by a tenth: sqrt(1.1^2 - 1) of what the light has. */
#define AS_GOOD 0.458F
/* Nothing is known of what a mirror shows without a map. */
#define UNKNOWN 1.0F

int lp_drawn_size_index(int size)
{
	return size >= 64 ? 2 : size >= 32 ? 1 : 0;
}

bool lp_drawn_is_nothing(const struct lp_drawn *tolerance)
{
	return !(lp_drawn_least(tolerance) > 0.0F);
}

float lp_drawn_least(const struct lp_drawn *tolerance)
{
	float least = 0.0F;

	for (int t = 0; t < LP_DRAWN_THINGS; t++)
		if (tolerance->of[t] > 0.0F && (least == 0.0F || tolerance->of[t] < least))
			least = tolerance->of[t];
	return least;
}

/* What the light as known adds to an error, before it is weighed. */
static float known(float sigma)
{
	return isfinite(sigma) ? SIGMAS * fmaxf(sigma, 0.0F) : 0.0F;
}

/* What the light as measured adds to a thing's error. */
static float measured_of(enum lp_drawn_thing thing, float measured, float screen_slope)
{
	return thing >= LP_DRAWN_GLOSSY ? screen_slope * known(measured) : known(measured);
}

/* What may be left out of a thing. */
static float budget(float tolerance, float measured)
{
	const float rest2 = tolerance * tolerance - measured * measured;

	return fmaxf(sqrtf(fmaxf(rest2, 0.0F)), fminf(tolerance, AS_GOOD * measured));
}

void lp_drawn_shares(const struct lp_drawn_models *models, const struct lp_drawn *tolerance,
		     float measured, bool by_map,
		     float share[LP_MAX_SH_ORDER + 1][LP_MAX_LIGHTS + 1])
{
	for (int l = 0; l <= LP_MAX_SH_ORDER; l++)
		for (int k = 0; k <= LP_MAX_LIGHTS; k++) {
			share[l][k] = 0.0F;
			for (int t = 0; t < LP_DRAWN_BY_MODEL; t++) {
				if (!(tolerance->of[t] > 0.0F) || (t == LP_DRAWN_GLOSSY && by_map))
					continue;
				const float most =
					budget(tolerance->of[t],
					       measured_of(t, measured, models->screen_slope));

				share[l][k] = fmaxf(share[l][k], models->left_out[t][l][k] / most);
			}
		}
}

struct lp_drawn lp_drawn_of_map(const struct lp_drawn_maps *maps, int map_size, float measured)
{
	const int size = map_size < maps->size ? map_size : maps->size;
	const int k = lp_drawn_size_index(size);
	const float glossy = maps->glossy_slope * known(measured);
	const float mirrors = maps->mirror_slope * known(measured);

	if (!size || !isfinite(measured)) /* nothing is promised of light that is not known */
		return (struct lp_drawn){{NAN, NAN, NAN, NAN}};
	return (struct lp_drawn){
		{NAN, NAN, hypotf(maps->glossy[k], glossy), hypotf(maps->mirrors[k], mirrors)}};
}

/* What a map of a known size leaves out, as a share of what it may. */
static float share_of_map(const struct lp_drawn_maps *maps, int size,
			  const struct lp_drawn *tolerance, float measured)
{
	const int k = lp_drawn_size_index(size);
	const float by_light[] = {maps->glossy_slope * known(measured),
				  maps->mirror_slope * known(measured)};
	const float left_out[] = {maps->glossy[k], maps->mirrors[k]};
	float share = 0.0F;

	for (int t = LP_DRAWN_GLOSSY; t <= LP_DRAWN_MIRRORS; t++)
		if (tolerance->of[t] > 0.0F)
			share = fmaxf(share, left_out[t - LP_DRAWN_GLOSSY] /
						     budget(tolerance->of[t],
							    by_light[t - LP_DRAWN_GLOSSY]));
	return share;
}

/* The least size whose share is below `most_share`; where none is, the next one above those known.
 */
static int least_size(const struct lp_drawn_maps *maps, const struct lp_drawn *tolerance,
		      float measured, float most_share, int most)
{
	for (int size = LP_CUBE_LEAST; size <= maps->size && size <= most; size *= 2)
		if (share_of_map(maps, size, tolerance, measured) <= most_share)
			return size;
	return 2 * maps->size < most ? 2 * maps->size : most;
}

int lp_drawn_choose_map(struct lp_drawn_map_choice *choice, const struct lp_drawn_maps *maps,
			const struct lp_drawn *tolerance, float measured, float model_share,
			int most, int64_t t_ns)
{
	const float glossy = tolerance->of[LP_DRAWN_GLOSSY];
	const bool mirrored = tolerance->of[LP_DRAWN_MIRRORS] > 0.0F;
	const bool fits = !mirrored && !(model_share > 1.0F);
	const bool certainly = !mirrored && !(model_share > CERTAINLY_FITS);
	int least, certain;

	if (!most || !(mirrored || glossy > 0.0F)) {
		*choice = (struct lp_drawn_map_choice){.decided = true, .t_ns = t_ns};
		return 0;
	}
	least = fits ? 0 : !maps->size ? most : least_size(maps, tolerance, measured, 1.0F, most);
	certain = certainly	? 0
		  : !maps->size ? most
				: least_size(maps, tolerance, measured, CERTAINLY_FITS, most);
	if (!choice->decided || least > choice->size || choice->size > most) {
		choice->size = least;
		choice->fits_since_ns = 0;
	} else if (certain < choice->size) {
		if (!choice->fits_since_ns)
			choice->fits_since_ns = t_ns;
		if (t_ns - choice->fits_since_ns >= PATIENCE_NS) {
			choice->size = certain;
			choice->fits_since_ns = 0;
		}
	} else {
		choice->fits_since_ns = 0;
	}
	choice->decided = true;
	choice->t_ns = t_ns;
	return choice->size;
}

struct lp_drawn lp_drawn_stated(const float left_out[LP_DRAWN_BY_MODEL], float screen_slope,
				const struct lp_drawn_maps *maps, const struct lp_drawn *tolerance,
				float measured, int map_size)
{
	struct lp_drawn stated = lp_drawn_of_map(maps, map_size, measured);

	for (int t = 0; t < LP_DRAWN_BY_MODEL; t++)
		if (t != LP_DRAWN_GLOSSY || isnan(stated.of[t]))
			stated.of[t] = hypotf(left_out[t], measured_of(t, measured, screen_slope));
	if (isnan(stated.of[LP_DRAWN_MIRRORS]))
		stated.of[LP_DRAWN_MIRRORS] = UNKNOWN;
	for (int t = 0; t < LP_DRAWN_THINGS; t++)
		if (!(tolerance->of[t] > 0.0F) || !isfinite(measured))
			stated.of[t] = NAN;
	return stated;
}
