/* SPDX-License-Identifier: Apache-2.0 */
#include "light/find/research.h"

#include <math.h>
#include <stdbool.h>

#include "base/select.h"
#include "include/luminance.h"
#include "include/panorama.h"
#include "light/find/lamps.h"
#include "light/math/grid.h"

/* Kernels of the recipe in pixels of its 1920-pixel picture, scaled to the grid. */
#define PICTURE_WIDTH_PX 1920.0F
#define BLUR_PX 11.0F
#define ERODE_PX 11.0F

struct planes {
	int width, height;
	float *a, *b;
};

/* Half width of a kernel on the grid; an 11-pixel kernel is less than a cell of 8 pixels each way.
 */
static int half_width(const struct planes *p, float kernel_px)
{
	return (int)lroundf(kernel_px * (float)p->width / PICTURE_WIDTH_PX / 2.0F);
}

enum filter { MINIMUM, MAXIMUM, MEAN };

/* One pass along rows (step 1) or columns (step width), picture edges repeated; a to b. */
static void pass(const struct planes *p, enum filter filter, int half, bool along_rows)
{
	const int length = along_rows ? p->width : p->height;
	const int lines = along_rows ? p->height : p->width;
	const int step = along_rows ? 1 : p->width, next = along_rows ? p->width : 1;

	for (int line = 0; line < lines; line++)
		for (int i = 0; i < length; i++) {
			const float *from = p->a + line * next;
			float value = filter == MEAN ? 0.0F : from[i * step];

			for (int k = i - half; k <= i + half; k++) {
				const float v = from[(k < 0	    ? 0
						      : k >= length ? length - 1
								    : k) *
						     step];

				value = filter == MINIMUM   ? fminf(value, v)
					: filter == MAXIMUM ? fmaxf(value, v)
							    : value + v;
			}
			p->b[line * next + i * step] =
				filter == MEAN ? value / (float)(2 * half + 1) : value;
		}
}

static void filter_square(struct planes *p, enum filter filter, int half)
{
	for (int direction = 0; half > 0 && direction < 2; direction++) {
		pass(p, filter, half, direction == 0);
		float *swap = p->a;
		p->a = p->b;
		p->b = swap;
	}
}

/* A Gaussian as three means in a row (Wells 1986). */
static void blur(struct planes *p, int half)
{
	for (int k = 0; k < 3; k++)
		filter_square(p, MEAN, (half + 1) / 2);
}

/* Planar connected region from `seed`, marked by clearing the mask; its cells are appended. */
static int flood(struct lp_lamp_finder *finder, float *mask, int width, int height, int32_t seed)
{
	int32_t *cells = finder->cells + finder->cell_count;
	int count = 0;

	mask[seed] = 0.0F;
	cells[count++] = seed;
	for (int i = 0; i < count; i++) {
		const int row = cells[i] / width, column = cells[i] % width;

		for (int r = row - 1; r <= row + 1; r++)
			for (int c = column - 1; c <= column + 1; c++) {
				if (r < 0 || c < 0 || r >= height || c >= width ||
				    mask[r * width + c] < 0.5F)
					continue;
				mask[r * width + c] = 0.0F;
				cells[count++] = r * width + c;
			}
	}
	return count;
}

static struct lp_lamp lamp_of(const struct lp_lamp_finder *finder,
			      const struct lp_panorama *panorama, int first, int count)
{
	const struct lp_grid *grid = finder->grid;
	struct lp_lamp lamp = {.direction_sigma_deg = NAN, .first = first, .count = count};
	double row = 0.0, column = 0.0;

	for (int i = 0; i < count; i++) {
		const int32_t cell = finder->cells[first + i];
		const float omega = lp_grid_solid_angle_sr(grid, cell);

		row += cell / grid->width + 0.5;
		column += cell % grid->width + 0.5;
		lamp.solid_angle_sr += omega;
		for (int k = 0; k < 4; k++)
			lamp.irradiance[k] += panorama->cells[cell][k] / (float)count;
	}
	for (int k = 0; k < 4; k++) /* mean colour over the region's solid angle */
		lamp.irradiance[k] *= lamp.solid_angle_sr;
	const double theta = M_PI * row / count / grid->height;
	const double lambda = 2.0 * M_PI * (column / count / grid->width - 0.5);

	lamp.direction[0] = (float)(sin(theta) * sin(lambda));
	lamp.direction[1] = (float)cos(theta);
	lamp.direction[2] = (float)(-sin(theta) * cos(lambda));
	return lamp;
}

/* Largest area first; the smallest falls off the end. */
static void insert_by_area(struct lp_lamp_finder *finder, const struct lp_lamp *lamp)
{
	int at = finder->count < LP_MAX_LAMPS ? finder->count++ : LP_MAX_LAMPS - 1;

	if (finder->lamps[at].count > lamp->count && at == LP_MAX_LAMPS - 1)
		return;
	for (; at > 0 && finder->lamps[at - 1].count < lamp->count; at--)
		finder->lamps[at] = finder->lamps[at - 1];
	finder->lamps[at] = *lamp;
}

/* Median luminance of the cells that have light, by cell, as the recipe has it. */
static float median_of(const struct lp_panorama *panorama, float *scratch)
{
	int count = 0;

	for (int i = 0; i < panorama->width * panorama->height; i++)
		if (panorama->cells[i][LP_LUMINANCE] > 0.0F)
			scratch[count++] = panorama->cells[i][LP_LUMINANCE];
	return count ? lp_select(scratch, count, count / 2) : 0.0F;
}

void lp_research_detect(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
			float threshold, float *scratch)
{
	const int n = panorama->width * panorama->height;
	struct planes p = {panorama->width, panorama->height, scratch, scratch + n};
	const int erosion = half_width(&p, ERODE_PX), dilation = half_width(&p, 3.0F * ERODE_PX);
	const float level = threshold > 0.0F ? threshold : median_of(panorama, scratch);

	for (int i = 0; i < n; i++)
		p.a[i] = panorama->cells[i][LP_LUMINANCE] > level ? 1.0F : 0.0F;
	blur(&p, half_width(&p, BLUR_PX));
	filter_square(&p, MINIMUM, erosion);
	filter_square(&p, MAXIMUM, dilation);
	finder->count = finder->cell_count = 0;
	for (int i = 0; i < n; i++) {
		if (p.a[i] < 0.5F)
			continue;
		const int first = finder->cell_count;
		const int count = flood(finder, p.a, p.width, p.height, i);
		const struct lp_lamp lamp = lamp_of(finder, panorama, first, count);

		finder->cell_count += count;
		insert_by_area(finder, &lamp);
	}
}
