/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One camera of the imager: where its pixels look, what they mean, its newest frame, and what its
 * frames have shown of its exposures. Several of them share one radiance map. One thread.
 */
#ifndef LP_VISION_EYE_H
#define LP_VISION_EYE_H

#include <stdbool.h>
#include <stdint.h>

#include "include/panorama.h"
#include "vision/camera/camera.h"
#include "vision/camera/response.h"
#include "vision/doubt/banding.h"
#include "vision/doubt/cover.h"
#include "vision/doubt/gain.h"
#include "vision/doubt/overlap.h"
#include "vision/exposure.h"
#include "vision/imager.h"
#include "vision/map/radiance_map.h"
#include "vision/response/linearity.h"
#include "vision/response/tear.h"
#include "vision/stuck/stuck.h"

struct lp_glare;
struct lp_remap;

/* An exposure setting of the last frames. */
struct lp_recent_exposure {
	float exposure_us;	/* times gain; NAN: unknown */
	float mean_code;	/* NAN: float frames */
	uint64_t serial;	/* of the newest frame of it; 0: none */
	float clipped_fraction; /* of the sphere, in the camera's own picture */
	bool invalid;		/* it held samples that are no light */
};

/* Plain data but for what it allocates; lp_eye_init() starts it. */
struct lp_eye {
	const struct lp_camera *given;	/* borrowed */
	const struct lp_camera *camera; /* that, or `cropped` */
	struct lp_camera cropped;	/* the same of a part of the sphere; borrows from it */
	struct lp_response response;
	struct lp_remap *remap; /* of the current picture size; NULL: no frame has come */
	float *row_weight;	/* of the current picture size: solid angle up to a factor */
	struct lp_glare *glare; /* NULL: the camera file states none, or no frame has come */
	int *place;		/* per camera cell: index into the patch that saw it last */

	struct lp_exposure incoming; /* the newest frame */
	/* Its cells on the panorama's grid, camera frame: `mapped` and `mapped_flags`, or the
	 * camera's own where the two grids are the same and no film is before it. */
	struct lp_panorama seen;
	float (*mapped)[4];
	const float *over_film; /* borrowed: by which those cells are multiplied; NULL: 1 */
	uint8_t *mapped_flags;
	int64_t t_seen_ns; /* of the newest frame accepted; 0: none since the camera came */
	bool accepted;	   /* `seen` is of that frame */
	bool lost;	   /* the camera is away */

	uint64_t serial;	 /* of the newest frame accepted; 0: none */
	uint64_t changed_serial; /* of the last frame that showed other light than before it */
	struct lp_recent_exposure recent[LP_MAX_BRACKET];
	struct lp_stuck stuck;	       /* places of the picture that shine by themselves */
	struct lp_cover cover;	       /* of the camera's view */
	float covered_s;	       /* for how long by now */
	float covered_share;	       /* of the light that is known */
	struct lp_gain gain;	       /* scale of the newest frame; count 0: it was told */
	struct lp_overlap overlap;     /* with the other cameras */
	struct lp_linearity linearity; /* of its response */
	struct lp_tear tear;	       /* of its pictures by a change of exposure */
	float told_power;	       /* what the log has told of it */
	float learned_film_deg;	       /* angle of the film as it was learned last; NAN: unknown */
	float row_time_us;	       /* of the newest frame; NAN: unknown */
	struct lp_banding banding;
};

/* `scale`: of a frame whose exposure is unknown, full scale to radiance. -ENOMEM: release it. */
int lp_eye_init(struct lp_eye *eye, const struct lp_camera *camera, int panorama_width,
		float scale);
void lp_eye_release(struct lp_eye *eye); /* everything it holds */

/* False: the next picture says that it shows no part of the sphere that could be used, and the
 * camera file does not say it either. */
bool lp_eye_can_look(const struct lp_eye *eye, const struct lp_crop *stated);

/* Before lp_eye_fit(): the part of the sphere that the next picture says it shows. */
void lp_eye_look(struct lp_eye *eye, const struct lp_crop *stated);

/* 1: the next picture has another size than the one before, 0: the same. -ENOMEM, -EINVAL. */
int lp_eye_fit(struct lp_eye *eye, int width_px, int height_px, int cell_px);

/* The newest frame's cells on the panorama's grid. */
void lp_eye_map(struct lp_eye *eye);

/* Whether the camera looks along a cell of the panorama, camera frame. */
bool lp_eye_sees(const struct lp_eye *eye, int cell);

/* The newest frame has been accepted, exposed for exposure_us (times gain; NAN: unknown). */
void lp_eye_note_exposure(struct lp_eye *eye, float exposure_us);

/* What its last frames were exposed for. */
struct lp_eye_exposures {
	int count;
	int current;	   /* of these, the newest, and those since the light last changed */
	float longest_us;  /* NAN: unknown */
	float mean_code;   /* of the longest; NAN: float frames */
	float shortest_us; /* of those known; INFINITY: none is */
	/* Of the sphere, what the shortest of them shows to clip, 0 where none is known; a map that
	 * holds small lamps in the wrong place while the camera turns may not know. */
	float clipped_fraction;
	bool unknown; /* not told, and not found out */
	bool invalid; /* they held samples that are no light */
};
struct lp_eye_exposures lp_eye_exposures(const struct lp_eye *eye);

/* Several cameras: compare the newest frame with that of another one, where both look, and correct
 * this one's factors by it. `cells`: workspace. */
void lp_eye_compare(struct lp_eye *eye, const struct lp_eye *other, struct lp_gain *cells);

/* What its newest frame says, camera frame. flicker_sigma: as that of the observation. */
struct lp_observation lp_eye_observation(const struct lp_eye *eye, float flicker_sigma);

/* glare/look.c: 1 sigma of all light, relative, from how well its lens' glare is known. */
float lp_eye_veil_sigma(const struct lp_eye *eye);

/* response/exposures_agree.c: its response becomes that which its frames have told by now. */
void lp_eye_bend_response(struct lp_eye *eye);

/* Forget what its frames have shown. */
void lp_eye_forget(struct lp_eye *eye);

#endif
