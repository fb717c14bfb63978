/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/osc/exposures.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#define RATE_TOLERANCE 1.01F

static int compare_doubles(const void *a, const void *b)
{
	const double x = *(const double *)a, y = *(const double *)b;

	return (x > y) - (x < y);
}

static int compare_ints(const void *a, const void *b)
{
	const int x = *(const int *)a, y = *(const int *)b;

	return (x > y) - (x < y);
}

/* Those that end within one frame of the preview. */
static void read_shutters(struct lp_osc_exposures *range, const json_t *list, float rate_hz)
{
	const double longest_s = (double)(RATE_TOLERANCE / rate_hz);
	const json_t *item;
	size_t i;

	range->exposure_count = 0;
	json_array_foreach(list, i, item)
	{
		const double seconds = json_number_value(item);

		if (seconds > 0 && seconds <= longest_s && range->exposure_count < LP_EXPOSURES_MAX)
			range->shutters_s[range->exposure_count++] = seconds;
	}
	qsort(range->shutters_s, (size_t)range->exposure_count, sizeof(double), compare_doubles);
	for (int k = 0; k < range->exposure_count; k++)
		range->exposures_us[k] = (float)(range->shutters_s[k] * 1e6);
}

static void read_isos(struct lp_osc_exposures *range, const json_t *list)
{
	const json_t *item;
	size_t i;

	range->iso_count = 0;
	json_array_foreach(list, i, item)
	{
		const json_int_t iso = json_integer_value(item);

		if (iso > 0 && iso < 1000000 && range->iso_count < LP_OSC_ISOS_MAX)
			range->isos[range->iso_count++] = (int)iso;
	}
	qsort(range->isos, (size_t)range->iso_count, sizeof(int), compare_ints);
}

int lp_osc_exposures_read(struct lp_osc_exposures *range, const json_t *options, float rate_hz,
			  int iso)
{
	read_shutters(range, json_object_get(options, "shutterSpeedSupport"), rate_hz);
	read_isos(range, json_object_get(options, "isoSupport"));
	if (range->exposure_count == 0 || range->iso_count == 0)
		return -EPROTO;
	range->base_iso = iso ? iso : range->isos[0];
	for (int k = 0; k < range->iso_count; k++) {
		if (range->isos[k] == range->base_iso)
			return 0;
	}
	return -EINVAL;
}

void lp_osc_exposures_snap(const struct lp_osc_exposures *range, float *exposure_us, float *gain)
{
	const float iso = *gain * (float)range->base_iso;
	int best = 0, best_iso = 0;

	for (int k = 1; k < range->exposure_count; k++) {
		if (fabsf(log2f(range->exposures_us[k] / *exposure_us)) <
		    fabsf(log2f(range->exposures_us[best] / *exposure_us)))
			best = k;
	}
	for (int k = 1; k < range->iso_count; k++) {
		if (fabsf(log2f((float)range->isos[k] / iso)) <
		    fabsf(log2f((float)range->isos[best_iso] / iso)))
			best_iso = k;
	}
	*exposure_us = range->exposures_us[best];
	*gain = (float)range->isos[best_iso] / (float)range->base_iso;
}

json_t *lp_osc_exposures_options(const struct lp_osc_exposures *range, float exposure_us,
				 float gain)
{
	double shutter_s = 0;

	for (int k = 0; k < range->exposure_count; k++) {
		if (range->exposures_us[k] <= exposure_us)
			shutter_s = range->shutters_s[k];
	}
	return json_pack("{s:f, s:i}", "shutterSpeed", shutter_s, "iso",
			 (int)lrintf(gain * (float)range->base_iso));
}
