/* SPDX-License-Identifier: Apache-2.0 */
#include "light/listing.h"

#include <math.h>
#include <string.h>

#include "light/model.h"

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "While the camera turns". */

/* A lamp outside the list takes the place of one inside when it has been so many times as strong
 * for so long. */
#define OUTSHINES 1.5F
#define PATIENCE_S 0.5F
/* A model stays while its error is below this much of the tolerance; another one takes its place
 * when it would have been better for so long. */
#define STILL_FITS 1.15F
#define MODEL_PATIENCE_S 1.0F

static bool is_reflection(const struct lp_light *light)
{
	return light->flags & LP_LIGHT_REFLECTION;
}

static const struct lp_light *find(const struct lp_light_estimate *estimate, uint32_t id)
{
	for (int k = 0; k < estimate->light_count; k++)
		if (estimate->lights[k].id == id)
			return &estimate->lights[k];
	return NULL;
}

static struct lp_listed *place_of(struct lp_listing *listing, uint32_t id)
{
	for (int p = 0; p < LP_MAX_LIGHTS; p++)
		if (listing->place[p].id == id)
			return &listing->place[p];
	return NULL;
}

/* The model in force changes at once when it no longer does, and after a while when a smaller one
 * would do. */
static void choose_model(struct lp_listing *listing, const struct lp_light_estimate *estimate,
			 const struct lp_listing_limits *limits, float elapsed_s)
{
	int order, lights;

	lp_model_choose(estimate, limits->sh_order, limits->lights, limits->tolerance, &order,
			&lights);
	if (!(limits->tolerance > 0.0F)) /* places stay open for lamps to come */
		lights = limits->lights;
	if (order == listing->sh_order && lights == listing->lights) {
		listing->unfit_s = 0.0F;
		return;
	}
	const int used =
		listing->lights < estimate->light_count ? listing->lights : estimate->light_count;
	const float error = estimate->predicted_error[listing->sh_order][used];
	const bool allowed =
		listing->sh_order <= limits->sh_order && listing->lights <= limits->lights;
	const bool fits =
		allowed && limits->tolerance > 0.0F && error <= STILL_FITS * limits->tolerance;

	listing->unfit_s += elapsed_s;
	if (listing->started && fits && listing->unfit_s < MODEL_PATIENCE_S)
		return;
	listing->sh_order = order;
	listing->lights = lights;
	listing->unfit_s = 0.0F;
}

static int count_listed(const struct lp_listing *listing, bool staying)
{
	int count = 0;

	for (int p = 0; p < LP_MAX_LIGHTS; p++)
		count += listing->place[p].id && !(staying && listing->place[p].leaves);
	return count;
}

/* Of those that stay. */
static struct lp_listed *weakest(struct lp_listing *listing,
				 const struct lp_light_estimate *estimate)
{
	struct lp_listed *found = NULL;

	for (int p = 0; p < LP_MAX_LIGHTS; p++) {
		struct lp_listed *l = &listing->place[p];

		if (l->id && !l->leaves &&
		    (!found || lp_light_rank(find(estimate, l->id)) <
				       lp_light_rank(find(estimate, found->id))))
			found = l;
	}
	return found;
}

static const struct lp_light *strongest_outside(struct lp_listing *listing,
						const struct lp_light_estimate *estimate)
{
	const struct lp_light *found = NULL;

	for (int k = 0; k < estimate->light_count; k++) {
		const struct lp_light *light = &estimate->lights[k];

		if (!place_of(listing, light->id) &&
		    (!found || lp_light_rank(light) > lp_light_rank(found)))
			found = light;
	}
	return found;
}

static void enter(struct lp_listing *listing, uint32_t id, float share)
{
	struct lp_listed *free = place_of(listing, 0);

	if (free)
		*free = (struct lp_listed){.id = id, .share = share};
}

/* Into a list of `count`, strongest first. */
static void insert_by_rank(const struct lp_light *list[], int count, const struct lp_light *light)
{
	for (; count > 0 && lp_light_rank(list[count - 1]) < lp_light_rank(light); count--)
		list[count] = list[count - 1];
	list[count] = light;
}

/* For how long a lamp has outshone another. */
static float challenged_s(const struct lp_listing *listing, uint32_t id)
{
	for (int k = 0; k < LP_MAX_LIGHTS; k++)
		if (listing->challengers[k].id == id)
			return listing->challengers[k].seconds;
	return 0.0F;
}

/* Lamps outside that have been stronger for long enough send others off: the strongest the weakest,
 * the next one the next weakest, all at the same time. Where places are becoming free already, so
 * many of the strongest outside need not wait. */
static void challenge(struct lp_listing *listing, const struct lp_light_estimate *estimate,
		      const struct lp_light_estimate *candidates, float elapsed_s)
{
	const struct lp_light *outside[LP_MAX_LIGHTS], *inside[LP_MAX_LIGHTS];
	struct lp_challenger challengers[LP_MAX_LIGHTS] = {0};
	int outside_count = 0, inside_count = 0;

	for (int k = 0; k < candidates->light_count; k++)
		if (!place_of(listing, candidates->lights[k].id))
			insert_by_rank(outside, outside_count++, &candidates->lights[k]);
	for (int p = 0; p < LP_MAX_LIGHTS; p++)
		if (listing->place[p].id && !listing->place[p].leaves)
			insert_by_rank(inside, inside_count++,
				       find(estimate, listing->place[p].id));
	for (int k = listing->lights - inside_count; k < outside_count && inside_count > 0; k++) {
		const struct lp_light *last = inside[--inside_count];
		const float seconds = challenged_s(listing, outside[k]->id) + elapsed_s;

		if (lp_light_rank(outside[k]) < OUTSHINES * lp_light_rank(last))
			break;
		if (seconds > PATIENCE_S)
			place_of(listing, last->id)->leaves = true;
		else
			challengers[k] = (struct lp_challenger){outside[k]->id, seconds};
	}
	memcpy(listing->challengers, challengers, sizeof(challengers));
}

/* candidates: the lights of the estimate that may enter. */
static void update_places(struct lp_listing *listing, const struct lp_light_estimate *estimate,
			  const struct lp_light_estimate *candidates, float elapsed_s)
{
	const struct lp_light *next;

	for (int p = 0; p < LP_MAX_LIGHTS; p++) /* a lamp that is gone has faded already */
		if (listing->place[p].id && !find(estimate, listing->place[p].id))
			listing->place[p] = (struct lp_listed){0};
	for (int extra = count_listed(listing, true) - listing->lights; extra > 0; extra--)
		weakest(listing, estimate)->leaves = true;
	while (count_listed(listing, false) < listing->lights &&
	       (next = strongest_outside(listing, candidates)) != NULL)
		enter(listing, next->id, listing->started ? 0.0F : 1.0F);
	if (count_listed(listing, false) == listing->lights)
		challenge(listing, estimate, candidates, elapsed_s);
	for (int p = 0; p < LP_MAX_LIGHTS; p++) {
		struct lp_listed *l = &listing->place[p];
		const float step = elapsed_s / LP_LISTING_FADE_S;

		l->share = fminf(l->share + (l->leaves ? -step : step), 1.0F);
		if (l->id && l->leaves && l->share <= 0.0F)
			*l = (struct lp_listed){0};
	}
}

void lp_leave_out_reflections(const struct lp_light_estimate *estimate,
			      struct lp_light_estimate *others)
{
	int before = estimate->light_count; /* the first one left out */

	*others = *estimate;
	others->light_count = 0;
	for (int k = 0; k < estimate->light_count; k++) {
		if (!is_reflection(&estimate->lights[k]))
			others->lights[others->light_count++] = estimate->lights[k];
		else if (before > k)
			before = k;
		if (is_reflection(&estimate->lights[k]) &&
		    k >= estimate->light_count - estimate->area_count)
			others->area_count--;
	}
	for (int order = 0; order <= LP_MAX_SH_ORDER; order++)
		for (int k = before + 1; k <= LP_MAX_LIGHTS; k++)
			others->predicted_error[order][k] = others->predicted_error[order][before];
	if (others->light_count < estimate->light_count)
		others->flags |= LP_ESTIMATE_MORE_LIGHTS;
}

/* Reflections fade from a list that is to be without them. */
static void send_off_reflections(struct lp_listing *listing,
				 const struct lp_light_estimate *estimate)
{
	for (int k = 0; k < estimate->light_count; k++) {
		struct lp_listed *l = place_of(listing, estimate->lights[k].id);

		if (l && is_reflection(&estimate->lights[k]))
			l->leaves = true;
	}
}

int lp_listing_update(struct lp_listing *listing, const struct lp_light_estimate *all,
		      const struct lp_listing_limits *limits, struct lp_light_estimate *listed)
{
	struct lp_light_estimate allowed = *all;
	const struct lp_light_estimate *estimate = &allowed;
	const int64_t elapsed_ns = listing->started ? all->t_capture_ns - listing->t_ns : 0;
	const float elapsed_s = elapsed_ns > 0 ? (float)elapsed_ns / 1e9F : 0.0F;
	struct lp_light_estimate others;
	const struct lp_light_estimate *candidates = estimate;
	int whole = 0;

	if (!limits->areas)
		allowed.light_count -= all->area_count;
	if (limits->leave_out_reflections) {
		lp_leave_out_reflections(estimate, &others);
		send_off_reflections(listing, estimate);
		candidates = &others;
	}
	choose_model(listing, candidates, limits, elapsed_s);
	update_places(listing, estimate, candidates, elapsed_s);
	listing->started = true;
	listing->t_ns = estimate->t_capture_ns;

	*listed = *estimate;
	listed->light_count = 0;
	for (int k = 0; k < estimate->light_count; k++) {
		const struct lp_listed *l = place_of(listing, estimate->lights[k].id);
		struct lp_light light = estimate->lights[k];
		int at = listed->light_count;

		if (!l || !(l->share > 0.0F))
			continue;
		whole += l->share >= 1.0F;
		for (int c = 0; c < 3; c++)
			light.irradiance[c] *= l->share;
		for (; at > 0 && lp_light_rank(&listed->lights[at - 1]) < lp_light_rank(&light);
		     at--)
			listed->lights[at] = listed->lights[at - 1];
		listed->lights[at] = light;
		listed->light_count++;
	}
	if (listed->light_count < all->light_count - all->area_count)
		listed->flags |= LP_ESTIMATE_MORE_LIGHTS;
	listed->predicted_error[listing->sh_order][listed->light_count] =
		candidates->predicted_error[listing->sh_order][whole];
	return listing->sh_order;
}
