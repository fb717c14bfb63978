/* SPDX-License-Identifier: Apache-2.0 */
#include "light/send/listing.h"

#include <math.h>
#include <string.h>

#include "light/send/model.h"

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "While the camera turns". */

/* How patient the list is, so that lamps which come and go for ever, as in a bright sky, stay in
 * AMBIENT. PATIENCE_S is how long a lamp lasts before it enters, if only its borders are new and
 * not its light; how long the place of a lamp is kept that the estimate has lost; and for how long
 * a lamp outside is OUTSHINES times as strong as one inside before it takes its place, or for an
 * eighth of that if it is twice as strong again (QUICKER is the exponent). A young list, of a map
 * that is still being filled, waits for half of its age only, but not less than LEAST_PATIENCE_S.
 * Each entry of the last UNREST_S or so makes it wait as long again. */
#define OUTSHINES 1.5F
#define QUICKER 3.0F
#define PATIENCE_S 4.0F
#define LEAST_PATIENCE_S 0.5F
#define UNREST_S 30.0F
/* A lamp whose light came with it so short a time ago takes a place that is kept for another, and
 * so does one with this share of all lamps' light. */
#define JUST_LIT_S 2.0F
#define STRONG_SHARE 0.05F
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

static bool is_staying(const struct lp_listed *l)
{
	return l->id && !l->leaves && !l->lost;
}

/* Of those that stay. */
static struct lp_listed *weakest(struct lp_listing *listing,
				 const struct lp_light_estimate *estimate)
{
	struct lp_listed *found = NULL;

	for (int p = 0; p < LP_MAX_LIGHTS; p++) {
		struct lp_listed *l = &listing->place[p];

		if (is_staying(l) && (!found || lp_light_rank(find(estimate, l->id)) <
							lp_light_rank(find(estimate, found->id))))
			found = l;
	}
	return found;
}

static bool is_just_lit(const struct lp_light *light)
{
	return light->lit && light->found_s < JUST_LIT_S;
}

/* Of all lamps' light. */
static float share_of(const struct lp_light *light, const struct lp_light_estimate *estimate)
{
	float all = 0.0F;

	for (int k = 0; k < estimate->light_count; k++)
		all += lp_light_rank(&estimate->lights[k]);
	return lp_light_rank(light) / all;
}

/* all: for a place that is free; else only those that take a place which is kept for another. */
static const struct lp_light *strongest_outside(struct lp_listing *listing,
						const struct lp_light_estimate *estimate, bool all)
{
	const struct lp_light *found = NULL;

	for (int k = 0; k < estimate->light_count; k++) {
		const struct lp_light *light = &estimate->lights[k];

		if (!place_of(listing, light->id) &&
		    (all || is_just_lit(light) || share_of(light, estimate) > STRONG_SHARE) &&
		    (!found || lp_light_rank(light) > lp_light_rank(found)))
			found = light;
	}
	return found;
}

static float patience_s(const struct lp_listing *listing)
{
	return fmaxf(fminf(PATIENCE_S, 0.5F * listing->age_s), LEAST_PATIENCE_S) *
	       (1.0F + listing->unrest);
}

static void enter(struct lp_listing *listing, const struct lp_light *light)
{
	struct lp_listed *free = place_of(listing, 0);

	if (free)
		*free = (struct lp_listed){.id = light->id,
					   .share = listing->started ? 0.0F : 1.0F};
	if (free && listing->started && !is_just_lit(light))
		listing->unrest += 1.0F;
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
 * the next one the next weakest, all at the same time. For each place that becomes free, or is kept
 * for a lamp that has faded, one of the strongest outside waits without sending anyone off. */
static void challenge(struct lp_listing *listing, const struct lp_light_estimate *estimate,
		      const struct lp_light_estimate *candidates, float elapsed_s)
{
	const struct lp_light *outside[LP_MAX_LIGHTS], *inside[LP_MAX_LIGHTS];
	struct lp_challenger challengers[LP_MAX_LIGHTS] = {0};
	int outside_count = 0, inside_count = 0;

	for (int k = 0; k < candidates->light_count; k++)
		if (!place_of(listing, candidates->lights[k].id))
			insert_by_rank(outside, outside_count++, &candidates->lights[k]);
	for (int p = 0; p < LP_MAX_LIGHTS; p++) {
		const struct lp_light *light = find(estimate, listing->place[p].id);

		if (is_staying(&listing->place[p]) && !(light->flags & LP_LIGHT_HELD))
			insert_by_rank(inside, inside_count++, light);
	}
	for (int k = listing->lights - inside_count; k < outside_count && inside_count > 0; k++) {
		const struct lp_light *last = inside[--inside_count];
		const float stronger =
			lp_light_rank(outside[k]) / (OUTSHINES * lp_light_rank(last));

		if (!(stronger >= 1.0F))
			break;
		const float seconds =
			challenged_s(listing, outside[k]->id) + elapsed_s * powf(stronger, QUICKER);

		if (seconds > patience_s(listing))
			place_of(listing, last->id)->leaves = true;
		else
			challengers[k] = (struct lp_challenger){outside[k]->id, seconds};
	}
	memcpy(listing->challengers, challengers, sizeof(challengers));
}

/* A place that is kept for a lamp that the estimate has lost; NULL: none. */
static struct lp_listed *kept_place(struct lp_listing *listing)
{
	for (int p = 0; p < LP_MAX_LIGHTS; p++)
		if (listing->place[p].lost)
			return &listing->place[p];
	return NULL;
}

/* A lamp that the estimate has lost has faded already. */
static void note_lost(struct lp_listing *listing, const struct lp_light_estimate *estimate,
		      float elapsed_s)
{
	for (int p = 0; p < LP_MAX_LIGHTS; p++) {
		struct lp_listed *l = &listing->place[p];

		l->lost = l->id && !find(estimate, l->id);
		if (!l->lost) {
			l->lost_s = 0.0F;
			continue;
		}
		l->share = 0.0F;
		l->lost_s += elapsed_s;
		if (l->leaves || l->lost_s > patience_s(listing))
			*l = (struct lp_listed){0};
	}
}

/* The place of a lost lamp first, then that of the weakest. */
static void send_off(struct lp_listing *listing, const struct lp_light_estimate *estimate)
{
	struct lp_listed *kept = kept_place(listing);

	if (kept)
		*kept = (struct lp_listed){0};
	else
		weakest(listing, estimate)->leaves = true;
}

/* candidates: the lights of the estimate that may enter. */
static void update_places(struct lp_listing *listing, const struct lp_light_estimate *estimate,
			  const struct lp_light_estimate *candidates, float elapsed_s)
{
	const struct lp_light *next;
	struct lp_listed *kept;

	note_lost(listing, estimate, elapsed_s);
	for (int extra = count_listed(listing, true) - listing->lights; extra > 0; extra--)
		send_off(listing, estimate);
	while (count_listed(listing, false) < listing->lights &&
	       (next = strongest_outside(listing, candidates, true)) != NULL)
		enter(listing, next);
	while ((kept = kept_place(listing)) != NULL &&
	       (next = strongest_outside(listing, candidates, false)) != NULL) {
		*kept = (struct lp_listed){0};
		enter(listing, next);
	}
	if (count_listed(listing, false) == listing->lights)
		challenge(listing, estimate, candidates, elapsed_s);
	for (int p = 0; p < LP_MAX_LIGHTS; p++) {
		struct lp_listed *l = &listing->place[p];
		const float step = elapsed_s / LP_LISTING_FADE_S;

		if (l->lost)
			continue;
		l->share = fminf(l->share + (l->leaves ? -step : step), 1.0F);
		if (l->id && l->leaves && l->share <= 0.0F)
			*l = (struct lp_listed){0};
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

/* The lights that may enter, or stay. A new list starts with all that there is. */
static void find_candidates(struct lp_listing *listing, const struct lp_light_estimate *estimate,
			    const struct lp_listing_limits *limits,
			    struct lp_light_estimate *candidates)
{
	bool out[LP_MAX_LIGHTS];

	for (int k = 0; k < estimate->light_count; k++) {
		const struct lp_light *light = &estimate->lights[k];
		const bool waits = listing->started && !place_of(listing, light->id) &&
				   !light->lit && light->found_s < patience_s(listing);

		out[k] = waits || (limits->leave_out_reflections && is_reflection(light));
	}
	leave_out(estimate, out, candidates);
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
	if (limits->leave_out_reflections)
		send_off_reflections(listing, estimate);
	find_candidates(listing, estimate, limits, &candidates);
	choose_model(listing, &candidates, limits, elapsed_s);
	update_places(listing, estimate, &candidates, elapsed_s);
	listing->started = true;
	listing->age_s += elapsed_s;
	listing->unrest *= expf(-elapsed_s / UNREST_S);
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
