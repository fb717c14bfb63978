/* SPDX-License-Identifier: Apache-2.0 */
/* Whether an estimate says anything that the one which a client was sent last does not. */
#include <float.h>
#include <math.h>

#include "base/clock.h"
#include "include/luminance.h"
#include "light/send/model.h"
#include "serve/hub_state.h"

#define DEG (180.0F / (float)M_PI)
/* What nobody sees: a step of an 8-bit picture, of the mean irradiance. */
#define LEAST_TOLERANCE 0.004F
/* A probe that has gone so far is elsewhere. */
#define MOST_WAY_M 0.005F
/* What is stated of an error may grow by so much, and by the tolerance, before it is news; that it
 * shrinks is none. */
#define MORE_ERROR 1.25F

static bool is_apart(float a, float b, float most)
{
	if (isnan(a) || isnan(b))
		return isnan(a) != isnan(b);
	return fabsf(a - b) > most;
}

static float stated_error(const struct lp_hub_sent *sent)
{
	return hypotf(sent->estimate.relighting_sigma,
		      sent->estimate.predicted_error[sent->variant.sh_order][sent->variant.lights]);
}

/* A sigma that is not known any more, or that has grown. */
static bool has_grown(float before, float now, float most)
{
	return isnan(before) != isnan(now) || (now > MORE_ERROR * before && now - before > most);
}

/* Where a lamp's light falls has changed by a share of the mean irradiance: in strength, colour or
 * direction. */
static bool light_differs(const struct lp_light *a, const struct lp_light *b, float most,
			  float most_error)
{
	const float share = most_error / fmaxf(lp_luminance(b->irradiance), FLT_MIN);

	if (a->id != b->id || a->flags != b->flags)
		return true;
	for (int c = 0; c < 3; c++) {
		float apart2 = 0.0F;

		for (int k = 0; k < 3; k++) {
			const float apart = a->irradiance[c] * a->direction[k] -
					    b->irradiance[c] * b->direction[k];

			apart2 += apart * apart;
		}
		if (!(apart2 <= most * most))
			return true;
	}
	return is_apart(a->distance_m, b->distance_m,
			a->distance_m * fmaxf(a->distance_sigma, LEAST_TOLERANCE)) ||
	       has_grown(a->irradiance_sigma, b->irradiance_sigma, share) ||
	       has_grown(a->direction_sigma_deg, b->direction_sigma_deg, share * DEG);
}

static bool same_variants(const struct lp_variant *a, const struct lp_variant *b)
{
	return a->total == b->total && a->key == b->key && a->sh_order == b->sh_order &&
	       a->lights == b->lights && a->world == b->world;
}

/* The frame in which it is sent, and what is known in it. */
static bool poses_differ(const struct lp_hub_sent *a, const struct lp_hub_sent *b)
{
	const struct lp_estimate_orientation *o = &a->estimate.orientation,
					     *p = &b->estimate.orientation;
	float cosine = 0.0F; /* of half the turn from one to the other */

	if (o->known != p->known || o->world != p->world || o->left_out != p->left_out ||
	    o->has_position != p->has_position || o->places_left_out != p->places_left_out ||
	    a->estimate.room.known != b->estimate.room.known)
		return true;
	for (int k = 0; k < 4; k++)
		cosine += o->xyzw[k] * p->xyzw[k];
	for (int k = 0; k < 3; k++)
		if (o->has_position && is_apart(o->position_m[k], p->position_m[k], MOST_WAY_M))
			return true;
	return o->known && fabsf(cosine) < cosf(LEAST_TOLERANCE / 2.0F);
}

static bool says_the_same(const struct lp_hub_sent *then, const struct lp_hub_sent *now,
			  float tolerance)
{
	const struct lp_light_estimate *a = &then->estimate, *b = &now->estimate;
	const float mean = (float)lp_model_mean_irradiance(b), most = tolerance * mean;
	const float before = stated_error(then), error = stated_error(now);

	if (then->number != now->number || !same_variants(&then->variant, &now->variant) ||
	    a->flags != b->flags || poses_differ(then, now))
		return false;
	if (!(lp_model_distance(b, a) <= tolerance) || has_grown(before, error, tolerance) ||
	    is_apart(a->cd_m2_per_unit, b->cd_m2_per_unit, tolerance * a->cd_m2_per_unit))
		return false;
	for (int c = 0; c < 3; c++) /* a colour that changes, and not the luminance */
		if (is_apart(a->sh_total[0][c], b->sh_total[0][c],
			     tolerance * lp_luminance(b->sh_total[0])))
			return false;
	/* a lamp's sigma comes and goes with the exposures: what is stated of all light bounds it
	 */
	const float most_error = fmaxf(most, (MORE_ERROR - 1.0F) * before * mean);

	for (int k = 0; k < now->variant.lights; k++)
		if (light_differs(&a->lights[k], &b->lights[k], most, most_error))
			return false;
	return true;
}

static struct lp_hub_sent present(struct lp_hub *hub, const struct lp_subscription *wanted)
{
	const struct lp_choice choice =
		lp_packets_choose(hub->packets, &hub->last, &hub->last_computed, wanted);

	return (struct lp_hub_sent){.t_ns = lp_clock_ns(),
				    .number = wanted->number,
				    .variant = choice.variant,
				    .estimate = *choice.listed};
}

bool lp_hub_has_no_news(struct lp_hub *hub, const struct lp_hub_client *client,
			const struct lp_subscription *wanted, int64_t now_ns)
{
	const struct lp_hub_sent *then = &client->sent;

	if (!wanted->quiet_ms || !then->t_ns ||
	    now_ns - then->t_ns >= wanted->quiet_ms * LP_NS_PER_MS)
		return false;
	const struct lp_hub_sent now = present(hub, wanted);

	return says_the_same(then, &now, fmaxf(wanted->tolerance, LEAST_TOLERANCE));
}

void lp_hub_note_sent(struct lp_hub *hub, struct lp_hub_client *client,
		      const struct lp_subscription *wanted)
{
	if (wanted->quiet_ms)
		client->sent = present(hub, wanted);
}
