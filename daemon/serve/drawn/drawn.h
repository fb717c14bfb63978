/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The least that suffices for what an app draws (Subscription.draws): here it is decided, from
 * predicted errors of the estimate at hand. Four things may be drawn, each with an error of its own
 * (docs/users/conventions.md, "What is drawn"). Pure functions on plain data.
 */
#ifndef LP_SERVE_DRAWN_DRAWN_H
#define LP_SERVE_DRAWN_DRAWN_H

#include <stdbool.h>
#include <stdint.h>

#include "include/light_estimate.h"

enum lp_drawn_thing {
	LP_DRAWN_DIFFUSE,
	LP_DRAWN_SHADOWS,
	LP_DRAWN_GLOSSY,
	LP_DRAWN_MIRRORS,
	LP_DRAWN_THINGS
};

/* A relative number for each thing. */
struct lp_drawn {
	float of[LP_DRAWN_THINGS];
};

#define LP_DRAWN_BY_MODEL 3 /* diffuse, shadows, glossy; a mirror needs a map */

/* What each model leaves out: SH order, first lights of the estimate (beyond what there is: as with
 * all). */
struct lp_drawn_models {
	float left_out[LP_DRAWN_BY_MODEL][LP_MAX_SH_ORDER + 1][LP_MAX_LIGHTS + 1];
	float screen_slope; /* change of what a glossy surface shows, of white on a screen, by a
			       change of the irradiance, of its mean */
};

#define LP_DRAWN_SIZES 3 /* of reflection maps: 16, 32, 64 texels */

/* What each size of reflection maps leaves out. */
struct lp_drawn_maps {
	int size;			  /* the finest of which this is known; 0: nothing is */
	float glossy[LP_DRAWN_SIZES];	  /* up to `size` */
	float mirrors[LP_DRAWN_SIZES];	  /* likewise */
	float glossy_slope, mirror_slope; /* as of models */
	int64_t t_ns;			  /* of the estimate that this was measured with */
};

/* The map that one kind of subscription is sent. Zeroed: not decided yet. */
struct lp_drawn_map_choice {
	bool decided;
	int size;		     /* texels; 0: none */
	int64_t t_ns, fits_since_ns; /* since when a smaller one would have done; 0: it does not */
};

/* Index of a size in an array of LP_DRAWN_SIZES. */
int lp_drawn_size_index(int size);

/* No thing is drawn. */
bool lp_drawn_is_nothing(const struct lp_drawn *tolerance);

/* The smallest tolerance of what is drawn; 0: nothing is. */
float lp_drawn_least(const struct lp_drawn *tolerance);

/* What models leave out as a share of what they may: the largest of what is drawn. Up to 1 a model
 * suffices. They may leave out what the tolerance leaves beside `measured`, 1 sigma of the light as
 * known. `by_map`: a map shows glossy things. */
void lp_drawn_shares(const struct lp_drawn_models *models, const struct lp_drawn *tolerance,
		     float measured, bool by_map,
		     float share[LP_MAX_SH_ORDER + 1][LP_MAX_LIGHTS + 1]);

/*
 * Texels of the map to send from now on, up to `most` (0: maps are off). None where nothing is
 * mirrored, or where the best model allowed suffices for glossy things (`model_share`, as above).
 * The largest while no size is known. A larger one is taken at once, a smaller one when it would
 * have done for a while.
 */
int lp_drawn_choose_map(struct lp_drawn_map_choice *choice, const struct lp_drawn_maps *maps,
			const struct lp_drawn *tolerance, float measured, float model_share,
			int most, int64_t t_ns);

/* Errors to state of what is drawn; NAN: not drawn. `left_out`: what the model leaves out;
 * `map_size`: 0: no map is sent. `screen_slope`: of the models. */
struct lp_drawn lp_drawn_stated(const float left_out[LP_DRAWN_BY_MODEL], float screen_slope,
				const struct lp_drawn_maps *maps, const struct lp_drawn *tolerance,
				float measured, int map_size);

/* Of a map by itself: glossy and mirrors. */
struct lp_drawn lp_drawn_of_map(const struct lp_drawn_maps *maps, int map_size, float measured);

#endif
