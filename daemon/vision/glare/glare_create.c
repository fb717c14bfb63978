/* SPDX-License-Identifier: Apache-2.0 */
/* What is calculated once for a camera's glare: which lens sees what, and how to keep all light. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "vision/glare/glare.h"

/* Two lenses of a panorama: each sees so far beyond its half of the sphere. */
#define OVERLAP_DEG 5.0
/* Rounds in which the spread is balanced. */
#define BALANCING 40

static void node_direction(int node, double direction[3])
{
	const double theta = M_PI * (node / LP_VEIL_WIDTH + 0.5) / LP_VEIL_HEIGHT;
	const double lambda = 2.0 * M_PI * ((node % LP_VEIL_WIDTH + 0.5) / LP_VEIL_WIDTH - 0.5);

	direction[0] = sin(theta) * sin(lambda);
	direction[1] = cos(theta);
	direction[2] = -sin(theta) * cos(lambda);
}

static float node_sr(int node)
{
	const int row = node / LP_VEIL_WIDTH;

	return (float)(2.0 * M_PI / LP_VEIL_WIDTH *
		       (cos(M_PI * row / LP_VEIL_HEIGHT) - cos(M_PI * (row + 1) / LP_VEIL_HEIGHT)));
}

/* One lens for the whole sphere, and one each for its halves, ahead and behind. */
static void set_panorama(struct lp_glare *g)
{
	g->is_panorama = true;
	g->lens_count = 3;
	g->lens[0].spreads = true;
	for (int n = 0; n < LP_VEIL_NODES; n++) {
		double d[3];

		node_direction(n, d);
		const double behind_deg = asin(d[2]) * 180.0 / M_PI;
		const float behind =
			(float)fmin(fmax(0.5 + behind_deg / (2.0 * OVERLAP_DEG), 0.0), 1.0);

		g->lens[0].source[n] = g->lens[0].out_of[n] = 1.0F;
		g->lens[0].even[n] = 0.5F;
		g->lens[1].source[n] = 1.0F - behind;
		g->lens[2].source[n] = behind;
		g->lens[1].even[n] = 0.5F * (1.0F - behind);
		g->lens[2].even[n] = 0.5F * behind;
	}
}

/* A node of which no lens sees the middle has the shares of a neighbour: cells beside it are seen.
 */
static void fill_shares(struct lp_glare *g, const bool *was_seen, bool *is_seen)
{
	for (int n = 0; n < LP_VEIL_NODES; n++) {
		const int row = n / LP_VEIL_WIDTH * LP_VEIL_WIDTH, column = n - row;
		const int beside[4] = {row + (column + 1) % LP_VEIL_WIDTH,
				       row + (column + LP_VEIL_WIDTH - 1) % LP_VEIL_WIDTH,
				       n >= LP_VEIL_WIDTH ? n - LP_VEIL_WIDTH : n,
				       n + LP_VEIL_WIDTH < LP_VEIL_NODES ? n + LP_VEIL_WIDTH : n};

		for (int b = 0; b < 4 && !is_seen[n]; b++) {
			is_seen[n] = was_seen[beside[b]];
			for (int k = 0; k < g->lens_count && is_seen[n]; k++)
				g->lens[k].even[n] = g->lens[k].out_of[n] =
					g->lens[k].even[beside[b]];
		}
	}
}

/* Lenses as the camera file has them; also one picture of a part of the sphere. */
static void set_lenses(struct lp_glare *g, const struct lp_camera *camera)
{
	const int width = camera->width_px ? camera->width_px : LP_VEIL_WIDTH;
	const int height = camera->height_px ? camera->height_px : LP_VEIL_HEIGHT;

	bool seen[LP_VEIL_NODES] = {false}, filled[LP_VEIL_NODES];

	g->lens_count = camera->lens_count;
	for (int n = 0; n < LP_VEIL_NODES; n++) {
		double d[3], pixel[2], illumination, share[LP_MAX_LENSES], sum = 0.0;

		node_direction(n, d);
		for (int k = 0; k < g->lens_count; k++) {
			const bool sees = lp_camera_project(camera, k, width, height, d, pixel,
							    &share[k], &illumination);

			g->lens[k].source[n] = sees ? 1.0F : 0.0F;
			share[k] = sees ? share[k] : 0.0;
			sum += share[k];
		}
		for (int k = 0; k < g->lens_count && sum > 0.0; k++)
			g->lens[k].even[n] = g->lens[k].out_of[n] = (float)(share[k] / sum);
		seen[n] = sum > 0.0;
	}
	memcpy(filled, seen, sizeof(filled));
	fill_shares(g, seen, filled);
	for (int k = 0; k < g->lens_count; k++)
		g->lens[k].spreads = true;
}

/*
 * Factors b of the nodes with which sum over j of b_i kernel_ij b_j area_j is 1 for each i of the
 * lens: the kernel is symmetric, so it then keeps light, too (Sinkhorn & Knopp 1967).
 */
static void balance(struct lp_glare *g, struct lp_glare_lens *lens)
{
	float b[LP_VEIL_NODES];

	for (int n = 0; n < LP_VEIL_NODES; n++)
		b[n] = lens->source[n];
	for (int round = 0; round < BALANCING; round++) {
		for (int n = 0; n < LP_VEIL_NODES; n++)
			for (int c = 0; c < 4; c++)
				g->work[n][c] = b[n] * node_sr(n);
		lp_spread_apply(g->spread, (const float(*)[4])g->work, g->work);
		for (int n = 0; n < LP_VEIL_NODES; n++)
			if (b[n] > 0.0F && g->work[n][0] > 0.0F)
				b[n] = sqrtf(b[n] / g->work[n][0]);
	}
	for (int n = 0; n < LP_VEIL_NODES; n++) {
		lens->into[n] = b[n];
		for (int c = 0; c < 4; c++)
			g->work[n][c] = b[n] * node_sr(n);
	}
	lp_spread_apply(g->spread, (const float(*)[4])g->work, g->work);
	for (int n = 0; n < LP_VEIL_NODES; n++) /* b where the lens sees, once it is balanced */
		lens->out_of[n] /= g->work[n][0];
}

static int allocate(struct lp_glare *g, int width)
{
	const int height = width / 2;
	const size_t cells = (size_t)width * height + 16; /* vector loads reach beyond the last */

	g->width = width;
	g->height = height;
	g->row_node = calloc(height, sizeof(*g->row_node));
	g->row_share = calloc(height, sizeof(*g->row_share));
	g->row_sr = calloc(height, sizeof(*g->row_sr));
	g->column_node = calloc(width, sizeof(*g->column_node));
	g->column_share = calloc(width, sizeof(*g->column_share));
	g->nearest = calloc(cells, sizeof(*g->nearest));
	g->cells = calloc(cells, sizeof(*g->cells));
	g->turned = calloc(cells, sizeof(*g->turned));
	g->turned_variance = calloc(cells, sizeof(*g->turned_variance));
	return g->row_node && g->row_share && g->row_sr && g->column_node && g->column_share &&
			       g->nearest && g->cells && g->turned && g->turned_variance
		       ? 0
		       : -ENOMEM;
}

/* Where the cells of the panorama lie between the nodes. Beyond the first and the last row those
 * count. */
static void set_places(struct lp_glare *g)
{
	for (int r = 0; r < g->height; r++) {
		const double at = (r + 0.5) * LP_VEIL_HEIGHT / g->height - 0.5;
		const int node = (int)fmin(fmax(floor(at), 0.0), LP_VEIL_HEIGHT - 2.0);

		g->row_node[r] = node;
		g->row_share[r] = (float)fmin(fmax(at - node, 0.0), 1.0);
		g->row_sr[r] =
			(float)(2.0 * M_PI / g->width *
				(cos(M_PI * r / g->height) - cos(M_PI * (r + 1) / g->height)));
	}
	for (int c = 0; c < g->width; c++) {
		const double at = (c + 0.5) * LP_VEIL_WIDTH / g->width - 0.5;

		g->column_node[c] = ((int)floor(at) + LP_VEIL_WIDTH) % LP_VEIL_WIDTH;
		g->column_share[c] = (float)(at - floor(at));
	}
	for (int i = 0; i < g->width * g->height; i++) {
		const int r = i / g->width, c = i % g->width;
		const int row = g->row_node[r] + (g->row_share[r] < 0.5F ? 0 : 1);
		const int column = g->column_node[c] + (g->column_share[c] < 0.5F ? 0 : 1);

		g->nearest[i] = row * LP_VEIL_WIDTH + column % LP_VEIL_WIDTH;
	}
}

int lp_glare_create(const struct lp_camera *camera, int panorama_width, struct lp_glare **glare)
{
	struct lp_glare *g = calloc(1, sizeof(*g));
	int ret;

	if (!g)
		return -ENOMEM;
	g->shares = camera->glare;
	g->believed = g->allowed = 1.0F;
	ret = allocate(g, panorama_width);
	if (ret == 0)
		ret = lp_spread_create(g->shares.width_deg, &g->spread);
	if (ret < 0) {
		lp_glare_destroy(g);
		return ret;
	}
	set_places(g);
	if (lp_camera_is_whole(camera))
		set_panorama(g);
	else
		set_lenses(g, camera);
	for (int k = 0; k < g->lens_count; k++) {
		struct lp_glare_lens *lens = &g->lens[k];

		for (int n = 0; n < LP_VEIL_NODES; n++)
			lens->area_sr += lens->source[n] * node_sr(n);
		lens->spreads &= g->shares.around > 0.0F;
		if (lens->spreads)
			balance(g, lens);
	}
	*glare = g;
	return 0;
}

void lp_glare_destroy(struct lp_glare *glare)
{
	if (!glare)
		return;
	lp_spread_destroy(glare->spread);
	free(glare->turned_variance);
	free(glare->turned);
	free(glare->cells);
	free(glare->nearest);
	free(glare->column_share);
	free(glare->column_node);
	free(glare->row_sr);
	free(glare->row_share);
	free(glare->row_node);
	free(glare);
}
