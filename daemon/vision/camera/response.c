/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/camera/response.h"

#include <math.h>

#include "vision/camera/camera.h"

/* Chosen by hand; docs/maintainers/constants.md says what other values do. */

/* Half width, in codes, over which a table's curvature is taken: tables from calibration are rough.
 */
#define CURVATURE_CODES 4.0

/* Codes between which the weight of a value fades out. */
#define FADE_FROM 215.0F
#define FADE_TO 248.0F

static double srgb(double v)
{
	return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
}

static double srgb_curvature(double v)
{
	return v <= 0.04045 ? 0.0 : 2.4 * 1.4 / (1.055 * 1.055) * pow((v + 0.055) / 1.055, 0.4);
}

static void init_srgb(struct lp_response *response)
{
	for (int v = 0; v < 256; v++)
		response->pixel[0][v] = (float)srgb(v / 255.0);
	for (int i = 0; i <= LP_CODE_INDEX_MAX; i++) {
		const double v = (double)i / LP_CODE_INDEX_MAX;

		response->block[0][i].linear = (float)srgb(v);
		response->block[0][i].half_curvature =
			(float)(srgb_curvature(v) / (2.0 * 255.0 * 255.0));
	}
}

/* Linear interpolation; beyond the ends the end's own slope goes on. */
static double at(const float *table, double code)
{
	int k = (int)floor(code);

	k = k < 0 ? 0 : k > 254 ? 254 : k;
	return table[k] + (code - k) * (table[k + 1] - table[k]);
}

static void init_table(struct lp_response *response, int c, const float *table)
{
	for (int v = 0; v < 256; v++)
		response->pixel[c][v] = table[v];
	for (int i = 0; i <= LP_CODE_INDEX_MAX; i++) {
		const double code = (double)i / LP_CODE_STEPS, h = CURVATURE_CODES;
		const double second =
			(at(table, code + h) - 2.0 * at(table, code) + at(table, code - h)) /
			(h * h);

		response->block[c][i].linear = (float)at(table, code);
		response->block[c][i].half_curvature = (float)(second / 2.0);
	}
}

static void init_weight(struct lp_response *response)
{
	const float *green = response->pixel[1];
	const float least = 1e-4F; /* a flat piece of a table is no certainty */
	int v = 0;

	for (int i = 0; i < 256; i++) {
		while (v < 255 && green[v] < (float)(i * i) / (255.0F * 255.0F))
			v++;

		const int low = v > 0 ? v - 1 : 0, high = v < 255 ? v + 1 : 255;
		const float slope = fmaxf((green[high] - green[low]) / (float)(high - low), least);
		const float fade = (FADE_TO - (float)v) / (FADE_TO - FADE_FROM);

		response->weight[i] = fminf(fmaxf(fade, 1e-3F), 1.0F) / (slope * slope);
	}
}

void lp_response_init(struct lp_response *response, const struct lp_camera *camera)
{
	if (camera->response_given) {
		for (int c = 0; c < 3; c++)
			init_table(response, c, camera->response[c]);
		init_weight(response);
		return;
	}
	init_srgb(response);
	for (int c = 1; c < 3; c++) {
		for (int v = 0; v < 256; v++)
			response->pixel[c][v] = response->pixel[0][v];
		for (int i = 0; i <= LP_CODE_INDEX_MAX; i++)
			response->block[c][i] = response->block[0][i];
	}
	init_weight(response);
}

void lp_response_scale(struct lp_response *response, const float factor[3])
{
	for (int c = 0; c < 3; c++) {
		for (int v = 0; v < 256; v++)
			response->pixel[c][v] *= factor[c];
		for (int i = 0; i <= LP_CODE_INDEX_MAX; i++) {
			response->block[c][i].linear *= factor[c];
			response->block[c][i].half_curvature *= factor[c];
		}
	}
	init_weight(response);
}

void lp_response_bend(struct lp_response *response, float power)
{
	if (power == 1.0F)
		return;
	for (int c = 0; c < 3; c++) {
		float table[256];

		for (int v = 0; v < 256; v++)
			table[v] = powf(fmaxf(response->pixel[c][v], 0.0F), power);
		init_table(response, c, table);
	}
	init_weight(response);
}
