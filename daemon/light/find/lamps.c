/* SPDX-License-Identifier: Apache-2.0 */
#include "light/find/lamps.h"

#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/macros.h"
#include "base/select.h"
#include "include/light_estimate.h"
#include "include/luminance.h"
#include "include/panorama.h"
#include "light/find/regions.h"
#include "light/math/grid.h"
#include "light/linear/symmetric3.h"

/* Chosen by hand; docs/maintainers/constants.md says what half and double of each does. */
#define RIM_FACTOR 4.0	     /* most flux of a lamp over that of its core alone */
#define RING_CELLS 2	     /* width of the ring that gives the background */
#define MAX_RING_CELLS 128   /* of it, taken evenly: enough for a median */
#define FEW_COLUMNS 8	     /* are looked at one by one */
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
	f->cells_before = calloc(n, sizeof(*f->cells_before));
	f->mark = calloc(n, sizeof(*f->mark));
	f->owner = calloc(n, sizeof(*f->owner));
	f->ring = calloc(n, sizeof(*f->ring));
	f->values = calloc(MAX_RING_CELLS, sizeof(*f->values));
	f->reach = calloc(grid->height, sizeof(*f->reach));
	if (!f->reach || !f->cells || !f->cells_before || !f->mark || !f->owner || !f->ring ||
	    !f->values) {
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
	free(finder->owner);
	free(finder->mark);
	free(finder->cells_before);
	free(finder->cells);
	free(finder);
}

static void take(struct lp_lamp_finder *finder, int32_t cell, enum mark mark)
{
	finder->mark[cell] = (uint8_t)mark;
}

static void start_run(struct lp_lamp_finder *finder, const struct lp_regions *regions)
{
	const struct lp_grid *grid = finder->grid;
	int32_t *before = finder->cells_before;

	finder->cells_before = finder->cells;
	finder->cells = before;
	memset(finder->mark, FREE, (size_t)grid->width * grid->height);
	finder->cell_count = 0;
	finder->count = 0;
	for (int k = 0; k < regions->count; k++)
		for (int i = 0; i < regions->list[k].count; i++) {
			const int32_t cell = regions->cells[regions->list[k].first + i];

			take(finder, cell, CORE);
		}
}

/* Nothing but cores around, as far as a glance tells: what lies further off is within reach of
 * their outermost cells. */
static bool enclosed(const struct lp_lamp_finder *finder, int32_t cell)
{
	const uint8_t *mark = finder->mark + cell;
	const int width = finder->grid->width;

	if (!lp_grid_inside(finder->grid, cell))
		return false;
	for (int at = -width; at <= width; at += width)
		if (mark[at - 1] != CORE || mark[at] != CORE || mark[at + 1] != CORE)
			return false;
	return true;
}

/* Append what is free of a row's columns from .. to - 1. */
static int take_free(struct lp_lamp_finder *finder, int row, int from, int to, enum mark mark,
		     int32_t *out)
{
	const int32_t first = row * finder->grid->width;
	int count = 0;

	for (int32_t cell = first + from; cell < first + to; cell++) {
		if (to - from > FEW_COLUMNS) { /* most of a row near a pole is taken soon */
			const uint8_t *free = memchr(finder->mark + cell, FREE, first + to - cell);

			if (!free)
				break;
			cell = (int32_t)(free - finder->mark);
		}
		if (finder->mark[cell] == FREE) {
			take(finder, cell, mark);
			out[count++] = cell;
		}
	}
	return count;
}

/*
 * Append the free cells that lie within one row's height of a given cell. Columns crowd towards the
 * poles: there as many are taken as span the same angle. Beyond a pole the grid goes on in the same
 * row, half a turn away. `out` has room for what is free.
 */
static int grow(struct lp_lamp_finder *finder, int32_t cell, enum mark mark, int32_t *out)
{
	const struct lp_grid *grid = finder->grid;
	const int width = grid->width;
	const int row = lp_grid_row(grid, cell), column = cell - row * width;
	int count = 0;

	for (int r = row - 1; r <= row + 1; r++) {
		const bool beyond = r < 0 || r >= grid->height;
		const int rr = beyond ? row : r, reach = finder->reach[rr];
		const int half_turn = column < width / 2 ? width / 2 : -width / 2;
		const int from = column + (beyond ? half_turn : 0) - reach;
		const int to = from + 2 * reach + 1;

		if (from < 0)
			count += take_free(finder, rr, from + width, width, mark, out + count);
		count += take_free(finder, rr, from < 0 ? 0 : from, to < width ? to : width, mark,
				   out + count);
		if (to > width)
			count += take_free(finder, rr, 0, to - width, mark, out + count);
	}
	return count;
}

/* The cells whose light is a lamp's background. */
struct surround {
	const int32_t *cells;
	int count;
};

/* Up to MAX_RING_CELLS of them, taken evenly; one channel into finder->values. */
static int sample(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
		  const struct surround *around, int channel)
{
	const int step = (around->count + MAX_RING_CELLS - 1) / MAX_RING_CELLS;
	int used = 0;

	for (int i = 0; i < around->count; i += step)
		finder->values[used++] = panorama->cells[around->cells[i]][channel];
	return used;
}

/* Median radiance, one channel; the sample stays in finder->values, and its size is returned. */
static int measure_background(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
			      const struct surround *around, int channel, struct lp_lamp *lamp)
{
	const int used = sample(finder, panorama, around, channel);

	lamp->background[channel] = lp_select(finder->values, used, used / 2);
	return used;
}

/* Spread of the luminance, of which `used` values have been sampled last. */
static void measure_noise(struct lp_lamp_finder *finder, int used, struct lp_lamp *lamp)
{
	for (int i = 0; i < used; i++)
		finder->values[i] = fabsf(finder->values[i] - lamp->background[LP_LUMINANCE]);
	lamp->background_noise = MAD_TO_SIGMA * lp_select(finder->values, used, used / 2);
}

/* Ring of free cells around the lamp's last `rim` cells; the marks are taken back so that
 * neighbours may use them too. The lamp itself, where other regions shut it in. */
static struct surround find_surround(struct lp_lamp_finder *finder, const struct lp_lamp *lamp,
				     int rim)
{
	const int32_t *cells = finder->cells + lamp->first;
	int from = 0, count = 0;

	for (int i = lamp->count - rim; i < lamp->count; i++)
		count += grow(finder, cells[i], RING, finder->ring + count);
	for (int k = 1; k < RING_CELLS; k++) {
		const int to = count;

		for (int i = from; i < to; i++)
			count += grow(finder, finder->ring[i], RING, finder->ring + count);
		from = to;
	}
	for (int i = 0; i < count; i++)
		take(finder, finder->ring[i], FREE);
	return count ? (struct surround){finder->ring, count}
		     : (struct surround){cells, lamp->count};
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

/* Half of the angle that a uniform ellipse spans, by the variance of its unit vectors: exact within
 * 2 % of that of a disc of 30 degrees. */
static float half_angle_deg(double variance)
{
	return (float)(asin(fmin(2.0 * sqrt(fmax(variance, 0.0)), 1.0)) * 180.0 / M_PI);
}

/* axis: of the largest variance, a unit vector across lamp->direction. */
static void describe_ellipse(const double covariance[6], const double axis[3], double variance,
			     struct lp_lamp *lamp)
{
	const float *d = lamp->direction;
	const double across[3] = {d[1] * axis[2] - d[2] * axis[1], d[2] * axis[0] - d[0] * axis[2],
				  d[0] * axis[1] - d[1] * axis[0]};
	double smaller = 0.0;

	for (int a = 0, k = 0; a < 3; a++)
		for (int b = a; b < 3; b++, k++)
			smaller += (a == b ? 1.0 : 2.0) * across[a] * covariance[k] * across[b];
	for (int a = 0; a < 3; a++)
		lamp->axis[a] = (float)axis[a];
	lamp->half_angle_deg[0] = half_angle_deg(variance);
	lamp->half_angle_deg[1] = half_angle_deg(smaller);
}

/* Fill the lamp from its moments. False: no light is left above the background. */
static bool describe(const struct lp_lamp_finder *finder, const struct moments *m,
		     struct lp_lamp *lamp)
{
	const double flux = m->flux[LP_LUMINANCE];
	const double length = sqrt(m->first[0] * m->first[0] + m->first[1] * m->first[1] +
				   m->first[2] * m->first[2]);
	double covariance[6], axis[3], variance;

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
	describe_ellipse(covariance, axis, variance, lamp);
	lamp->flags = m->clipped ? LP_LIGHT_CLIPPED : 0;
	return true;
}

static bool stands_out(struct lp_lamp *lamp, float core_mean, const struct lp_lamp_options *options)
{
	const float background = lamp->background[LP_LUMINANCE];

	lamp->contrast = core_mean / fmaxf(background, FLT_MIN);
	lamp->contrast_to_noise = (core_mean - background) / fmaxf(lamp->background_noise, FLT_MIN);
	return core_mean > options->min_contrast * background &&
	       lamp->contrast_to_noise > options->min_contrast_to_noise;
}

static bool strong(struct lp_lamp *lamp, float mean, const struct lp_lamp_options *options)
{
	/* the rest of the light, spread evenly, gives pi * mean on any surface */
	const float own = lamp->irradiance[LP_LUMINANCE];
	const float rest = fmaxf((float)M_PI * mean - own / 4.0F, 0.0F);

	lamp->share = own + rest > 0.0F ? own / (own + rest) : 1.0F;
	return own >= options->min_strength * (own + rest);
}

void lp_lamp_insert(struct lp_lamp_finder *finder, const struct lp_lamp *lamp)
{
	int at = finder->count;

	while (at > 0 &&
	       finder->lamps[at - 1].irradiance[LP_LUMINANCE] < lamp->irradiance[LP_LUMINANCE])
		at--;
	if (at == LP_MAX_LAMPS)
		return;
	if (finder->count < LP_MAX_LAMPS)
		finder->count++;
	memmove(finder->lamps + at + 1, finder->lamps + at,
		(finder->count - 1 - at) * sizeof(*lamp));
	finder->lamps[at] = *lamp;
}

/* From its cells and its background; false as of describe(). */
static bool measure(const struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
		    struct lp_lamp *lamp)
{
	const struct moments m = moments_of(finder, panorama, lamp);

	return describe(finder, &m, lamp);
}

/* Background in all channels, and whether the lamp stands out of it and is strong enough. Its last
 * `rim` cells surround the others, of mean luminance `core_mean`. */
static bool is_lamp(struct lp_lamp_finder *finder, const struct lp_panorama *panorama, int rim,
		    float core_mean, float mean, const struct lp_lamp_options *options,
		    struct lp_lamp *lamp)
{
	const struct surround around = find_surround(finder, lamp, rim);

	measure_noise(finder, measure_background(finder, panorama, &around, LP_LUMINANCE, lamp),
		      lamp);
	if (!stands_out(lamp, core_mean, options))
		return false;
	for (int channel = 0; channel < LP_LUMINANCE; channel++)
		measure_background(finder, panorama, &around, channel, lamp);
	return measure(finder, panorama, lamp) && strong(lamp, mean, options);
}

static void measure_region(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
			   const struct lp_regions *regions, const struct lp_region *region,
			   float mean, const struct lp_lamp_options *options)
{
	const int room = finder->grid->width * finder->grid->height;
	struct lp_lamp lamp = {.first = finder->cell_count,
			       .count = region->count,
			       .core_count = region->count,
			       .peak = region->peak};

	if (region->too_large ||
	    RIM_FACTOR * region->flux < (double)options->min_strength * M_PI * mean)
		return;
	if (finder->cell_count + region->count > room)
		return;
	memcpy(finder->cells + lamp.first, regions->cells + region->first,
	       region->count * sizeof(*finder->cells));
	for (int i = 0; i < region->count; i++) {
		const int32_t cell = finder->cells[lamp.first + i];

		if (!enclosed(finder, cell))
			lamp.count +=
				grow(finder, cell, RIM, finder->cells + lamp.first + lamp.count);
	}
	finder->cell_count += lamp.count;
	if (is_lamp(finder, panorama, lamp.count - region->count,
		    (float)(region->flux / region->solid_angle_sr), mean, options, &lamp))
		lp_lamp_insert(finder, &lamp);
}

/* The list is full of lamps that no remaining region can outshine: a rim holds a few times what its
 * core does, not more. */
static bool settled(const struct lp_lamp_finder *finder, const struct lp_region *next)
{
	return finder->count > LP_MAX_LIGHTS &&
	       RIM_FACTOR * next->flux < finder->lamps[LP_MAX_LIGHTS - 1].irradiance[LP_LUMINANCE];
}

void lp_find_lamps(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
		   const struct lp_regions *regions, float mean,
		   const struct lp_lamp_options *options)
{
	start_run(finder, regions);
	for (int k = 0; k < regions->count && !settled(finder, &regions->list[k]); k++)
		measure_region(finder, panorama, regions, &regions->list[k], mean, options);
}

bool lp_lamp_finder_hold(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
			 float mean, const struct lp_lamp_options *options, struct lp_lamp *lamp)
{
	const struct lp_grid *grid = finder->grid;
	const int32_t *before = finder->cells_before + lamp->first;
	int32_t *cells = finder->cells + finder->cell_count;
	double flux = 0.0, solid_angle_sr = 0.0;

	if (finder->cell_count + lamp->count > grid->width * grid->height)
		return false;
	memcpy(cells, before, lamp->count * sizeof(*cells));
	lamp->first = finder->cell_count;
	lamp->peak = 0.0F;
	for (int i = 0; i < lamp->count; i++) {
		if (finder->mark[cells[i]] == FREE)
			take(finder, cells[i], RIM);
		if (i >= lamp->core_count)
			continue;
		const float luminance = panorama->cells[cells[i]][LP_LUMINANCE];
		const double omega = lp_grid_solid_angle_sr(grid, cells[i]);

		lamp->peak = fmaxf(lamp->peak, luminance);
		flux += luminance * omega;
		solid_angle_sr += omega;
	}
	if (!is_lamp(finder, panorama, lamp->count - lamp->core_count,
		     (float)(flux / solid_angle_sr), mean, options, lamp))
		return false;
	finder->cell_count += lamp->count;
	return true;
}
