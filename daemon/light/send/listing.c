/* SPDX-License-Identifier: Apache-2.0 */
#include "light/send/listing.h"

#include <math.h>
#include <string.h>

#include "light/send/model.h"

/* A change of the list (one lamp that enters or leaves) costs as much as to leave out this much
 * light: share of all light times seconds. */
#define COST_OF_CHANGE_S 0.01F
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

/* 0: the estimate has lost it. */
static float rank_of(const struct lp_listed *listed, const struct lp_light_estimate *estimate)
{
	const struct lp_light *light = find(estimate, listed->id);

	return light ? lp_light_rank(light) : 0.0F;
}

/* Of those that stay; NULL: there is none. */
static struct lp_listed *weakest(struct lp_listing *listing,
				 const struct lp_light_estimate *estimate)
{
	struct lp_listed *found = NULL;

	for (int p = 0; p < LP_MAX_LIGHTS; p++) {
		struct lp_listed *l = &listing->place[p];

		if (l->id && !l->leaves &&
		    (!found || rank_of(l, estimate) < rank_of(found, estimate)))
			found = l;
	}
	return found;
}

/* What is lost has faded already. */
static void send_off(struct lp_listed *listed, const struct lp_light_estimate *estimate)
{
	listed->leaves = true;
	if (!find(estimate, listed->id))
		*listed = (struct lp_listed){0};
}

/* A new list begins with all that there is. */
static void enter(struct lp_listing *listing, uint32_t id)
{
	struct lp_listed *free = place_of(listing, 0);

	if (free)
		*free = (struct lp_listed){.id = id, .share = listing->started ? 0.0F : 1.0F};
}

/* What it has cost so far that a lamp is outside. */
static float cost_of(const struct lp_listing *listing, uint32_t id)
{
	for (int k = 0; k < LP_MAX_LIGHTS; k++)
		if (listing->outside[k].id == id)
			return listing->outside[k].cost_s;
	return 0.0F;
}

/*
 * A lamp outside that is stronger than what it would replace costs the difference, as a share of
 * all light, for as long as that lasts. It replaces it once that is as much as the change costs:
 * with what is to come unknown, the sum is never more than twice the least (the ski-rental problem;
 * Karlin et al. 1988). A lamp that the estimate has lost keeps its place in the same way: it may
 * come back. The strongest outside stands against the weakest inside, the next one against the next
 * weakest, all at the same time.
 */
static void weigh(struct lp_listing *listing, const struct lp_light_estimate *estimate,
		  const struct lp_outside *outside, int count, float elapsed_s)
{
	const float all = 4.0F * (float)lp_model_mean_irradiance(estimate);
	const int soon_free = listing->lights - count_listed(listing, true);
	struct lp_outside costs[LP_MAX_LIGHTS] = {0};
	struct lp_listing rest = *listing; /* of those, the weakest goes first */

	for (int k = 0; k < count; k++) {
		struct lp_listed *last = k < soon_free ? NULL : weakest(&rest, estimate);
		const bool is_lost = last && !find(estimate, last->id);

		if (k >= soon_free && !last)
			break;
		const float lost = outside[k].rank - (last ? rank_of(last, estimate) : 0.0F);

		if (!(lost > 0.0F))
			break;
		costs[k] = outside[k];
		costs[k].cost_s = cost_of(listing, outside[k].id) + lost / all * elapsed_s;
		if (last && costs[k].cost_s >= (is_lost ? 1.0F : 2.0F) * COST_OF_CHANGE_S)
			send_off(place_of(listing, last->id), estimate);
		if (last)
			last->leaves = true;
	}
	memcpy(listing->outside, costs, sizeof(costs));
}

/* Candidates that are not in the list, strongest first; returns how many. */
static int find_outside(struct lp_listing *listing, const struct lp_light_estimate *candidates,
			struct lp_outside outside[LP_MAX_LIGHTS])
{
	int count = 0;

	for (int k = 0; k < candidates->light_count; k++) {
		const struct lp_light *light = &candidates->lights[k];
		const float rank = lp_light_rank(light);
		int at = count;

		if (place_of(listing, light->id))
			continue;
		for (; at > 0 && outside[at - 1].rank < rank; at--)
			outside[at] = outside[at - 1];
		outside[at] = (struct lp_outside){.id = light->id, .rank = rank};
		count++;
	}
	return count;
}

/* candidates: the lights of the estimate that may enter. */
static void update_places(struct lp_listing *listing, const struct lp_light_estimate *estimate,
			  const struct lp_light_estimate *candidates, float elapsed_s)
{
	const float step = elapsed_s / LP_LISTING_FADE_S;
	struct lp_outside outside[LP_MAX_LIGHTS];
	const int count = find_outside(listing, candidates, outside);

	for (int p = 0; p < LP_MAX_LIGHTS; p++) {
		struct lp_listed *l = &listing->place[p];

		if (!find(estimate, l->id))
			l->share = 0.0F;
		if (l->leaves && l->share <= 0.0F)
			*l = (struct lp_listed){0};
	}
	for (int extra = count_listed(listing, true) - listing->lights; extra > 0; extra--)
		send_off(weakest(listing, estimate), estimate);
	weigh(listing, estimate, outside, count, elapsed_s);
	for (int k = 0; k < count && count_listed(listing, false) < listing->lights; k++)
		enter(listing, outside[k].id);
	for (int p = 0; p < LP_MAX_LIGHTS; p++) {
		struct lp_listed *l = &listing->place[p];

		if (find(estimate, l->id))
			l->share = fmaxf(fminf(l->share + (l->leaves ? -step : step), 1.0F), 0.0F);
	}
}

static void leave_out(const struct lp_light_estimate *estimate, const bool out[LP_MAX_LIGHTS],
		      struct lp_light_estimate *others)
{
	int before = estimate->light_count; /* the first one left out */

	*others = *estimate;
	others->light_count = 0;
	for (int k = 0; k < estimate->light_count; k++) {
		if (!out[k])
			others->lights[others->light_count++] = estimate->lights[k];
		else if (before > k)
			before = k;
		if (out[k] && k >= estimate->light_count - estimate->area_count)
			others->area_count--;
	}
	for (int order = 0; order <= LP_MAX_SH_ORDER; order++)
		for (int k = before + 1; k <= LP_MAX_LIGHTS; k++)
			others->predicted_error[order][k] = others->predicted_error[order][before];
	if (others->light_count < estimate->light_count)
		others->flags |= LP_ESTIMATE_MORE_LIGHTS;
}

void lp_leave_out_reflections(const struct lp_light_estimate *estimate,
			      struct lp_light_estimate *others)
{
	bool out[LP_MAX_LIGHTS];

	for (int k = 0; k < estimate->light_count; k++)
		out[k] = is_reflection(&estimate->lights[k]);
	leave_out(estimate, out, others);
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
	struct lp_light_estimate candidates;
	int whole = 0;

	if (!limits->areas)
		allowed.light_count -= all->area_count;
	candidates = allowed;
	if (limits->leave_out_reflections) {
		send_off_reflections(listing, estimate);
		lp_leave_out_reflections(estimate, &candidates);
	}
	choose_model(listing, &candidates, limits, elapsed_s);
	update_places(listing, estimate, &candidates, elapsed_s);
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
		candidates.predicted_error[listing->sh_order][whole];
	return listing->sh_order;
}
