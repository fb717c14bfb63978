/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/reflection_maps.h"

#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/pool.h"
#include "estimate/estimates.h"
#include "include/luminance.h"
#include "include/packet.h"
#include "light/send/cube.h"
#include "light/send/model.h"
#include "serve/drawn/drawn_map.h"

#define SIZES 3 /* 16, 32, 64 */
/* Different pictures of one estimate that are remembered, and encoded for each number of a
 * subscription; each further one is made for one client. */
#define VARIANTS 8
/* A client may hold one half sent and the newest one. */
#define MAPS_PER_CLIENT 2

struct map {
	struct lp_packet base;
	struct lp_pool *pool;
	uint8_t bytes[];
};

/* A picture that is composed. */
struct variant {
	bool used;
	struct lp_choice choice;
	struct lp_reflection_header header;
	uint8_t *texels;       /* of the largest size */
	struct map *map;       /* the last one that was encoded of it; NULL: none */
	uint32_t subscription; /* its number */
};

struct lp_reflection_maps {
	struct lp_pool *pool;
	size_t most_bytes;
	struct lp_cube_grid *grids[SIZES];
	struct lp_cube surround, lamps; /* workspace, of the largest size */
	struct variant variants[VARIANTS];
	struct variant single; /* the last one that found no place */
	struct lp_drawn_mirrors *mirrors;
	struct lp_drawn_maps measured; /* the newest surroundings */
};

/* ---------------------------------------------------------------- life */

static bool create_cube(struct lp_cube *cube, int texels)
{
	bool complete = true;

	for (int c = 0; c < 3; c++) {
		cube->rgb[c] = aligned_alloc(16, (size_t)texels * sizeof(float));
		complete = complete && cube->rgb[c];
	}
	return complete;
}

static bool create_variant(struct variant *variant, int texels)
{
	variant->texels = malloc(4 * (size_t)texels);
	return variant->texels;
}

struct lp_reflection_maps *lp_reflection_maps_create(int most_size, int clients)
{
	struct lp_reflection_maps *self = calloc(1, sizeof(*self));
	const int texels = LP_CUBE_TEXELS(most_size);
	bool complete;

	if (!self)
		return NULL;
	self->most_bytes = 4 * (size_t)texels + LP_REFLECTION_HEADER_BYTES;
	self->pool = lp_pool_create(sizeof(struct map) + self->most_bytes,
				    clients * MAPS_PER_CLIENT + VARIANTS + 1, NULL);
	complete = self->pool && create_variant(&self->single, texels);
	for (int k = 0; k < VARIANTS; k++)
		complete = create_variant(&self->variants[k], texels) && complete;
	complete = create_cube(&self->surround, texels) && complete;
	complete = create_cube(&self->lamps, texels) && complete;
	for (int k = 0; k < SIZES && LP_CUBE_LEAST << k <= most_size; k++)
		complete =
			lp_cube_grid_create(LP_CUBE_LEAST << k, &self->grids[k]) == 0 && complete;
	if (complete)
		self->mirrors = lp_drawn_mirrors_create(most_size, self->grids);
	if (!self->mirrors) {
		lp_reflection_maps_destroy(self);
		return NULL;
	}
	return self;
}

void lp_reflection_maps_destroy(struct lp_reflection_maps *maps)
{
	if (!maps)
		return;
	lp_reflection_maps_forget(maps);
	lp_drawn_mirrors_destroy(maps->mirrors);
	for (int k = 0; k < SIZES; k++)
		lp_cube_grid_destroy(maps->grids[k]);
	for (int c = 0; c < 3; c++) {
		free(maps->surround.rgb[c]);
		free(maps->lamps.rgb[c]);
	}
	free(maps->single.texels);
	for (int k = 0; k < VARIANTS; k++)
		free(maps->variants[k].texels);
	if (maps->pool)
		lp_pool_destroy(maps->pool);
	free(maps);
}

static void release_map(struct lp_packet *packet)
{
	struct map *self = (struct map *)packet;

	lp_pool_give(self->pool, self);
}

static void forget(struct variant *variant)
{
	if (variant->map)
		lp_packet_drop(&variant->map->base);
	variant->map = NULL;
	variant->used = false;
}

void lp_reflection_maps_forget(struct lp_reflection_maps *maps)
{
	for (int k = 0; k < VARIANTS; k++)
		forget(&maps->variants[k]);
	forget(&maps->single);
}

/* ---------------------------------------------------------------- light */

/* size: 16, 32 or 64, no more than there is. */
static struct lp_cube_grid *grid_of(const struct lp_reflection_maps *maps, int size)
{
	return maps->grids[size == LP_CUBE_LEAST ? 0 : size < LP_CUBE_MOST ? 1 : 2];
}

static void take_surroundings(struct lp_cube *cube, const struct lp_surroundings *surroundings,
			      const struct lp_cube_grid *finer)
{
	const struct lp_cube from = {.grid = finer,
				     .rgb = {(float *)surroundings->rgb[0],
					     (float *)surroundings->rgb[1],
					     (float *)surroundings->rgb[2]}};

	if (finer->size != cube->grid->size) {
		lp_cube_shrink(&from, cube);
		return;
	}
	for (int c = 0; c < 3; c++)
		memcpy(cube->rgb[c], from.rgb[c], (size_t)finer->texels * sizeof(float));
}

static bool is_kept(const struct lp_surroundings *surroundings, uint32_t id)
{
	for (int k = 0; k < surroundings->kept_count; k++)
		if (surroundings->kept[k] == id)
			return true;
	return false;
}

/* What the packet lists of a light; NULL: nothing. */
static const struct lp_light *listed_of(const struct lp_choice *choice, uint32_t id)
{
	for (int k = 0; k < choice->variant.lights; k++)
		if (choice->listed->lights[k].id == id)
			return &choice->listed->lights[k];
	return NULL;
}

static float luminance_at(const float *r, const float *g, const float *b, int texel)
{
	return LP_LUMINANCE_R * r[texel] + LP_LUMINANCE_G * g[texel] + LP_LUMINANCE_B * b[texel];
}

/* Luminance of the lamps that the surroundings are without, as a map of that size has them. */
static void show_lamps(struct lp_reflection_maps *maps, const struct lp_surroundings *surroundings,
		       const struct lp_light_estimate *estimate, int size, float *luminance)
{
	struct lp_cube *const lamps = &maps->lamps;

	lamps->grid = grid_of(maps, size);
	for (int c = 0; c < 3; c++)
		memset(lamps->rgb[c], 0, (size_t)lamps->grid->texels * sizeof(float));
	for (int k = 0; k < estimate->light_count; k++)
		if (!is_kept(surroundings, estimate->lights[k].id))
			lp_cube_add_light(lamps, &estimate->lights[k],
					  estimate->lights[k].irradiance);
	for (int i = 0; i < lamps->grid->texels; i++)
		luminance[i] = luminance_at(lamps->rgb[0], lamps->rgb[1], lamps->rgb[2], i);
}

const struct lp_drawn_maps *lp_reflection_maps_measure(struct lp_reflection_maps *maps,
						       const struct lp_surroundings *surroundings,
						       const struct lp_light_estimate *estimate)
{
	float *const luminance = lp_drawn_mirrors_luminance(maps->mirrors, surroundings->size);

	for (int i = 0; i < LP_CUBE_TEXELS(surroundings->size); i++)
		luminance[i] = luminance_at(surroundings->rgb[0], surroundings->rgb[1],
					    surroundings->rgb[2], i);
	for (int size = LP_CUBE_LEAST; size <= surroundings->size; size *= 2)
		show_lamps(maps, surroundings, estimate, size,
			   lp_drawn_mirrors_lamps(maps->mirrors, size));
	lp_drawn_measure(maps->mirrors, surroundings->size, &maps->measured);
	maps->measured.t_ns = estimate->t_capture_ns;
	return &maps->measured;
}

/* Each light goes where its light belongs: all of it into TOTAL, into AMBIENT what is not listed.
 */
static void place_lights(struct lp_reflection_maps *maps,
			 const struct lp_surroundings *surroundings, const struct lp_choice *choice,
			 bool total)
{
	for (int k = 0; k < choice->all->light_count; k++) {
		const struct lp_light *light = &choice->all->lights[k];
		const struct lp_light *listed = total ? NULL : listed_of(choice, light->id);
		const float none[3] = {0.0F}, *taken = listed ? listed->irradiance : none;
		float rest[3];

		if (is_kept(surroundings, light->id)) {
			if (listed)
				lp_cube_take_light(&maps->surround, light, taken);
			continue;
		}
		for (int c = 0; c < 3; c++)
			rest[c] = light->irradiance[c] > taken[c] ? light->irradiance[c] - taken[c]
								  : 0.0F;
		lp_cube_add_light(&maps->lamps, light, rest);
	}
}

/* Projection that the map is to have. */
static void wanted_of(const struct lp_choice *choice, bool total, double sh[LP_CUBE_BANDS][3])
{
	float ambient[LP_CUBE_BANDS][3];

	lp_model_ambient(choice->listed, 2, total ? 0 : choice->variant.lights, ambient);
	for (int i = 0; i < LP_CUBE_BANDS; i++)
		for (int c = 0; c < 3; c++)
			sh[i][c] = ambient[i][c];
}

static void compose(struct lp_reflection_maps *maps, const struct lp_surroundings *surroundings,
		    const struct lp_choice *choice, int size, bool total)
{
	struct lp_cube_grid *const grid = grid_of(maps, size);
	double wanted[LP_CUBE_BANDS][3];

	maps->surround.grid = maps->lamps.grid = grid;
	take_surroundings(&maps->surround, surroundings, grid_of(maps, surroundings->size));
	for (int c = 0; c < 3; c++)
		memset(maps->lamps.rgb[c], 0, (size_t)grid->texels * sizeof(float));
	place_lights(maps, surroundings, choice, total);
	wanted_of(choice, total, wanted);
	lp_cube_project(&maps->lamps, -1.0, wanted); /* lamps stay as they are */
	lp_cube_fit(&maps->surround, (const double(*)[3])wanted);
	for (int c = 0; c < 3; c++)
		for (int i = 0; i < grid->texels; i++)
			maps->surround.rgb[c][i] += maps->lamps.rgb[c][i];
}

/* ---------------------------------------------------------------- packets */

/* The picture for one number of a subscription. NULL: logged. */
static struct lp_packet *encode(struct lp_reflection_maps *maps, struct variant *variant,
				const struct lp_stamp *stamp)
{
	struct map *map;

	if (variant->map && variant->subscription == stamp->subscription)
		return &variant->map->base;
	if (variant->map)
		lp_packet_drop(&variant->map->base);
	variant->map = map = lp_pool_take(maps->pool);
	variant->subscription = stamp->subscription;
	if (!map) {
		lp_error("hub", "packet", "out of memory; a reflection map is lost");
		return NULL;
	}
	map->pool = maps->pool;
	map->base = (struct lp_packet){.references = 1,
				       .release = release_map,
				       .data = map->bytes,
				       .capacity_bytes = (uint32_t)maps->most_bytes};
	if (lp_encode_reflection_map(variant->choice.all, &variant->header, variant->texels, stamp,
				     &map->base) == 0)
		return &map->base;
	lp_packet_drop(&map->base);
	variant->map = NULL;
	return NULL;
}

static bool is_same(const struct variant *variant, const struct lp_choice *choice, int size,
		    bool total)
{
	return variant->used && variant->header.size == size && variant->header.total == total &&
	       (total ? variant->choice.all == choice->all
		      : lp_choices_are_same(&variant->choice, choice));
}

/* The picture that is the same as this, or a place for it. */
static struct variant *find(struct lp_reflection_maps *maps, const struct lp_choice *choice,
			    int size, bool total)
{
	struct variant *place = NULL;

	for (int k = 0; k < VARIANTS; k++) {
		struct variant *variant = &maps->variants[k];

		if (is_same(variant, choice, size, total))
			return variant;
		if (!variant->used && !place)
			place = variant;
	}
	if (place)
		return place;
	forget(&maps->single);
	return &maps->single;
}

struct lp_packet *lp_reflection_maps_packet(struct lp_reflection_maps *maps,
					    const struct lp_surroundings *surroundings,
					    const struct lp_choice *choice,
					    const struct lp_reflection_wish *wish,
					    const struct lp_stamp *stamp)
{
	const int size = wish->size < surroundings->size ? wish->size : surroundings->size;
	struct variant *variant = find(maps, choice, size, wish->total);

	if (!variant->used) {
		compose(maps, surroundings, choice, size, wish->total);
		variant->used = true;
		variant->choice = *choice;
		variant->header = (struct lp_reflection_header){.size = size, .total = wish->total};
		variant->header.drawn =
			lp_drawn_of_map(&maps->measured, size, choice->all->relighting_sigma);
		variant->header.scale = lp_cube_encode(&maps->surround, variant->texels);
		if (!(variant->header.scale > 0.0F))
			lp_error("hub", "encode", "a reflection map is not finite; it is not sent");
	}
	return variant->header.scale > 0.0F ? encode(maps, variant, stamp) : NULL;
}
