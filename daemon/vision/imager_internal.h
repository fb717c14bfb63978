/* SPDX-License-Identifier: Apache-2.0 */
/* What imager.c, follow.c and refine.c share. */
#ifndef LP_VISION_IMAGER_INTERNAL_H
#define LP_VISION_IMAGER_INTERNAL_H

#include "include/panorama.h"
#include "light/motion.h"
#include "light/witness.h"
#include "vision/banding.h"
#include "vision/camera.h"
#include "vision/cover.h"
#include "vision/gain.h"
#include "vision/imager.h"
#include "vision/radiance_map.h"
#include "vision/response.h"

struct lp_alignment;
struct lp_lookup;
struct lp_remap;
struct lp_stokes_map;

/* An alignment that fewer of the compared pixels agree with is none. */
#define LP_LEAST_AGREEMENT 0.4F
#define LP_REFINE_MAX_CELLS 1024 /* camera cells of one lamp */
#define LP_CELL_MAX_PX 64	 /* pixels of one camera cell */

/* An exposure setting of the last frames. */
struct lp_recent_exposure {
	float exposure_us; /* times gain; NAN: unknown */
	float mean_code;   /* NAN: float frames */
	uint64_t serial;   /* of the newest frame of it; 0: none */
	bool invalid;	   /* it held samples that are no light */
};

struct lp_imager {
	const struct lp_camera *camera; /* borrowed */
	struct lp_imager_options options;
	struct lp_response response;
	struct lp_grid *grid;
	struct lp_remap *remap;	   /* of the current picture size */
	float *row_weight;	   /* of the current picture size: solid angle up to a factor */
	float *row_solid_angle_sr; /* of one pixel, equirectangular; same block as row_weight */

	struct lp_exposure incoming; /* the newest frame */
	int64_t t_capture_ns;	     /* of it */
	bool loaded;		     /* it has not been accepted yet */
	/* Its cells on the panorama's grid, camera frame: `mapped` and `mapped_flags`, or the
	 * camera's own where the two grids are the same. */
	struct lp_panorama seen;
	float (*mapped)[4];
	uint8_t *mapped_flags;

	struct lp_radiance_map *map;
	struct lp_panorama panorama; /* the map, as the rest of the pipeline sees it */
	struct lp_motion motion;
	int64_t t_motion_ns; /* that motion.rotation is of; 0: nothing has been seen */
	int64_t t_map_ns;    /* of the last frame that the map has observed */
	float agreement;     /* of the last alignment */
	double elapsed_s;    /* between the newest frame and the one before; 0: not told */
	struct lp_testimony testimony; /* what the newest frame carries of its orientation */
	struct lp_witness witness;

	/* Where the map's cells lie in the camera's frame, while the camera is turned. */
	struct lp_lookup *lookup;
	struct lp_alignment *alignment;
	float (*turned)[4];
	uint8_t *turned_flags;
	float *step2;

	struct lp_stokes_map *stokes; /* NULL: no film */
	struct lp_film_view film; /* of the newest frame, anchor frame; sheet_count 0: unknown */
	float wheel_deg;	  /* of the newest frame; NAN: unknown */
	struct lp_stokes angles;  /* what unpolarized light would tell by the angles so far */

	uint64_t serial;
	uint64_t changed_serial; /* of the last frame that showed other light than before it */
	struct lp_recent_exposure recent[LP_MAX_BRACKET];
	struct lp_map_update update; /* of the newest observation */
	float flicker;		     /* lp_imager_expect_flicker() */
	struct lp_cover cover;	     /* of the camera's view */
	float covered_s;	     /* for how long by now */
	float covered_share;	     /* of the light that is known */

	/* unknown_exposure.c */
	struct lp_gain gain;	    /* scale of the newest frame; count 0: it was told */
	int watched[LP_GAIN_CELLS]; /* gain.cells[] in the panorama */
	int watched_count;
	bool is_relative; /* the map began with frames that did not tell their exposure */

	float row_time_us; /* of the newest frame; NAN: unknown */
	struct lp_banding banding;
	struct lp_banding_samples band_samples;

	/* refine.c */
	int *place;	    /* per camera cell: index into the patch that saw it last */
	float (*pixels)[3]; /* of LP_REFINE_MAX_CELLS camera cells */
	int32_t *behind;    /* panorama cells behind a lamp, camera frame */
	uint8_t *taken;	    /* per panorama cell: it is among them */
};

/* What the newest frame says, in the camera's frame. */
struct lp_observation lp_imager_observation(const struct lp_imager *imager);

/* film.c: the film as it stood in the newest frame, in the frame of the map. */
void lp_imager_place_film(struct lp_imager *imager);
/* What the film's angle tells, and then the frame as it would be without the film. */
void lp_imager_see_through(struct lp_imager *imager, struct lp_observation *seen);

/* The newest frame's scale is another. */
void lp_imager_rescale(struct lp_imager *imager, float scale);

/* unknown_exposure.c: choose the cells of the panorama that are watched. */
void lp_imager_watch(struct lp_imager *imager);
/* bands.c: does the newest frame, before the map learns from it, show bands? */
void lp_imager_look_for_bands(struct lp_imager *imager);

/* unknown_exposure.c: where the newest frame does not tell its exposure, find its scale by the map:
 * roughly, before it is known where the camera looks; and in earnest. */
void lp_imager_expect_scale(struct lp_imager *imager);
void lp_imager_find_scale(struct lp_imager *imager);
/* Nothing is left to compare the next frame with. */
void lp_imager_forget_scale(struct lp_imager *imager);
/* When the map is turned: how it lies to what is known of the scale, before and afterwards. */
float lp_imager_scale_in_map(struct lp_imager *imager);
void lp_imager_turn_scale(struct lp_imager *imager, float in_map);

/* Where the camera looks in the newest frame (follow.c); and, once all that shows it has been
 * heard, what that says of the witness. */
void lp_imager_follow(struct lp_imager *imager);
void lp_imager_followed(struct lp_imager *imager);

/* The newest frame against the map, if it was exposed for exposure_us (times gain). */
struct lp_cover_view lp_imager_cover_view(const struct lp_imager *imager, float exposure_us);

#endif
