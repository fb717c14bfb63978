/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/drawn/drawn_list.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "light/send/model.h"
#include "serve/drawn/drawn_light.h"

/* KEY comes or goes when that would have been better for so long. */
#define KEY_PATIENCE_NS LP_NS_PER_S
/* The light is known as well as the best of so many estimates say, those of a round of exposures:
 * one without the shortest exposure says less, and the choice is not to follow it. */
#define ROUND 8
/* What was measured on a finer map holds for so long. */
#define FINER_HOLDS_NS (2 * LP_NS_PER_S)
/* A light whose list holds so much of it is wholly there. */
#define WHOLE 0.999F

/* The present estimate, its lights in the order in which they are listed. */
struct ranked {
	bool known, predicted[2];
	struct lp_light_estimate estimate;
	struct lp_drawn_models models[2]; /* without KEY, with it */
};

struct lp_drawn_room {
	struct lp_drawn_tables *tables;
	struct lp_drawn_maps maps;
	struct ranked ranked[2][2]; /* smoothed or raw, with reflections or without */
	struct lp_light_estimate work;
	float measured[ROUND]; /* of the last estimates */
	uint64_t estimates;    /* how many there have been */
	int64_t t_ns;	       /* of the newest */
};

struct lp_drawn_room *lp_drawn_room_create(void)
{
	struct lp_drawn_room *self = calloc(1, sizeof(*self));

	if (!self)
		return NULL;
	self->tables = lp_drawn_tables_create();
	if (self->tables)
		return self;
	free(self);
	return NULL;
}

void lp_drawn_room_destroy(struct lp_drawn_room *room)
{
	if (!room)
		return;
	lp_drawn_tables_destroy(room->tables);
	free(room);
}

void lp_drawn_room_forget(struct lp_drawn_room *room)
{
	for (int k = 0; k < 4; k++) {
		struct ranked *ranked = &room->ranked[k / 2][k % 2];

		ranked->known = ranked->predicted[0] = ranked->predicted[1] = false;
	}
}

void lp_drawn_room_set_maps(struct lp_drawn_room *room, const struct lp_drawn_maps *maps)
{
	if (maps->size < room->maps.size && maps->t_ns - room->maps.t_ns < FINER_HOLDS_NS)
		return;
	room->maps = *maps;
}

const struct lp_drawn_maps *lp_drawn_room_maps(const struct lp_drawn_room *room)
{
	return &room->maps;
}

bool lp_drawn_wishes_are_same(const struct lp_drawn_wish *a, const struct lp_drawn_wish *b)
{
	if (a->on != b->on || !a->on)
		return a->on == b->on;
	for (int t = 0; t < LP_DRAWN_THINGS; t++)
		if (a->tolerance.of[t] != b->tolerance.of[t])
			return false;
	return a->raw == b->raw && a->key_allowed == b->key_allowed && a->most_map == b->most_map;
}

/* ---------------------------------------------------------------- errors */

static void sort(struct lp_light_estimate *estimate)
{
	for (int k = 1; k < estimate->light_count; k++) {
		const struct lp_light light = estimate->lights[k];
		int at = k;

		for (; at > 0 && lp_light_rank(&estimate->lights[at - 1]) < lp_light_rank(&light);
		     at--)
			estimate->lights[at] = estimate->lights[at - 1];
		estimate->lights[at] = light;
	}
}

/* The order of lights has changed: predicted errors are those of their new order. */
static void predict_again(struct ranked *ranked)
{
	struct lp_light_estimate *e = &ranked->estimate;
	float shadow = 0.0F;

	for (int k = LP_MAX_LIGHTS; k >= 0; k--) {
		if (k < e->light_count)
			shadow += lp_facing_share(e, k);
		for (int l = 0; l <= LP_MAX_SH_ORDER; l++)
			e->predicted_error[l][k] =
				ranked->models[0].left_out[LP_DRAWN_DIFFUSE][l][k] +
				LP_SHADOW_SHARE * shadow;
	}
}

static struct ranked *rank(struct lp_drawn_room *room, const struct lp_light_estimate *estimate,
			   bool raw, bool without_reflections)
{
	struct ranked *ranked = &room->ranked[raw][without_reflections];

	if (ranked->known)
		return ranked;
	if (without_reflections)
		lp_leave_out_reflections(estimate, &ranked->estimate);
	else
		ranked->estimate = *estimate;
	sort(&ranked->estimate);
	lp_drawn_predict(room->tables, &ranked->estimate, false, &ranked->models[0]);
	predict_again(ranked);
	ranked->known = ranked->predicted[0] = true;
	return ranked;
}

static const struct lp_drawn_models *models_of(struct lp_drawn_room *room, struct ranked *ranked,
					       bool key)
{
	if (!ranked->predicted[key])
		lp_drawn_predict(room->tables, &ranked->estimate, key, &ranked->models[key]);
	ranked->predicted[key] = true;
	return &ranked->models[key];
}

/* ---------------------------------------------------------------- decisions */

/* 1 sigma of the light, to decide by. */
static float note_measured(struct lp_drawn_room *room, const struct lp_light_estimate *estimate)
{
	float least = INFINITY;

	if (!room->estimates || room->t_ns != estimate->t_capture_ns)
		room->measured[room->estimates++ % ROUND] = estimate->relighting_sigma;
	room->t_ns = estimate->t_capture_ns;
	for (uint64_t k = 0; k < ROUND && k < room->estimates; k++)
		least = fminf(least, room->measured[k]); /* that number, where one is NAN */
	return isfinite(least) ? fmaxf(least, 0.0F) : 0.0F;
}

static int most_lights(const struct lp_light_estimate *estimate,
		       const struct lp_listing_limits *limits)
{
	return limits->lights < estimate->light_count ? limits->lights : estimate->light_count;
}

/* Bytes of the least model; `*fits`: whether it suffices. */
static int bytes_of(const struct lp_light_estimate *estimate,
		    const struct lp_listing_limits *limits, bool key, bool *fits)
{
	int order, lights;

	lp_model_choose(estimate, limits->sh_order, limits->lights, 1.0F, &order, &lights);
	*fits = estimate->predicted_error[order][lights] <= 1.0F;
	return LP_COEFFICIENT_BYTES * LP_SH_COUNT(order) + LP_LIGHT_BYTES * (lights + key);
}

/* Whether KEY had better be sent. */
static bool choose_key(struct lp_drawn_room *room, struct ranked *ranked,
		       const struct lp_drawn_wish *wish, const struct lp_listing_limits *limits,
		       bool by_map, float measured, struct lp_drawn_state *state)
{
	struct lp_light_estimate *work = &room->work;
	bool fits[2], better;
	int bytes[2];

	if (!wish->key_allowed)
		return false;
	*work = ranked->estimate;
	for (int key = 0; key < 2; key++) {
		lp_drawn_shares(models_of(room, ranked, key), &wish->tolerance, measured, by_map,
				work->predicted_error);
		bytes[key] = bytes_of(work, limits, key, &fits[key]);
	}
	better = fits[1] && (!fits[0] || bytes[1] < bytes[0]);
	if (better == state->key) {
		state->other_since_ns = 0;
		return state->key;
	}
	if (!state->other_since_ns)
		state->other_since_ns = work->t_capture_ns;
	if (state->started && fits[state->key] && !wish->raw &&
	    work->t_capture_ns - state->other_since_ns < KEY_PATIENCE_NS)
		return state->key;
	state->other_since_ns = 0;
	return better;
}

/* Lights that are in the list with all their light. */
static int count_whole(const struct lp_light_estimate *listed,
		       const struct lp_light_estimate *estimate)
{
	int whole = 0;

	for (int k = 0; k < listed->light_count; k++)
		for (int j = 0; j < estimate->light_count; j++)
			whole += listed->lights[k].id == estimate->lights[j].id &&
				 lp_light_rank(&listed->lights[k]) >=
					 WHOLE * lp_light_rank(&estimate->lights[j]);
	return whole;
}

static int list_raw(const struct lp_light_estimate *estimate,
		    const struct lp_listing_limits *limits, struct lp_light_estimate *listed)
{
	int order, lights;

	lp_model_choose(estimate, limits->sh_order, limits->lights, 1.0F, &order, &lights);
	*listed = *estimate;
	listed->light_count = lights;
	if (lights < estimate->light_count - estimate->area_count)
		listed->flags |= LP_ESTIMATE_MORE_LIGHTS;
	return order;
}

void lp_drawn_list(struct lp_drawn_room *room, const struct lp_light_estimate *estimate,
		   const struct lp_drawn_wish *wish, const struct lp_listing_limits *limits,
		   struct lp_drawn_state *state, struct lp_light_estimate *listed,
		   struct lp_drawn_packet *packet)
{
	struct ranked *ranked = rank(room, estimate, wish->raw, limits->leave_out_reflections);
	const float measured = note_measured(room, estimate);
	const struct lp_drawn only_glossy = {.of[LP_DRAWN_GLOSSY] =
						     wish->tolerance.of[LP_DRAWN_GLOSSY]};
	const struct lp_drawn_models *models = &ranked->models[0];
	const int most = most_lights(&ranked->estimate, limits);
	float left_out[LP_DRAWN_BY_MODEL];

	room->work = ranked->estimate;
	lp_drawn_shares(models, &only_glossy, measured, false, room->work.predicted_error);
	packet->map_size = lp_drawn_choose_map(&state->map, &room->maps, &wish->tolerance, measured,
					       room->work.predicted_error[limits->sh_order][most],
					       wish->most_map, estimate->t_capture_ns);
	packet->key = choose_key(room, ranked, wish, limits, packet->map_size > 0, measured, state);
	state->key = packet->key;
	state->started = true;
	models = models_of(room, ranked, packet->key);
	/* The listing chooses by the share of the tolerance instead of an error. */
	room->work = ranked->estimate;
	lp_drawn_shares(models, &wish->tolerance, measured, packet->map_size > 0,
			room->work.predicted_error);
	packet->sh_order =
		wish->raw ? list_raw(&room->work, limits, listed)
			  : lp_listing_update(&state->listing, &room->work, limits, listed);
	const int whole = count_whole(listed, &ranked->estimate);

	memcpy(listed->predicted_error, ranked->estimate.predicted_error,
	       sizeof(listed->predicted_error));
	listed->predicted_error[packet->sh_order][listed->light_count] =
		ranked->estimate.predicted_error[packet->sh_order][whole];
	for (int t = 0; t < LP_DRAWN_BY_MODEL; t++)
		left_out[t] = models->left_out[t][packet->sh_order][whole];
	packet->stated =
		lp_drawn_stated(left_out, models->screen_slope, &room->maps, &wish->tolerance,
				estimate->relighting_sigma, packet->map_size);
}
