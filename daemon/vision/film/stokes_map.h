/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How light is polarized, per cell of the panorama, from the film's angles
 * (light/film/polarization.h); and exposures as they would be without the film. In the frame of the
 * radiance map. One thread; all storage is allocated at create().
 */
#ifndef LP_VISION_FILM_STOKES_MAP_H
#define LP_VISION_FILM_STOKES_MAP_H

#include <stdbool.h>
#include <stdint.h>

#include "light/film/polarization.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All of the map is judged by a sample of so many cells along a row, and of so many rows; a part of
 * the sphere by so many of these at least. */
#define LP_STOKES_COLUMN_STEP 4
#define LP_STOKES_ROW_STEP 2
#define LP_STOKES_LEAST_CELLS 8

struct lp_grid;
struct lp_observation;
struct lp_polarization_grid;

struct lp_stokes_map {
	const struct lp_grid *grid; /* borrowed */
	struct lp_stokes *cells;    /* of luminance */
	struct lp_stokes *turned;   /* workspace */
	struct lp_film_view view;   /* that `axis` is of */
	float (*axis)[2];	    /* lp_film_pass(); NAN: it does not polarize */
	float *gain_sigma;	    /* of the same, relative */
	float (*radiance)[4];	    /* workspace of lp_stokes_map_see_through() */
	float *variance;
	uint8_t *flags;
};

int lp_stokes_map_create(const struct lp_grid *grid, struct lp_stokes_map **map); /* -ENOMEM */
void lp_stokes_map_destroy(struct lp_stokes_map *map);				  /* accepts NULL */

void lp_stokes_map_forget(struct lp_stokes_map *map);

/* The observation was made through the film; its radiance is divided by the film's gains, on the
 * axis and off it. */
void lp_stokes_map_learn(struct lp_stokes_map *map, const struct lp_film_view *view,
			 const struct lp_observation *observation);

/* Make it an observation without the film, by what is known: what is not adds to its variance.
 * The view's angle may be unknown, as while the wheel turns. Its radiance and step2 are the map's
 * until the next call. */
void lp_stokes_map_see_through(struct lp_stokes_map *map, const struct lp_film_view *view,
			       struct lp_observation *observation);

/* Mark as not seen what is known to be polarized, or seen through an unknown share of the film, in
 * an observation in a frame from which `to_map` turns into that of the map, `view` being of that
 * frame: the film, which does not turn with the room, makes it brighter and darker. Its flags are
 * the map's until the next call. */
void lp_stokes_map_leave_out(struct lp_stokes_map *map, const struct lp_film_view *view,
			     const struct lp_rotation *to_map, struct lp_observation *observation);

/* Of what the cells show together above a surround of radiance `background`; not known where cells
 * that hold more than a fifth of it are not. radiance: of all cells, as the map holds it. */
struct lp_polarization lp_stokes_map_of(const struct lp_stokes_map *map, const float (*radiance)[4],
					float background, const int32_t *cells, int count);

/* Nearly everywhere around what lies below the horizon is polarized upright, as no floor does it,
 * and what lies above is not polarized: the film is a quarter turn off. False also where too little
 * is known or polarized. */
bool lp_stokes_map_floor_is_upright(const struct lp_stokes_map *map);

/* Whether all around the film's axis light seems polarized as behind a film that has been put in a
 * quarter turn wrong: its surfaces then take other light than is put back. False for a film without
 * surfaces, and where too little is known in a quarter around the axis. */
bool lp_stokes_map_surfaces_seem_turned(const struct lp_stokes_map *map);

/* All that is known as a coarse picture in the frame from which `to_map` turns into that of the
 * map. Fills all but t_capture_ns. */
void lp_stokes_map_picture(const struct lp_stokes_map *map, const struct lp_rotation *to_map,
			   struct lp_polarization_grid *picture);

/* As lp_radiance_map_turn(). */
void lp_stokes_map_turn(struct lp_stokes_map *map, const struct lp_rotation *rotation);

#ifdef __cplusplus
}
#endif

#endif
