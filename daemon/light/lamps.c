/* SPDX-License-Identifier: Apache-2.0 */
#include "light/lamps.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "include/light_estimate.h"
#include "include/panorama.h"
#include "light/grid.h"
#include "light/regions.h"
#include "light/select.h"
#include "light/symmetric3.h"

#define LUMINANCE 3
#define RIM_FACTOR 4.0	     /* most flux of a lamp over that of its core alone */
#define RING_CELLS 2	     /* width of the ring that gives the background */
#define MAX_RING_CELLS 128   /* of it, taken evenly: enough for a median */
#define MAD_TO_SIGMA 1.4826F /* median absolute deviation of a normal distribution */

enum mark {
	FREE,
	CORE, /* of some region */
	RIM,  /* around a core, taken by its lamp */
	RING, /* being looked at for the background; free again afterwards */
};

int lp_lamp_finder_create(const struct lp_grid *grid, struct lp_lamp_finder **finder)
{
	const size_t n = (size_t)grid->width * grid->height;
	struct lp_lamp_finder *f = calloc(1, sizeof(*f));

	if (!f)
		return -ENOMEM;
	f->grid = grid;
	f->cells = calloc(n, sizeof(*f->cells));
	f->touched = calloc(n, sizeof(*f->touched));
	f->mark = calloc(n, sizeof(*f->mark));
	f->ring = calloc(n, sizeof(*f->ring));
	f->values = calloc(MAX_RING_CELLS, sizeof(*f->values));
	f->reach = calloc(grid->height, sizeof(*f->reach));
	if (!f->reach || !f->cells || !f->touched || !f->mark || !f->ring || !f->values) {
		lp_lamp_finder_destroy(f);
		return -ENOMEM;
	}
	for (int r = 0; r < grid->height; r++) {
		const int reach = (int)lroundf(1.0F / grid->row_sin[r]);

		f->reach[r] = reach < grid->width / 2 ? reach : grid->width / 2;
	}
	*finder = f;
	return 0;
}

void lp_lamp_finder_destroy(struct lp_lamp_finder *finder)
{
	if (!finder)
		return;
	free(finder->reach);
	free(finder->values);
	free(finder->ring);
	free(finder->mark);
	free(finder->touched);
	free(finder->cells);
	free(finder);
}

static void take(struct lp_lamp_finder *finder, int32_t cell, enum mark mark)
{
	if (finder->mark[cell] == FREE)
		finder->touched[finder->touched_count++] = cell;
	finder->mark[cell] = (uint8_t)mark;
}

static void start_run(struct lp_lamp_finder *finder, const struct lp_regions *regions)
{
	for (int i = 0; i < finder->touched_count; i++)
		finder->mark[finder->touched[i]] = FREE;
	finder->touched_count = 0;
	finder->cell_count = 0;
	finder->count = 0;
	for (int k = 0; k < regions->count; k++)
		for (int i = 0; i < regions->list[k].count; i++)
			take(finder, regions->cells[regions->list[k].first + i], CORE);
}

static int take_free(struct lp_lamp_finder *finder, int32_t cell, enum mark mark, int32_t *out,
		     int count)
{
	if (finder->mark[cell] != FREE)
		return count;
	take(finder, cell, mark);
	out[count] = cell;
	return count + 1;
}

/* A row at the seam, or beyond a pole: there the grid goes on half a turn away. */
static int grow_around(struct lp_lamp_finder *finder, int row, int column, enum mark mark,
		       int32_t *out)
{
	const struct lp_grid *grid = finder->grid;
	int count = 0;

	for (int r = row - 1; r <= row + 1; r++) {
		const bool beyond = r < 0 || r >= grid->height;
		const int rr = beyond ? row : r, reach = finder->reach[rr];
		const int turn = (beyond ? grid->width / 2 : 0) + 2 * grid->width;

		for (int c = column - reach; c <= column + reach; c++)
			count = take_free(finder, rr * grid->width + (c + turn) % grid->width, mark,
					  out, count);
	}
	return count;
}

/* Nothing but cores around: what lies further off is within reach of their outermost cells. */
static bool enclosed(const struct lp_lamp_finder *finder, int32_t cell)
{
	int neighbours[LP_NEIGHBOURS], other = 0;

	lp_grid_neighbours(finder->grid, cell, neighbours);
	for (int k = 0; k < LP_NEIGHBOURS; k++)
		other |= finder->mark[neighbours[k]] ^ CORE;
	return !other;
}

/*
 * Append the free cells that lie within one row's height of a given cell. Columns crowd towards the
 * poles: there as many are taken as span the same angle. `out` has room for what is free.
 */
static int grow(struct lp_lamp_finder *finder, int32_t cell, enum mark mark, int32_t *out)
{
	const struct lp_grid *grid = finder->grid;
	const int row = lp_grid_row(grid, cell), column = cell - row * grid->width;
	int count = 0;

	if (row == 0 || row == grid->height - 1)
		return grow_around(finder, row, column, mark, out);
	for (int r = -1; r <= 1; r++) {
		const int reach = finder->reach[row + r];

		if (column < reach || column >= grid->width - reach)
			return grow_around(finder, row, column, mark, out);
	}
	for (int r = -1; r <= 1; r++) {
		const int32_t middle = cell + r * grid->width;
		const int reach = finder->reach[row + r];

		for (int32_t c = middle - reach; c <= middle + reach; c++)
			count = take_free(finder, c, mark, out, count);
	}
	return count;
}

/* Up to MAX_RING_CELLS of the cells, taken evenly; one channel into finder->values. */
static int sample(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
		  const int32_t *cells, int count, int channel)
{
	const int step = (count + MAX_RING_CELLS - 1) / MAX_RING_CELLS;
	int used = 0;

	for (int i = 0; i < count; i += step)
		finder->values[used++] = panorama->cells[cells[i]][channel];
	return used;
}

/* Median radiance of `cells`, and the spread of their luminance. */
static void measure_background(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
			       const int32_t *cells, int count, struct lp_lamp *lamp)
{
	int used = 0;

	for (int channel = 0; channel < 4; channel++) { /* luminance last: its values stay */
		used = sample(finder, panorama, cells, count, channel);
		lamp->background[channel] = lp_select(finder->values, used, used / 2);
	}
	for (int i = 0; i < used; i++)
		finder->values[i] = fabsf(finder->values[i] - lamp->background[LUMINANCE]);
	lamp->background_noise = MAD_TO_SIGMA * lp_select(finder->values, used, used / 2);
}

/* Ring of free cells around the lamp's last `rim` cells; the marks are taken back so that
 * neighbours may use them too. */
static void find_background(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
			    int rim, struct lp_lamp *lamp)
{
	const int32_t *cells = finder->cells + lamp->first;
	const int touched = finder->touched_count;
	int from = 0, count = 0;

	for (int i = lamp->count - rim; i < lamp->count; i++)
		count += grow(finder, cells[i], RING, finder->ring + count);
	for (int k = 1; k < RING_CELLS; k++) {
		const int to = count;

		for (int i = from; i < to; i++)
			count += grow(finder, finder->ring[i], RING, finder->ring + count);
		from = to;
	}
	if (count)
		measure_background(finder, panorama, finder->ring, count, lamp);
	else /* shut in by other regions */
		measure_background(finder, panorama, cells, lamp->count, lamp);
	while (finder->touched_count > touched)
		finder->mark[finder->touched[--finder->touched_count]] = FREE;
}

/* Sums over a lamp's cells of what lies above the background. */
struct moments {
	double flux[4];	  /* R, G, B, luminance: sum excess * Omega */
	double squared;	  /* sum excess^2 * Omega, luminance */
	double first[3];  /* sum excess * Omega * d, luminance */
	double second[6]; /* same with d d^T: xx xy xz yy yz zz */
	bool clipped;
};

static struct moments moments_of(const struct lp_lamp_finder *finder,
				 const struct lp_panorama *panorama, const struct lp_lamp *lamp)
{
	struct moments m = {0};

	for (int i = 0; i < lamp->count; i++) {
		const int32_t cell = finder->cells[lamp->first + i];
		const double omega = lp_grid_solid_angle_sr(finder->grid, cell);
		float d[3];
		double excess = 0.0;

		for (int c = 0; c < 4; c++) {
			excess = (double)panorama->cells[cell][c] - lamp->background[c];
			m.flux[c] += excess * omega;
		}
		m.squared += excess * fabs(excess) * omega;
		m.clipped |= panorama->flags[cell] & LP_CELL_CLIPPED;
		lp_grid_direction(finder->grid, cell, d);
		for (int a = 0, k = 0; a < 3; a++) {
			m.first[a] += excess * omega * d[a];
			for (int b = a; b < 3; b++)
				m.second[k++] += excess * omega * d[a] * d[b];
		}
	}
	return m;
}

/*
 * Uncertainty of a centroid on the grid, degrees. Within a cell the light may sit anywhere
 * (uniform: side / sqrt(12)), which averages out over the cells it fills; and the surround's noise
 * moves the centroid.
 */
static float grid_sigma_deg(const struct lp_lamp_finder *finder, const struct lp_lamp *lamp,
			    double flux)
{
	const double side_rad = M_PI / finder->grid->height;
	const double cells = fmax(lamp->solid_angle_sr / (side_rad * side_rad), 1.0);
	const double radius_rad = sqrt(lamp->count * side_rad * side_rad / M_PI);
	const double noise_rad = lamp->background_noise * side_rad * side_rad *
				 sqrt((double)lamp->count) * radius_rad / flux;

	return (float)(hypot(side_rad / sqrt(12.0 * cells), noise_rad) * 180.0 / M_PI);
}

/* Fill the lamp from its moments; `axis` receives the direction of its longest extent. False: no
 * light is left above the background. */
static bool describe(const struct lp_lamp_finder *finder, const struct moments *m,
		     struct lp_lamp *lamp, double axis[3])
{
	const double flux = m->flux[LUMINANCE];
	const double length = sqrt(m->first[0] * m->first[0] + m->first[1] * m->first[1] +
				   m->first[2] * m->first[2]);
	double covariance[6], variance;

	if (!(flux > 0.0) || !(length > 0.0) || !(m->squared > 0.0))
		return false;
	for (int a = 0, k = 0; a < 3; a++)
		for (int b = a; b < 3; b++, k++)
			covariance[k] =
				m->second[k] / flux - m->first[a] * m->first[b] / (flux * flux);
	variance = lp_symmetric3_largest(covariance, axis);
	for (int c = 0; c < 4; c++)
		lamp->irradiance[c] = (float)fmax(m->flux[c], 0.0);
	for (int a = 0; a < 3; a++)
		lamp->centroid[a] = lamp->direction[a] = (float)(m->first[a] / length);
	lamp->solid_angle_sr = (float)fmin(flux * flux / m->squared, 2.0 * M_PI);
	lamp->direction_sigma_deg = grid_sigma_deg(finder, lamp, flux);
	lamp->spread_deg = (float)(sqrt(fmax(variance, 0.0)) * 180.0 / M_PI);
	lamp->flags = (lamp->flags & LP_LIGHT_EXTENDED) | (m->clipped ? LP_LIGHT_CLIPPED : 0);
	return true;
}

/* Order the lamp's cells so that those on the positive side of its centre along `axis` come last;
 * the result is where they begin. */
static int divide(struct lp_lamp_finder *finder, const struct lp_lamp *lamp, const double axis[3])
{
	int32_t *cells = finder->cells + lamp->first;
	const double centre = axis[0] * lamp->direction[0] + axis[1] * lamp->direction[1] +
			      axis[2] * lamp->direction[2];
	int head = 0, tail = lamp->count;

	while (head < tail) {
		float d[3];

		lp_grid_direction(finder->grid, cells[head], d);
		if (axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2] > centre) {
			const int32_t swap = cells[head];
			cells[head] = cells[--tail];
			cells[tail] = swap;
		} else {
			head++;
		}
	}
	return head;
}

static bool stands_out(const struct lp_lamp *lamp, float core_mean,
		       const struct lp_lamp_options *options)
{
	return core_mean > options->min_contrast * lamp->background[LUMINANCE] &&
	       core_mean > lamp->background[LUMINANCE] + 5.0F * lamp->background_noise;
}

static bool strong(const struct lp_lamp *lamp, float mean, const struct lp_lamp_options *options)
{
	/* the rest of the light, spread evenly, gives pi * mean on any surface */
	const float rest = fmaxf((float)M_PI * mean - lamp->irradiance[LUMINANCE] / 4.0F, 0.0F);

	return lamp->irradiance[LUMINANCE] >=
	       options->min_strength * (lamp->irradiance[LUMINANCE] + rest);
}

void lp_lamp_insert(struct lp_lamp_finder *finder, const struct lp_lamp *lamp)
{
	int at = finder->count;

	while (at > 0 && finder->lamps[at - 1].irradiance[LUMINANCE] < lamp->irradiance[LUMINANCE])
		at--;
	if (at == LP_MAX_LAMPS)
		return;
	if (finder->count < LP_MAX_LAMPS)
		finder->count++;
	memmove(finder->lamps + at + 1, finder->lamps + at,
		(finder->count - 1 - at) * sizeof(*lamp));
	finder->lamps[at] = *lamp;
}

/* Split until every part is narrow enough; a part of one cell is. */
static void split_and_insert(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
			     struct lp_lamp whole, const struct lp_lamp_options *options)
{
	struct lp_lamp stack[2 * LP_MAX_LAMPS];
	int depth = 0;

	stack[depth++] = whole;
	while (depth) {
		struct lp_lamp lamp = stack[--depth];
		const struct moments m = moments_of(finder, panorama, &lamp);
		double axis[3];

		if (!describe(finder, &m, &lamp, axis))
			continue;
		if (lamp.spread_deg <= options->max_spread_deg || lamp.count < 2 ||
		    depth + 2 > (int)(sizeof(stack) / sizeof(stack[0]))) {
			lp_lamp_insert(finder, &lamp);
			continue;
		}
		const int head = divide(finder, &lamp, axis);

		if (head == 0 || head == lamp.count) { /* rounding left nothing to divide */
			lp_lamp_insert(finder, &lamp);
			continue;
		}
		lamp.flags |= LP_LIGHT_EXTENDED;
		stack[depth] = lamp;
		stack[depth++].count = head;
		stack[depth] = lamp;
		stack[depth].first += head;
		stack[depth++].count -= head;
	}
}

static void measure_region(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
			   const struct lp_regions *regions, const struct lp_region *region,
			   float mean, const struct lp_lamp_options *options)
{
	const int room = finder->grid->width * finder->grid->height;
	struct lp_lamp lamp = {.first = finder->cell_count,
			       .count = region->count,
			       .peak = region->peak};
	float core_solid_angle = 0.0F;
	double axis[3];

	if (RIM_FACTOR * region->flux < (double)options->min_strength * M_PI * mean)
		return;
	if (finder->cell_count + region->count > room)
		return;
	memcpy(finder->cells + lamp.first, regions->cells + region->first,
	       region->count * sizeof(*finder->cells));
	for (int i = 0; i < region->count; i++) {
		const int32_t cell = finder->cells[lamp.first + i];

		core_solid_angle += lp_grid_solid_angle_sr(finder->grid, cell);
		if (!enclosed(finder, cell))
			lamp.count +=
				grow(finder, cell, RIM, finder->cells + lamp.first + lamp.count);
	}
	finder->cell_count += lamp.count;
	find_background(finder, panorama, lamp.count - region->count, &lamp);
	if (!stands_out(&lamp, (float)region->flux / core_solid_angle, options))
		return;

	const struct moments m = moments_of(finder, panorama, &lamp);
	if (describe(finder, &m, &lamp, axis) && strong(&lamp, mean, options))
		split_and_insert(finder, panorama, lamp, options);
}

/* The list is full of lamps that no remaining region can outshine: a rim holds a few times what its
 * core does, not more. */
static bool settled(const struct lp_lamp_finder *finder, const struct lp_region *next)
{
	return finder->count > LP_MAX_LIGHTS &&
	       RIM_FACTOR * next->flux < finder->lamps[LP_MAX_LIGHTS - 1].irradiance[LUMINANCE];
}

void lp_find_lamps(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
		   const struct lp_regions *regions, float mean,
		   const struct lp_lamp_options *options)
{
	start_run(finder, regions);
	for (int k = 0; k < regions->count && !settled(finder, &regions->list[k]); k++)
		measure_region(finder, panorama, regions, &regions->list[k], mean, options);
}
