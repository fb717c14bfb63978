/* SPDX-License-Identifier: Apache-2.0 */
#include "app/options/once_options.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "app/options/options.h"
#include "include/ring_sample.h"

#define MOST_LUX 1e6F
#define LEAST_RING_SIGMA 0.001F
#define MOST_RING_SIGMA 10.0F

/* Numbers separated by commas, at most nine: how many there are, or -EINVAL. */
static int parse_nine(const char *text, float least, float most, struct lp_floats *list)
{
	*list = (struct lp_floats){0};
	for (; list->count < LP_RING_SENSORS; text++) {
		char *end;
		const float value = strtof(text, &end);

		if (end == text || value < least || value > most)
			return -EINVAL;
		list->values[list->count++] = value;
		text = end;
		if (*text != ',')
			break;
	}
	return *text ? -EINVAL : list->count;
}

static int parse_ring_lux(const char *text, void *field)
{
	return parse_nine(text, 0.0F, MOST_LUX, field) == LP_RING_SENSORS ? 0 : -EINVAL;
}

static int parse_ring_rgb(const char *text, void *field)
{
	struct lp_options *options =
		LP_CONTAINER_OF((float(*)[9][3])field, struct lp_options, ring_rgb);
	const char *next = text;

	for (int i = 0; i < 3 * LP_RING_SENSORS; i++) {
		char *end;
		const float value = strtof(next, &end);
		const bool last = i == 3 * LP_RING_SENSORS - 1;

		if (end == next || value < 0.0F || value > MOST_LUX || *end != (last ? '\0' : ','))
			return -EINVAL;
		options->ring_rgb[i / 3][i % 3] = value;
		next = end + 1;
	}
	options->has_ring_rgb = true;
	return 0;
}

static int parse_ring_sigma(const char *text, void *field)
{
	struct lp_floats *sigma = field;
	const int count = parse_nine(text, LEAST_RING_SIGMA, MOST_RING_SIGMA, sigma);

	for (int k = 0; k < sigma->count; k++)
		if (isnan(sigma->values[k]))
			return -EINVAL;
	return count == 1 || count == LP_RING_SENSORS ? 0 : -EINVAL;
}

static const struct lp_param once_list[] = {
	{"area-lights", LP_PARAM_BOOL, offsetof(struct lp_options, area_lights), .initial = "0",
	 .help = "windows, soft boxes and the like are lights, too, one ellipse each"},
	{"key-light", LP_PARAM_BOOL, offsetof(struct lp_options, key_light), .initial = "0",
	 .help = "one more directional light, KEY, for what the listed ones leave"},
	{"ring-lux", LP_PARAM_OWN, offsetof(struct lp_options, ring_lux), .parse = parse_ring_lux,
	 .expects = "nine numbers 0..1e6, or nan, separated by commas",
	 .help = "what the nine light sensors read while the pictures were taken;\n"
		 "nan: this one cannot be used"},
	{"ring-rgb", LP_PARAM_OWN, offsetof(struct lp_options, ring_rgb), .parse = parse_ring_rgb,
	 .expects = "27 numbers 0..1e6, or nan, separated by commas",
	 .help = "with --ring-lux: red, green and blue of the first sensor, of the second, ...;\n"
		 "each colour in a unit of its own"},
	{"ring-colour-sigma", LP_PARAM_FLOAT, offsetof(struct lp_options, ring_colour_sigma),
	 .initial = "0.03", .min = 0.001, .max = 10, .help = "relative 1 sigma of these"},
	{"ring-sigma", LP_PARAM_OWN, offsetof(struct lp_options, ring_sigma), .initial = "0.03",
	 .parse = parse_ring_sigma, .expects = "one number 0.001..10 for all, or nine",
	 .help = "relative 1 sigma of these readings: one number for all, or nine"},
};
const struct lp_params lp_once_params = LP_PARAMS(once_list);
