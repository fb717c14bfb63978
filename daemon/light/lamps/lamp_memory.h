/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Lamps over time: each keeps its identity and what has been measured of it. A lamp is measured by
 * full-resolution pixels only in exposures that do not clip it; in between what is known of it
 * stays, and becomes the less certain the longer ago it was. Everything is in the anchor frame,
 * which does not turn with the camera. Plain data; zeroed is a new one. One thread.
 */
#ifndef LP_LIGHT_LAMPS_LAMP_MEMORY_H
#define LP_LIGHT_LAMPS_LAMP_MEMORY_H

#include <stdbool.h>
#include <stdint.h>

#include "light/film/polarization.h"
#include "light/find/lamps.h"
#include "light/lamps/existence.h"
#include "light/lamps/flicker.h"
#include "light/place/parallax.h"

struct lp_rotation;

/* A source of less width becomes a lamp, another one an area light (lp_detection_width_deg()): on
 * the scenes of docs/users/accuracy.md, "What belongs on the list". */
#define LP_COMPACT_DEG 7.0F

struct lp_remembered_lamp {
	struct lp_lamp lamp;	  /* as known now; cells only while `seen` */
	struct lp_lamp on_grid;	  /* as the panorama shows it */
	uint32_t id;		  /* 0: this place is free */
	bool seen;		  /* in the newest panorama */
	bool by_pixels;		  /* `lamp` is what pixels told, be it a lower bound */
	bool measured;		  /* by pixels of an exposure that did not clip it */
	float direction_variance; /* rad^2, per axis */
	float aside[3]; /* mean of where it was last found against where it was known to be, rad */
	float lag;	/* of that, what is more than noise, rad */
	float walk2;	/* rad^2 per second that it has been seen to move */
	float unplaced_s;	 /* since its direction was last measured */
	float strength_variance; /* relative; of the irradiance */
	float film_sigma;	 /* of its root, what is the film's in all readings alike */
	float then_on_grid; /* luminance of on_grid.irradiance when `lamp` was last taken anew */
	float hidden; /* of its irradiance, by clipping (light_estimate.h); not what the ring tells
		       */
	/* Where it was when it was largest lately, and how large, which fades: what is seen of it
	 * after that may be a rim. */
	float whole[3], whole_sr;
	float absent_s; /* how long it has not been seen */
	bool missed;	/* in the newest panorama, but not in the one before; its light is gone */
	struct lp_flicker flicker; /* of its strength as measured by pixels */
	float clipped_scale;	   /* of the shortest exposure whose pixels clip it; 0: none does */
	float known_s;		   /* since it was found first */
	struct lp_existence existence;
	float disputed_s; /* how long detection has drawn other borders (light/lamps/holding.h) */
	bool wide;	  /* an area light */
	bool listed;	  /* in the newest estimate, or as strong as what is */
	/* What the ring of light sensors finds of it beyond `lamp`, which is a lower bound: R, G,
	 * B, luminance, and 1 sigma of the last; 0: nothing. Of the newest frame alone. */
	float recovered[4], recovered_sigma;
	/* 1 sigma of the colour of that: root mean square over R, G and B; of irradiance. */
	float recovered_colour_sigma;
	struct lp_stokes stokes;	     /* of its luminance above the surround; anchor frame */
	struct lp_polarization polarization; /* by `stokes`, or by its cells */
	float image_probability; /* that it is the mirror image of another lamp; NAN: not judged */
	bool reflection;	 /* it is listed as the mirror image of another lamp */
	bool counted;		 /* among those of unknown polarization (estimate/lamp_stage.h) */
	/* How far away it is; empty while nobody tells where the probe is. */
	struct lp_parallax parallax;
};

struct lp_lamp_memory {
	uint32_t last_id;
	struct lp_clutter clutter;
	struct lp_remembered_lamp list[LP_MAX_LAMPS];
};

/* One lamp of the newest panorama, and what the newest frame's pixels say of it. */
struct lp_lamp_sighting {
	struct lp_lamp on_grid;
	struct lp_lamp
		pixels; /* only if `refined`; its flag CLIPPED says that it is a lower bound */
	float strength_sigma; /* of pixels.irradiance, relative */
	float scale;	      /* of the frame: full scale to radiance */
	float width_deg;
	float film_misfit; /* lp_stokes_reading.misfit */
	float film_rest_s; /* lp_stokes_reading.rest_s */
	/* What the pixels were seen through (light/film/sheet.h), by whose gains they are divided.
	 */
	struct lp_film_pass film;
	float came; /* share of on_grid's light that was not there about a second ago */
	bool refined;
	bool enters; /* strong and clear enough to become a lamp; else it only goes on being one */
};

struct lp_memory_times {
	float elapsed_s;		  /* since the last update */
	float rotation_sigma_rad;	  /* of the camera's rotation in the newest frame */
	const struct lp_probe_pose *pose; /* NULL: nobody tells where the probe is */
};

/* Each lamp and each sighting at most once, nearest pairs first. */
void lp_lamp_memory_update(struct lp_lamp_memory *memory, const struct lp_lamp_sighting *sightings,
			   int count, const struct lp_memory_times *times);

/*
 * How the lamps that these sightings measure are turned against where they are known to be: the
 * rotation vector (anchor frame) that brings the sightings to the lamps is information^-1 times
 * `pull`; information per rad^2, singular where fewer than two lamps say something. A lamp that is
 * further off than sigma_rad explains is left out. Returns how many lamps count. Memory and
 * sightings stay as they are.
 */
int lp_lamp_memory_landmarks(const struct lp_lamp_memory *memory,
			     const struct lp_lamp_sighting *sightings, int count, float sigma_rad,
			     double pull[3], double information[3][3]);

/* Deepest flicker of the lamps that are seen (root mean square, relative); 0: none flickers. */
float lp_lamp_memory_flicker(const struct lp_lamp_memory *memory);

/* Whether a lamp that flickers clips in some of its phases. */
bool lp_lamp_memory_flicker_clips(const struct lp_lamp_memory *memory);

/* Whether a remembered lamp that is now so wide is an area light: it stays what it was between
 * LP_COMPACT_DEG / 1.4 and LP_COMPACT_DEG * 1.4. */
bool lp_lamp_stays_wide(const struct lp_remembered_lamp *lamp, float width_deg);

/* The remembered lamp that a lamp of the panorama is; NULL: none. */
const struct lp_remembered_lamp *lp_lamp_memory_find(const struct lp_lamp_memory *memory,
						     const struct lp_lamp *on_grid);

/*
 * Whether a small lamp that clips is missed in the newest panorama only, and may well be there
 * still: a long exposure in which its pixels are spread over several blocks of the picture, none of
 * which is seen to clip. Such a lamp shines on for one frame.
 */
bool lp_lamp_may_be_hidden(const struct lp_remembered_lamp *lamp);

/* The probe has gone by so much since the last call, anchor frame, 1 sigma along each axis: lamps
 * whose distances are known are elsewhere now. */
void lp_lamp_memory_go(struct lp_lamp_memory *memory, const double way_m[3], double sigma_m);

/* Whether what is told of where the probe is contradicts what is seen of most lamps: another frame,
 * another unit. */
bool lp_lamp_memory_doubts_places(const struct lp_lamp_memory *memory);

/* The finder that the lamps' cells are of is gone. */
void lp_lamp_memory_lose_cells(struct lp_lamp_memory *memory);

/* The anchor frame has been turned. */
void lp_lamp_memory_turn(struct lp_lamp_memory *memory, const struct lp_rotation *turn);

#endif
