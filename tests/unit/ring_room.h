/* SPDX-License-Identifier: Apache-2.0 */
/* A room of known light that a simulated ring of light sensors and a camera look at. */
#ifndef LP_TEST_RING_ROOM_H
#define LP_TEST_RING_ROOM_H

#include <math.h>
#include <stdlib.h>

#include "include/luminance.h"
#include "include/panorama.h"
#include "light/clipped/clipped_parts.h"
#include "light/clipped/ring_fusion.h"
#include "light/math/grid.h"
#include "light/math/rotation.h"
#include "lp_test.h"

#define WIDTH 120
#define HEIGHT 60
#define CELLS (WIDTH * HEIGHT)
#define SIGMA 0.03F
#define SCALE 250.0F
#define TRIALS 200

static const struct lp_ring_scale known = {SCALE, 0.02F};
static const struct lp_ring_scale unknown = {NAN, NAN};

/* A room of radiance 1 above and 0.5 below, and clipped discs; what they truly hold is beside. */
struct room {
	struct lp_grid *grid;
	struct lp_panorama seen, truth;
	struct lp_clipped_parts *parts;
	float (*seen_cells)[4], (*true_cells)[4];
	uint8_t *flags;
};

static inline void set(float cell[4], float luminance)
{
	for (int c = 0; c < 4; c++)
		cell[c] = luminance;
}

static inline int set_up(void **state)
{
	struct room *room = calloc(1, sizeof(*room));

	assert_non_null(room);
	assert_int_equal(lp_grid_create(WIDTH, HEIGHT, &room->grid), 0);
	assert_int_equal(lp_clipped_parts_create(room->grid, &room->parts), 0);
	room->seen_cells = calloc(CELLS, sizeof(*room->seen_cells));
	room->true_cells = calloc(CELLS, sizeof(*room->true_cells));
	room->flags = calloc(CELLS, 1);
	for (int i = 0; i < CELLS; i++) {
		set(room->seen_cells[i], i < CELLS / 2 ? 1.0F : 0.5F);
		set(room->true_cells[i], i < CELLS / 2 ? 1.0F : 0.5F);
	}
	room->seen = (struct lp_panorama){.width = WIDTH,
					  .height = HEIGHT,
					  .cells = room->seen_cells,
					  .flags = room->flags};
	room->truth = room->seen;
	room->truth.cells = room->true_cells;
	*state = room;
	return 0;
}

static inline int tear_down(void **state)
{
	struct room *room = *state;

	free(room->flags);
	free(room->true_cells);
	free(room->seen_cells);
	lp_clipped_parts_destroy(room->parts);
	lp_grid_destroy(room->grid);
	free(room);
	return 0;
}

/* A disc that clips at radiance 4, and in truth has `radiance`. */
static inline void add_disc(struct room *room, float azimuth_deg, float elevation_deg,
			    float radius_deg, float radiance)
{
	const float rad = (float)M_PI / 180.0F;
	const float a = azimuth_deg * rad, e = elevation_deg * rad;
	const float centre[3] = {cosf(e) * sinf(a), sinf(e), -cosf(e) * cosf(a)};

	for (int i = 0; i < CELLS; i++) {
		float d[3];

		lp_grid_direction(room->grid, i, d);
		if (d[0] * centre[0] + d[1] * centre[1] + d[2] * centre[2] < cosf(radius_deg * rad))
			continue;
		set(room->seen_cells[i], 4.0F);
		set(room->true_cells[i], radiance);
		room->flags[i] = LP_CELL_CLIPPED;
	}
}

static inline float gauss(unsigned int *seed)
{
	float sum = -6.0F;

	for (int i = 0; i < 12; i++)
		sum += (float)rand_r(seed) / (float)RAND_MAX;
	return sum;
}

/* What a ring with these seats would read, and what the camera sees. */
static inline struct lp_ring_sample look_from_with(struct room *room,
						   const struct lp_rotation *rotation,
						   struct lp_ring_sample sample, float sigma,
						   struct lp_ring_view *view, unsigned int *seed)
{
	struct lp_ring_view truth;

	lp_clipped_parts_clear(room->parts);
	lp_clipped_parts_find(room->parts, &room->seen);
	lp_ring_view_init(&truth, room->grid, &room->truth, room->parts, rotation, &sample,
			  LP_LUMINANCE);
	lp_ring_view_init(view, room->grid, &room->seen, room->parts, rotation, &sample,
			  LP_LUMINANCE);
	view->seen_sigma = 0.01F;
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		sample.illuminance_lux[k] = SCALE * truth.seen[k] * (1.0F + sigma * gauss(seed));
		sample.sigma_relative[k] = sigma;
	}
	return sample;
}

static inline struct lp_ring_sample look_from(struct room *room, const struct lp_rotation *rotation,
					      struct lp_ring_sample sample,
					      struct lp_ring_view *view, unsigned int *seed)
{
	return look_from_with(room, rotation, sample, SIGMA, view, seed);
}

static inline struct lp_ring_sample look_with(struct room *room, const struct lp_rotation *rotation,
					      float sigma, struct lp_ring_view *view,
					      unsigned int *seed)
{
	return look_from_with(room, rotation, (struct lp_ring_sample){0}, sigma, view, seed);
}

static inline struct lp_ring_sample look(struct room *room, const struct lp_rotation *rotation,
					 struct lp_ring_view *view, unsigned int *seed)
{
	return look_from(room, rotation, (struct lp_ring_sample){0}, view, seed);
}

static inline float true_excess(const struct room *room, const struct lp_clipped_part *part)
{
	float sum = 0.0F;

	for (int i = part->first; i < part->first + part->count; i++) {
		const int cell = room->parts->cells[i];

		sum += lp_grid_solid_angle_sr(room->grid, cell) *
		       (room->true_cells[cell][LP_LUMINANCE] -
			room->seen_cells[cell][LP_LUMINANCE]);
	}
	return sum;
}

/* As a ring reads that is turned to the right by so many places of its sensors. */
static inline struct lp_ring_sample turned_by(const struct lp_ring_sample *straight, int places)
{
	struct lp_ring_sample turned = *straight;

	for (int k = 0; k < 8; k++)
		turned.illuminance_lux[k] = straight->illuminance_lux[(k + places + 8) % 8];
	return turned;
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

#endif
