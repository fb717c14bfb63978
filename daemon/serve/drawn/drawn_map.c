/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/drawn/drawn_map.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "light/linear/vector.h"
#include "serve/drawn/drawn_light.h"

#define RAD (M_PI / 180.0)
/* Directions in which surfaces are looked at. */
#define VIEWS 96
/* A lobe ends where it is exp(-this) of its peak. */
#define END 12.0

/* Texels that a lobe covers, for each view. */
struct lobes {
	int start[VIEWS + 1];
	uint16_t *texel;
	float *sharp;	/* the lobe at the texel, times its solid angle */
	float *blurred; /* with a texel's width more of blur, adding up to 1 */
};

struct lp_drawn_mirrors {
	struct lp_cube_grid *grids[LP_DRAWN_SIZES];
	struct lobes mirrors[LP_DRAWN_SIZES];
	struct lobes glossy; /* on the coarsest map: it is fine enough for so much blur */
	float *luminance[LP_DRAWN_SIZES], *lamps[LP_DRAWN_SIZES];
};

/* What a surface shows in every view. */
struct shown {
	float sharp[VIEWS], blurred[VIEWS];
};

/* ---------------------------------------------------------------- lobes */

/* Texels in the lobe around a view, from `at` on; written where there is room for them. `to`:
 * directions of all texels. */
static int cover(struct lobes *lobes, const struct lp_cube_grid *grid, const float (*to)[3],
		 double blur_rad, int view, int at)
{
	const double width2 = 4.0 * M_PI / grid->texels;
	const double more_rad = sqrt(blur_rad * blur_rad + width2 / 6.0);
	const double least = 1.0 - END * more_rad * more_rad;
	const int first = at;
	double towards[3], sum = 0.0;

	lp_drawn_spread(view, VIEWS, towards);
	for (int i = 0; i < grid->texels; i++) {
		const double cosine =
			lp_dot(towards, (const double[]){to[i][0], to[i][1], to[i][2]});

		if (cosine < least)
			continue;
		if (lobes->texel) {
			const double solid = (double)grid->solid_angle_sr[i];

			lobes->texel[at] = (uint16_t)i;
			lobes->sharp[at] = (float)(lp_drawn_lobe(blur_rad, cosine) * solid);
			lobes->blurred[at] = (float)(lp_drawn_lobe(more_rad, cosine) * solid);
			sum += (double)lobes->blurred[at];
		}
		at++;
	}
	for (int i = first; lobes->texel && sum > 0.0 && i < at; i++)
		lobes->blurred[i] /= (float)sum;
	return at;
}

static bool fill_lobes(struct lobes *lobes, const struct lp_cube_grid *grid, const float (*to)[3],
		       double blur_rad)
{
	int count = 0;

	for (int v = 0; v < VIEWS; v++)
		count = cover(lobes, grid, to, blur_rad, v, count);
	lobes->sharp = malloc((size_t)count * sizeof(*lobes->sharp));
	lobes->blurred = malloc((size_t)count * sizeof(*lobes->blurred));
	lobes->texel = malloc((size_t)count * sizeof(*lobes->texel));
	if (!lobes->sharp || !lobes->blurred || !lobes->texel)
		return false;
	count = 0;
	for (int v = 0; v < VIEWS; v++) {
		lobes->start[v] = count;
		count = cover(lobes, grid, to, blur_rad, v, count);
	}
	lobes->start[VIEWS] = count;
	return true;
}

static bool create_lobes(struct lobes *lobes, const struct lp_cube_grid *grid, double blur_rad)
{
	float(*to)[3] = malloc((size_t)grid->texels * sizeof(*to));
	bool complete;

	if (!to)
		return false;
	for (int i = 0; i < grid->texels; i++)
		lp_cube_direction(grid->size, i, to[i]);
	complete = fill_lobes(lobes, grid, (const float(*)[3])to, blur_rad);
	free(to);
	return complete;
}

static void free_lobes(struct lobes *lobes)
{
	free(lobes->texel);
	free(lobes->sharp);
	free(lobes->blurred);
}

struct lp_drawn_mirrors *lp_drawn_mirrors_create(int size,
						 struct lp_cube_grid *const grids[LP_DRAWN_SIZES])
{
	struct lp_drawn_mirrors *self = calloc(1, sizeof(*self));
	bool complete = self && create_lobes(&self->glossy, grids[0], LP_GLOSSY_DEG * RAD);

	for (int k = 0; complete && k <= lp_drawn_size_index(size); k++) {
		self->grids[k] = grids[k];
		self->luminance[k] = aligned_alloc(16, (size_t)grids[k]->texels * sizeof(float));
		self->lamps[k] = aligned_alloc(16, (size_t)grids[k]->texels * sizeof(float));
		complete = self->luminance[k] && self->lamps[k] &&
			   create_lobes(&self->mirrors[k], grids[k], LP_MIRROR_DEG * RAD);
	}
	if (!complete) {
		lp_drawn_mirrors_destroy(self);
		return NULL;
	}
	return self;
}

void lp_drawn_mirrors_destroy(struct lp_drawn_mirrors *mirrors)
{
	if (!mirrors)
		return;
	free_lobes(&mirrors->glossy);
	for (int k = 0; k < LP_DRAWN_SIZES; k++) {
		free_lobes(&mirrors->mirrors[k]);
		free(mirrors->luminance[k]);
		free(mirrors->lamps[k]);
	}
	free(mirrors);
}

/* ---------------------------------------------------------------- what is shown */

float *lp_drawn_mirrors_luminance(struct lp_drawn_mirrors *mirrors, int size)
{
	return mirrors->luminance[lp_drawn_size_index(size)];
}

float *lp_drawn_mirrors_lamps(struct lp_drawn_mirrors *mirrors, int size)
{
	return mirrors->lamps[lp_drawn_size_index(size)];
}

/* The mean of every four texels, by solid angle. */
static void halve(const struct lp_cube_grid *from, const float *fine, const struct lp_cube_grid *to,
		  float *coarse)
{
	const int size = to->size;

	for (int i = 0; i < to->texels; i++) {
		const int face = i / (size * size), row = i / size % size, column = i % size;
		float sum = 0.0F, solid = 0.0F;

		for (int k = 0; k < 4; k++) {
			const int j = (face * from->size + 2 * row + k / 2) * from->size +
				      2 * column + k % 2;

			sum += fine[j] * from->solid_angle_sr[j];
			solid += from->solid_angle_sr[j];
		}
		coarse[i] = sum / solid;
	}
}

static void look(const struct lobes *lobes, const float *luminance, struct shown *shown)
{
	for (int v = 0; v < VIEWS; v++) {
		float sharp = 0.0F, blurred = 0.0F;

		for (int i = lobes->start[v]; i < lobes->start[v + 1]; i++) {
			sharp += luminance[lobes->texel[i]] * lobes->sharp[i];
			blurred += luminance[lobes->texel[i]] * lobes->blurred[i];
		}
		shown->sharp[v] = sharp;
		shown->blurred[v] = blurred;
	}
}

static float on_screen(float radiance, float mean)
{
	const float positive = fmaxf(radiance, 0.0F);

	return positive / (positive + mean);
}

static float difference(const float a[VIEWS], const float b[VIEWS], float mean)
{
	float sum = 0.0F;

	for (int v = 0; v < VIEWS; v++) {
		const float off = on_screen(a[v], mean) - on_screen(b[v], mean);

		sum += off * off;
	}
	return sqrtf(sum / VIEWS);
}

static float slope_of(const float radiance[VIEWS], float mean)
{
	float sum = 0.0F;

	for (int v = 0; v < VIEWS; v++) {
		const float share = on_screen(radiance[v], mean);

		sum += share * share * (1.0F - share) * (1.0F - share);
	}
	return sqrtf(sum / VIEWS);
}

/* The lamps are off, by so much that the irradiance of one is by that share of the mean
 * (drawn_light.c). */
static float lamp_slope(const struct lp_drawn_mirrors *mirrors, const struct shown *all, float mean)
{
	struct shown lamps;
	float strength = 0.0F, sum = 0.0F;

	look(&mirrors->glossy, mirrors->lamps[0], &lamps);
	for (int i = 0; i < mirrors->grids[0]->texels; i++)
		strength += mirrors->lamps[0][i] * mirrors->grids[0]->solid_angle_sr[i];
	if (!(strength > 0.0F))
		return 0.0F;
	for (int v = 0; v < VIEWS; v++) {
		const float rest = 1.0F - on_screen(all->sharp[v], mean);
		const float slope =
			sqrtf(6.0F) * (float)M_PI * lamps.sharp[v] / strength * rest * rest;

		sum += slope * slope;
	}
	return sqrtf(sum / VIEWS);
}

void lp_drawn_measure(struct lp_drawn_mirrors *mirrors, int size, struct lp_drawn_maps *maps)
{
	const int finest = lp_drawn_size_index(size);
	struct shown sharpest, glossy, coarse;
	double sum = 0.0;

	for (int k = finest; k > 0; k--)
		halve(mirrors->grids[k], mirrors->luminance[k], mirrors->grids[k - 1],
		      mirrors->luminance[k - 1]);
	for (int k = 0; k <= finest; k++)
		for (int i = 0; i < mirrors->grids[k]->texels; i++)
			mirrors->luminance[k][i] += mirrors->lamps[k][i];
	for (int i = 0; i < mirrors->grids[finest]->texels; i++)
		sum += (double)(mirrors->luminance[finest][i] *
				mirrors->grids[finest]->solid_angle_sr[i]);
	const float mean = (float)(sum / (4.0 * M_PI));

	*maps = (struct lp_drawn_maps){.size = mean > 0.0F ? size : 0};
	if (!maps->size)
		return;
	look(&mirrors->mirrors[finest], mirrors->luminance[finest], &sharpest);
	look(&mirrors->glossy, mirrors->luminance[0], &glossy);
	const float own = difference(sharpest.sharp, sharpest.blurred, mean);
	const float by_coarsest = difference(glossy.sharp, glossy.blurred, mean);

	for (int k = 0; k <= finest; k++) {
		look(&mirrors->mirrors[k], mirrors->luminance[k], &coarse);
		/* both blur the same edges: that adds up, not as variances */
		maps->mirrors[k] = own + difference(coarse.sharp, sharpest.sharp, mean);
		/* as the texel's variance: a quarter for each step */
		maps->glossy[k] = by_coarsest / (float)(1 << (2 * k));
	}
	maps->mirror_slope = slope_of(sharpest.sharp, mean);
	maps->glossy_slope =
		fmaxf(slope_of(glossy.sharp, mean), lamp_slope(mirrors, &glossy, mean));
}
